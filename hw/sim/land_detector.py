"""ArduCopter's land detector, as far as a landing in GUIDED shows it."""

from hw.sim.response import STEP_S


class LandDetector:
    """Says ON_GROUND once the thrust has been gone for a second under an order to descend."""

    _TRIGGER_S = 1.0  # LAND_DETECTOR_TRIGGER_SEC
    _THRUST_GONE = 0.01  # of hover
    _LATERAL_MPS = 0.3  # measured: an order of 0.2 m/s along the surface lands, one of 0.3 does not

    def __init__(self) -> None:
        self.landed = False
        self._timer = 0.0

    def step(self, thrust: float, descending: bool, lateral: float) -> None:
        """Go on by STEP_S while a foot touches.

        Args:
            thrust: in units of the hover thrust
            descending: descent is ordered, or the motors are off
            lateral: velocity ordered along the surface, relative to it, m/s
        """
        if thrust < self._THRUST_GONE and descending and lateral < self._LATERAL_MPS:
            self._timer += STEP_S
            if self._timer >= self._TRIGGER_S:
                self.landed = True
        else:
            self._timer = 0.0

    def flying(self) -> None:
        """Start again: the vehicle is clear of any surface, or takes off."""
        self.landed = False
        self._timer = 0.0
