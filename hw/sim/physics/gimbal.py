"""A two-axis gimbal: the thesis's PID on each axis, a spring towards the centre, and the device.

The real drivers move the same axes through the protocol models of `hw.sim.gimbals`.
"""

import asyncio
import math
from enum import Enum
from random import Random
from typing import TYPE_CHECKING

from hw.sim.options import SimGimbalOptions
from hw.sim.physics.response import STEP_S
from landerd.geometry import Mat3, Vec3, angles_zxy, camera_mount, matmul, transpose
from landerd.messages import GimbalCommand, GimbalState, Reference
from landerd.ports import DeviceLost, Feedback, GimbalTraits

if TYPE_CHECKING:
    from hw.sim.physics.world import World

YAW_LIMITS = (-0.5 * math.pi, 0.5 * math.pi)  # thesis 2.3.3
PITCH_LIMITS = (-math.pi, 0.0)
IDLE_PITCH = -0.4  # where the thesis's gimbal waits, rad
REPORT_PERIOD_S = 0.02


class Axis:
    """One joint: torque by PID (thesis Table 3.1) against damping, inertia and a spring to 0.

    One that is given speeds follows them with a lag, and the spring slows it; a bolted one stays.
    """

    _KP, _KI, _KD = 0.25, 0.1, 0.025
    _INERTIA = 0.003  # with the damping below: no ringing
    _SPRING = 0.0125  # the thesis gives none; sags 4.5 degrees at 90 until the integral acts
    _INTEGRAL_LIMIT = 0.05  # torque
    _PULL = 0.1  # of the spring on an axis that is given speeds, rad/s per rad

    def __init__(
        self, angle: float, limits: tuple[float, float], lag_s: float, rate_limit: float
    ) -> None:
        self.angle = self.target = angle
        self.rate = 0.0
        self._low, self._high = limits
        # Set-point and angle pass the same derivative, so damping alone makes the lag.
        self._damping = self._KP * lag_s
        self._lag_s = lag_s
        self._speed: float | None = None  # ordered, rad/s; None: angles are ordered
        self._bolted = False
        self._rate_limit = rate_limit
        self._integral = self._SPRING * angle
        self._last_error = 0.0

    def turn(self, speed: float) -> None:
        """Take speeds from now on, rad/s."""
        self._speed = speed

    def bolt(self, angle: float) -> None:
        """Stay at this angle for ever, rad."""
        self.angle = self.target = angle
        self._bolted = True

    def step(self) -> None:
        """Go on by STEP_S towards target (rad), or at the ordered speed."""
        if self._bolted:
            return
        if self._speed is None:
            self._step_angle()
        else:
            order = self._speed - self._PULL * self.angle
            self._move(self.rate + (order - self.rate) * STEP_S / (0.5 * self._lag_s))

    def _step_angle(self) -> None:
        error = self.target - self.angle
        slope = (error - self._last_error) / STEP_S
        self._last_error = error
        integral = self._integral + self._KI * error * STEP_S
        self._integral = max(-self._INTEGRAL_LIMIT, min(self._INTEGRAL_LIMIT, integral))
        torque = self._KP * error + self._integral + self._KD * slope
        torque -= self._damping * self.rate + self._SPRING * self.angle
        self._move(self.rate + torque / self._INERTIA * STEP_S)

    def _move(self, rate: float) -> None:
        self.rate = max(-self._rate_limit, min(self._rate_limit, rate))
        angle = self.angle + self.rate * STEP_S
        self.angle = max(self._low, min(self._high, angle))
        if self.angle != angle:  # at the stop
            self.rate = 0.0


class GimbalPlant:
    """Yaw about body z, then pitch; angles in rad.

    Attributes:
        reference: what the angles are relative to; a stabilised gimbal takes the airframe's roll
            and pitch out.
        R_gimbal_camera: how the camera sits on the last axis.
    """

    def __init__(self, options: SimGimbalOptions) -> None:
        self.R_gimbal_camera = camera_mount(options.mount.camera_rotation_deg)
        self.reference = Reference.BODY
        limit = math.radians(options.rate_limit_deg_s)
        self.yaw = Axis(0.0, YAW_LIMITS, options.lag_s, limit)
        self.pitch = Axis(IDLE_PITCH, PITCH_LIMITS, options.lag_s, limit)

    def step(self) -> None:
        """Go on by STEP_S."""
        self.yaw.step()
        self.pitch.step()

    def aim(self, yaw: float, pitch: float) -> None:
        """Set the target angles, rad; beyond the limits the limit is taken."""
        self.yaw.target = max(YAW_LIMITS[0], min(YAW_LIMITS[1], yaw))
        self.pitch.target = max(PITCH_LIMITS[0], min(PITCH_LIMITS[1], pitch))


class SimMount:
    """The gimbal in the world as its electronics know it: orders, and angles measured with errors.

    Attributes:
        plant: the axes.
        yaw_bias: constant error of the measured yaw, rad.
        pitch_bias: the same of the pitch.
    """

    def __init__(self, world: "World", options: SimGimbalOptions, rng: Random) -> None:
        self.plant = world.gimbal
        self._world = world
        self._rng = rng
        self._noise = math.radians(options.noise_deg)
        yaw_bias = pitch_bias = math.radians(options.bias_deg)
        if options.pitch_bias_deg is not None:
            pitch_bias = math.radians(options.pitch_bias_deg)
        self.yaw_bias = rng.choice((-yaw_bias, yaw_bias))
        self.pitch_bias = rng.choice((-pitch_bias, pitch_bias))
        mount = options.mount
        self._yaw_sign, self._pitch_sign = mount.yaw_sign, mount.pitch_sign
        self._yaw_zero = math.radians(mount.yaw_zero_deg)
        self._pitch_zero = math.radians(mount.pitch_zero_deg)

    def advance(self) -> None:
        """Let the world go on to the loop's time; done before each order."""
        self._world.advance(asyncio.get_running_loop().time())

    def aim(self, yaw: float, pitch: float) -> None:
        """Order angles, rad."""
        self.advance()
        self.plant.aim(
            self._yaw_sign * yaw + self._yaw_zero, self._pitch_sign * pitch + self._pitch_zero
        )

    def turn(self, yaw: float, pitch: float) -> None:
        """Order speeds, rad/s."""
        self.advance()
        self.plant.yaw.turn(self._yaw_sign * yaw)
        self.plant.pitch.turn(self._pitch_sign * pitch)

    def angles(self, reference: Reference) -> tuple[float, float]:
        """Return yaw and pitch as they are, rad; the pitch perhaps against the horizon."""
        plant = self.plant
        if reference is plant.reference:
            return plant.yaw.angle, plant.pitch.angle
        _, pitch, _ = angles_zxy(self.motion()[1])
        return plant.yaw.angle, pitch

    def motion(self, back_s: float = 0.0) -> tuple[float, Mat3, Vec3]:
        """Return the time, R_local_gimbal so long ago, and the vehicle's velocity (local, m/s)."""
        self.advance()
        world, plant = self._world, self.plant
        R_local_camera = world.snapshot(world.t - back_s).camera.R_local_camera
        R_local_gimbal = matmul(R_local_camera, transpose(plant.R_gimbal_camera))
        return world.t, R_local_gimbal, world.vehicle.velocity

    def bolt(self, yaw: float, pitch: float) -> None:
        """Fix the camera where these angles (rad) would be measured, but for zeros."""
        self.plant.yaw.bolt(yaw - self.yaw_bias + self._yaw_zero)
        self.plant.pitch.bolt(pitch - self.pitch_bias + self._pitch_zero)

    @property
    def rates(self) -> tuple[float, float]:
        """Speeds of yaw and pitch, rad/s."""
        return self._yaw_sign * self.plant.yaw.rate, self._pitch_sign * self.plant.pitch.rate

    @property
    def ordered(self) -> tuple[float, float]:
        """Yaw and pitch that were ordered last, rad."""
        return self._counted(self.plant.yaw.target, self.plant.pitch.target)

    def _counted(self, yaw: float, pitch: float) -> tuple[float, float]:
        """Return angles of the axes as the electronics count them."""
        return self._yaw_sign * (yaw - self._yaw_zero), self._pitch_sign * (
            pitch - self._pitch_zero
        )

    def measure(self, *, pitch_measured: bool = True) -> tuple[float, float]:
        """Return yaw and pitch now, rad; without a sensor the pitch that was ordered."""
        self.advance()
        plant = self.plant
        yaw, pitch = self._counted(plant.yaw.angle, plant.pitch.angle)
        pitch = pitch if pitch_measured else self.ordered[1]
        return (
            yaw + self.yaw_bias + self._rng.gauss(0.0, self._noise),
            pitch + self.pitch_bias + self._rng.gauss(0.0, self._noise),
        )


class GimbalFault(Enum):
    """What can go wrong with the device."""

    SILENT = "silent"  # reports nothing
    FROZEN = "frozen"  # repeats the last angles with new times
    NAN = "nan"  # reports angles that are no numbers
    LOST = "lost"  # is gone from the bus


class SimGimbal:
    """The device that landerd talks to (landerd.ports.Gimbal). Set `fault` to break it."""

    def __init__(self, mount: SimMount, options: SimGimbalOptions) -> None:
        self.fault: GimbalFault | None = None
        self._mount = mount
        self._options = options
        self._next_report = 0.0
        self._last: GimbalState | None = None
        self.traits = GimbalTraits(
            Reference.BODY,
            Feedback.MEASURED if options.pitch_feedback else Feedback.ORDERED,
            1.0 / REPORT_PERIOD_S,
            YAW_LIMITS,
            PITCH_LIMITS,
        )

    async def open(self) -> None:
        """Start the device. Raises DeviceLost."""
        if self.fault is GimbalFault.LOST:
            raise DeviceLost("simulated gimbal is gone")
        self._next_report = asyncio.get_running_loop().time()

    async def state(self) -> GimbalState:
        """Wait for the next report, 50 a second. Raises DeviceLost."""
        loop = asyncio.get_running_loop()
        while True:
            missed = max(0.0, (loop.time() - self._next_report) // REPORT_PERIOD_S)
            self._next_report += (missed + 1.0) * REPORT_PERIOD_S
            await asyncio.sleep(self._next_report - loop.time())
            if self.fault is GimbalFault.LOST:
                raise DeviceLost("simulated gimbal is gone")
            if self.fault is not GimbalFault.SILENT:
                return self._report(loop.time())

    def command(self, command: GimbalCommand) -> None:
        """Take new target angles; what is no number is dropped."""
        if self.fault is GimbalFault.LOST:
            return
        if math.isfinite(command.yaw) and math.isfinite(command.pitch):
            self._mount.aim(command.yaw, command.pitch)

    async def close(self) -> None:
        """Release the device."""

    def _report(self, t: float) -> GimbalState:
        if self.fault is GimbalFault.NAN:
            return GimbalState(t, math.nan, math.nan, math.nan, Reference.BODY)
        if self.fault is GimbalFault.FROZEN and self._last is not None:
            return GimbalState(t, self._last.yaw, self._last.pitch, 0.0, Reference.BODY)
        measured = self._options.pitch_feedback
        yaw, pitch = self._mount.measure(pitch_measured=measured)
        self._last = GimbalState(t, yaw, pitch, 0.0, Reference.BODY, pitch_measured=measured)
        return self._last
