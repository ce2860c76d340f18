"""A two-axis gimbal: on each axis the thesis's PID, a spring towards the centre, and end stops."""

import math

from hw.sim.options import SimGimbalOptions
from hw.sim.physics.response import STEP_S
from landerd.geometry import camera_mount, clamp
from landerd.messages import Reference

YAW_LIMITS = (-0.5 * math.pi, 0.5 * math.pi)  # rad; thesis 2.3.3
PITCH_LIMITS = (-math.pi, 0.0)  # rad; thesis 2.3.3
IDLE_PITCH = -0.4  # pitch at the start, as in the thesis, rad


class Axis:
    """One joint: torque by PID (thesis Table 3.1) against damping, inertia and a spring to 0.

    An axis that is given speeds follows them with a lag, and the spring slows it. A bolted axis
    never moves.

    Attributes:
        stuck: while this is set the axis does not move.
    """

    _KP, _KI, _KD = 0.25, 0.1, 0.025
    _INERTIA = 0.003  # so small that with the damping below the axis does not ring
    # The thesis does not give the spring: with this one an axis at 90 degrees sags by 4.5 degrees
    # until the integral acts.
    _SPRING = 0.0125
    _INTEGRAL_LIMIT = 0.05  # largest torque of the integral
    _SPRING_RATE = 0.1  # by which the spring slows an axis that is given speeds, rad/s per rad

    def __init__(
        self, angle: float, limits: tuple[float, float], lag_s: float, rate_limit: float
    ) -> None:
        self.angle = self.target = angle
        self.rate = 0.0
        self.stuck = False
        self._low, self._high = limits
        # The derivative acts on set-point and angle alike, so only the damping causes the lag.
        self._damping = self._KP * lag_s
        self._lag_s = lag_s
        self._speed: float | None = None  # ordered, rad/s; None: angles are ordered
        self._bolted = False
        self._rate_limit = rate_limit
        self._integral = self._SPRING * angle
        self._last_error = 0.0

    def aim(self, angle: float) -> None:
        """Set the target angle, rad; beyond the limits the limit is taken."""
        self.target = max(self._low, min(self._high, angle))

    def turn(self, speed: float) -> None:
        """Turn at this speed, rad/s; from then on target angles are ignored."""
        self._speed = speed

    def bolt(self, angle: float) -> None:
        """Fix the axis at this angle, rad."""
        self.angle = self.target = angle
        self._bolted = True

    def step(self) -> None:
        """Advance by STEP_S, towards the target angle or at the ordered speed."""
        if self._bolted or self.stuck:
            self.rate = 0.0
            return
        if self._speed is None:
            self._step_angle()
        else:
            order = self._speed - self._SPRING_RATE * self.angle
            self._move(self.rate + (order - self.rate) * STEP_S / (0.5 * self._lag_s))

    def _step_angle(self) -> None:
        error = self.target - self.angle
        slope = (error - self._last_error) / STEP_S
        self._last_error = error
        integral = self._integral + self._KI * error * STEP_S
        self._integral = clamp(integral, -self._INTEGRAL_LIMIT, self._INTEGRAL_LIMIT)
        torque = self._KP * error + self._integral + self._KD * slope
        torque -= self._damping * self.rate + self._SPRING * self.angle
        self._move(self.rate + torque / self._INERTIA * STEP_S)

    def _move(self, rate: float) -> None:
        self.rate = clamp(rate, -self._rate_limit, self._rate_limit)
        angle = self.angle + self.rate * STEP_S
        self.angle = clamp(angle, self._low, self._high)
        if self.angle != angle:  # at the stop
            self.rate = 0.0


class GimbalPlant:
    """Yaw about body z, then pitch; angles in rad.

    Attributes:
        reference: what the angles are relative to; a stabilised gimbal compensates the airframe's
            roll and pitch.
        R_gimbal_camera: rotation from the camera's frame to that of the last axis.
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
        self.yaw.aim(yaw)
        self.pitch.aim(pitch)
