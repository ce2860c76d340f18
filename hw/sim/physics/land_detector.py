"""ArduCopter's land detector and its throttle mix (4.5.7, ArduCopter/land_detector.cpp)."""

import math

from hw.sim.physics.response import STEP_S
from landerd.geometry import Vec3, norm


class LandDetector:
    """Detects a landing once there has been no thrust for a second under an order to descend.

    Unless it is in LAND, ArduCopter reserves thrust for steering while a large tilt is requested,
    and detects no landing meanwhile: in wind, or on a fast pad, for as long as the tilt is
    requested. It detects none either while the vehicle accelerates by more than `STATIONARY_MPS2`.
    """

    _TRIGGER_S = 1.0  # LAND_DETECTOR_TRIGGER_SEC
    _THRUST_GONE = 0.01  # thrust below which there is none, in units of the hover thrust
    _LARGE_ANGLE = math.radians(15.0)  # LAND_CHECK_LARGE_ANGLE_CD
    STATIONARY_MPS2 = 1.0  # LAND_DETECTOR_ACCEL_MAX
    _MOVING_MPS2 = 3.0  # LAND_CHECK_ACCEL_MOVING
    _SLOW_MPS = 1.0
    _FILTER_SHARE = STEP_S / (STEP_S + 1.0 / (2.0 * math.pi * 1.0))  # 1 Hz
    # Throttle mix: thrust reserved for steering, in units of the hover thrust. It rises fast and
    # falls slowly.
    _MIX_MIN, _MIX_MAX = 0.1, 0.5
    _MIX_UP, _MIX_DOWN = 2.0, 0.5  # 1/s
    _MIX_IS_MIN = 1.25 * _MIX_MIN

    def __init__(self) -> None:
        self.landed = False
        self.throttle_mix = self._MIX_MIN
        self._timer = 0.0
        self._velocity: Vec3 | None = None
        self._filtered: Vec3 = (0.0, 0.0, 0.0)

    def step(
        self, thrust: float, *, descending: bool, landing: bool, tilt: float, velocity: Vec3
    ) -> None:
        """Advance by STEP_S while a foot touches.

        Args:
            thrust: in units of the hover thrust
            descending: a descent is ordered, or the motors are off
            landing: the mode is LAND
            tilt: requested angle from level, rad
            velocity: of the vehicle, local, m/s
        """
        if self._velocity is not None:
            k = self._FILTER_SHARE
            change = (n - b for n, b in zip(velocity, self._velocity, strict=True))
            x, y, z = (
                a + k * (c / STEP_S - a) for a, c in zip(self._filtered, change, strict=True)
            )
            self._filtered = (x, y, z)
        self._velocity = velocity
        acceleration = norm(self._filtered)
        steers = tilt > self._LARGE_ANGLE and not landing
        if steers or acceleration > self._MOVING_MPS2 or not descending:
            self.throttle_mix = min(self.throttle_mix + self._MIX_UP * STEP_S, self._MIX_MAX)
        else:
            self.throttle_mix = max(self.throttle_mix - self._MIX_DOWN * STEP_S, self._MIX_MIN)
        if (
            thrust < self._THRUST_GONE
            and self.throttle_mix < self._MIX_IS_MIN
            and acceleration <= self.STATIONARY_MPS2
            and abs(velocity[2]) < self._SLOW_MPS
        ):
            self._timer += STEP_S
            if self._timer >= self._TRIGGER_S:
                self.landed = True
        else:
            self._timer = 0.0

    def flying(self) -> None:
        """Reset the detector: the vehicle is clear of any surface, or takes off."""
        self.landed = False
        self._timer = 0.0
        self.throttle_mix = self._MIX_MIN
        self._velocity = None
        self._filtered = (0.0, 0.0, 0.0)
