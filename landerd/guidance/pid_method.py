"""The thesis's landing controller: four PIDs whose gains change with the phase (2.4.3, 2.4.5)."""

import math

from landerd.config.models import Config, PidGains
from landerd.geometry import Vec3, clamp
from landerd.guidance.pid import Pid
from landerd.guidance.relative_state import RelativeState
from landerd.messages import Phase


class PidMethod:
    """Velocity and yaw rate that bring the vehicle onto the pad."""

    def __init__(self, config: Config) -> None:
        pid = config.guidance.pid
        limit = pid.integral_limit_mps
        self._north = Pid(pid.approach, integral_limit=limit)
        self._east = Pid(pid.approach, integral_limit=limit)
        self._up = Pid(pid.up, integral_limit=limit)
        self._yaw = Pid(pid.yaw, integral_limit=limit)
        self._saturated = self._down_saturated = False
        self.configure(config)

    def configure(self, config: Config) -> None:
        """Take new gains, which fade in, and limits."""
        options = config.guidance
        pid = options.pid
        self._gains: dict[Phase, PidGains] = {
            Phase.APPROACH: pid.approach,
            Phase.CLOSE_APPROACH: pid.close_approach,
            Phase.YAW_CORRECTION: pid.final,
            Phase.DESCENT: pid.final,
            Phase.LANDED: pid.final,
        }
        self._up.set_gains(pid.up)
        self._yaw.set_gains(pid.yaw)
        for controller in (self._north, self._east, self._up, self._yaw):
            controller.integral_limit = pid.integral_limit_mps
        self._speed = pid.speed_mps
        self._descent = options.limits.descent_mps
        self._slowest = options.descent.slowest_mps

    def restart(self) -> None:
        """Begin a landing: integrals at zero."""
        for pid in (self._north, self._east, self._up, self._yaw):
            pid.reset()
        self._saturated = self._down_saturated = False

    def step(
        self,
        phase: Phase,
        relative: RelativeState,
        floor_m: float,
        dt: float,
        *,
        widening: float = 1.0,
    ) -> tuple[Vec3, float]:
        """Return velocity (local NED, m/s) and yaw rate (rad/s).

        Args:
            phase: decides the gains and whether the heading is turned.
            relative: pad relative to vehicle.
            floor_m: height over the pad to come down to, m.
            dt: time since the last step, s.
            widening: not used: this method descends whenever it may.
        """
        error, rate = relative.error, relative.error_rate
        for pid in (self._north, self._east):
            pid.set_gains(self._gains[phase])
        north = self._north.step(error[0], rate[0], dt, saturated=self._saturated)
        east = self._east.step(error[1], rate[1], dt, saturated=self._saturated)
        size = math.hypot(north, east)
        self._saturated = size > self._speed
        if self._saturated:
            north, east = north * self._speed / size, east * self._speed / size
        to_go = error[2] - floor_m
        wanted = self._up.step(to_go, rate[2], dt, saturated=self._down_saturated)
        down = clamp(wanted, self._slowest, self._descent) if to_go > 0.0 else 0.0
        self._down_saturated = down != wanted
        turn = 0.0
        if phase is Phase.YAW_CORRECTION and relative.heading_error is not None:
            turn = self._yaw.step(relative.heading_error, -relative.yaw_rate, dt, saturated=False)
        return (north, east, down), turn
