"""Speed, acceleration, jerk and yaw-rate limits on what is sent.

ArduPilot shapes guided velocities in acceleration and jerk but does not cap them, so the caps are
ours. The shaper is the square-root controller that ArduPilot itself uses.
"""

import math

from landerd.config.models import Config, LimitsSection
from landerd.geometry import ZERO, Vec3, clamp
from landerd.messages import Setpoint

STOPPED = Setpoint(ZERO, 0.0)
# rad/s^2. Chosen by hand, below the 140 degrees/s^2 with which ArduCopter 4.5.7 answered a step of
# the yaw rate in SITL.
MAX_YAW_ACCELERATION = math.radians(120.0)
# Longest time step of the limiter, s: the period of the slowest control rate. With a step of 0.1 s,
# after a tick that came late, the vertical speed overshot its limit by 3 %.
MAX_STEP_S = 0.05


def flyable_limits(config: Config) -> LimitsSection:
    """Return the configured limits, with no more acceleration than the autopilot allows.

    Beyond, the autopilot would fall behind the set-points and overshoot.
    """
    limits, autopilot = config.guidance.limits, config.autopilot
    level = min(limits.acceleration_mps2, autopilot.acceleration_mps2)
    vertical = min(limits.vertical_acceleration_mps2, autopilot.vertical_acceleration_mps2)
    return limits.model_copy(
        update={"acceleration_mps2": level, "vertical_acceleration_mps2": vertical}
    )


class Limiter:
    """Turns desired velocities into a sequence of set-points within the limits.

    Attributes:
        velocity: of the last set-point, local NED, m/s.
    """

    def __init__(self, limits: LimitsSection) -> None:
        self.configure(limits)
        self.reset(ZERO)

    def configure(self, limits: LimitsSection) -> None:
        """Take new limits; the next set-points approach them within the acceleration limits."""
        self._limits = limits
        self._yaw_rate_limit = math.radians(limits.yaw_rate_deg_s)

    def reset(self, velocity: Vec3) -> None:
        """Begin at a velocity already flown (local NED, m/s), cut to the limits; acceleration 0."""
        self.velocity = self._capped(velocity)
        self._acceleration = ZERO
        self._yaw_rate = 0.0

    def stop(self) -> Setpoint:
        """Return an order to stop at once; exempt from the acceleration limits."""
        self.reset(ZERO)
        return STOPPED

    def climb_away(self, north: float, east: float, dt: float) -> Setpoint:
        """Return a set-point that climbs at once, exempt from the acceleration limits; yaw rate 0.

        Args:
            north: velocity, m/s.
            east: velocity, m/s.
            dt: time since the last set-point, s.
        """
        return self._at_once(north, east, -self._limits.climb_mps, dt)

    def end_climb(self, north: float, east: float, dt: float) -> Setpoint:
        """Return the same with zero vertical velocity, at once."""
        return self._at_once(north, east, 0.0, dt)

    def _at_once(self, north: float, east: float, down: float, dt: float) -> Setpoint:
        n, e, d = self._capped((north, east, down))
        self._slew(n, e, min(dt, MAX_STEP_S), vertical=(min(d, 0.0), 0.0))
        self._yaw_rate = 0.0
        return Setpoint(self.velocity, 0.0)

    def step(self, wanted: Vec3, yaw_rate: float, dt: float, *, may_descend: bool) -> Setpoint:
        """Return the next set-point on the way to the desired one.

        Args:
            wanted: velocity, local NED, m/s.
            yaw_rate: rad/s; zero is a stop order, and taken at once.
            dt: time since the last set-point, s.
            may_descend: if False, a downward order ends at once, like a stop order.
        """
        limits = self._limits
        dt = min(dt, MAX_STEP_S)
        n, e, d = self._capped(wanted)
        v, a = self.velocity[2], self._acceleration[2]
        if not may_descend:
            d = min(d, 0.0)
            if v > 0.0:
                v = a = d = 0.0  # a climb begins with the next set-point
        error = d - v
        most = limits.vertical_acceleration_mps2
        asked = _square_root_control(abs(error), most, limits.jerk_mps3, dt)
        step = limits.jerk_mps3 * dt
        a += clamp(math.copysign(asked, error) - a, -step, step)
        v += a * dt
        if not may_descend and v > 0.0:
            v = a = 0.0
        self._slew(n, e, dt, vertical=(v, a))
        rate = clamp(yaw_rate, -self._yaw_rate_limit, self._yaw_rate_limit)
        max_step = MAX_YAW_ACCELERATION * dt
        slewed = self._yaw_rate + clamp(rate - self._yaw_rate, -max_step, max_step)
        # Zero is a stop order: the last rate must not outlive the sight of the pad.
        self._yaw_rate = slewed if rate != 0.0 else 0.0
        return Setpoint(self.velocity, self._yaw_rate)

    def _capped(self, v: Vec3) -> Vec3:
        limits = self._limits
        speed = math.hypot(v[0], v[1])
        k = limits.speed_mps / speed if speed > limits.speed_mps else 1.0
        return (k * v[0], k * v[1], clamp(v[2], -limits.climb_mps, limits.descent_mps))

    def _slew(self, north: float, east: float, dt: float, *, vertical: tuple[float, float]) -> None:
        """Go towards a horizontal velocity, m/s; vertical: the new velocity and acceleration."""
        limits = self._limits
        (v_north, v_east, _), (a_north, a_east, _) = self.velocity, self._acceleration
        north, east = north - v_north, east - v_east
        size = math.hypot(north, east)
        a = _square_root_control(size, limits.acceleration_mps2, limits.jerk_mps3, dt)
        k = a / size if size > 0.0 else 0.0
        north, east = k * north - a_north, k * east - a_east
        size = math.hypot(north, east)
        max_change = limits.jerk_mps3 * dt
        k = max_change / size if size > max_change else 1.0
        a_north, a_east = a_north + k * north, a_east + k * east
        self._acceleration = (a_north, a_east, vertical[1])
        self.velocity = (v_north + a_north * dt, v_east + a_east * dt, vertical[0])


def _square_root_control(error: float, acceleration: float, jerk: float, dt: float) -> float:
    """Return the acceleration (m/s^2) that closes a velocity error (m/s, not negative).

    Linear near zero, and beyond that such that the jerk limit can still bring it to zero in time:
    ArduPilot's sqrt_controller with a gain of jerk / acceleration. The gain is bounded so that one
    step of dt (s) closes no more than the whole error: else the velocity would oscillate about the
    desired one, and exceed its limit.
    """
    gain = min(jerk / acceleration, 1.0 / dt)
    knee = jerk / (gain * gain)
    wanted = gain * error if error < knee else math.sqrt(2.0 * jerk * (error - knee / 2.0))
    return min(wanted, acceleration)
