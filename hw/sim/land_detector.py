"""ArduCopter's land detector, as far as a landing in GUIDED shows it."""

import math

from hw.sim.response import STEP_S
from landerd.geometry import Vec3


class LandDetector:
    """Says ON_GROUND once the thrust has been gone for a second under an order to descend."""

    _TRIGGER_S = 1.0  # LAND_DETECTOR_TRIGGER_SEC
    _THRUST_GONE = 0.01  # of hover
    _LATERAL_MPS = 0.3  # measured: an order of 0.2 m/s along the surface lands, one of 0.3 does not

    def __init__(self) -> None:
        self.landed = False
        self._timer = 0.0

    def step(self, thrust: float, order: Vec3, surface_velocity: Vec3) -> None:
        """Go on by STEP_S while a foot touches.

        Args:
            thrust: in units of the hover thrust
            order: velocity ordered, local NED, m/s
            surface_velocity: of what the feet stand on, m/s
        """
        lateral = math.hypot(order[0] - surface_velocity[0], order[1] - surface_velocity[1])
        if thrust < self._THRUST_GONE and order[2] > 0.0 and lateral < self._LATERAL_MPS:
            self._timer += STEP_S
            if self._timer >= self._TRIGGER_S:
                self.landed = True
        else:
            self._timer = 0.0

    def flying(self) -> None:
        """Start again: no foot touches, or it takes off."""
        self.landed = False
        self._timer = 0.0
