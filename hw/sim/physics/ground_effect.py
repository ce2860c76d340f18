"""More thrust near the ground: the air that the rotors push down cannot get away."""

from hw.sim.physics.contact import GRAVITY
from hw.sim.physics.pad_motion import PadState
from hw.sim.physics.response import STEP_S
from landerd.geometry import Vec3


class GroundEffect:
    """What the ground adds to the thrust, as far as the flight code has not yet taken it back.

    The share falls with the square of the rotors' height, as the image method says for heights
    above half a rotor's radius (Cheeseman and Bennett 1955; for multirotors Sanchez-Cuevas et al.
    2017, who measured up to 20 % for a whole quadrotor). The flight code's integral of vertical
    acceleration takes a steady share back within about a second.
    """

    ROTOR_HEIGHT_M = 0.25  # of the rotors of a standing vehicle
    ORIGIN_HEIGHT_M = 0.2  # of the body's origin then
    INTEGRAL_S = 1.0  # of PSC_ACCZ_I

    def __init__(self, share: float) -> None:
        """Share: of thrust, for a vehicle that stands."""
        self._share = share
        self._taken_back = 0.0

    def step(self, position: Vec3, surface: PadState) -> float:
        """Go on by STEP_S; return the acceleration up, m/s^2, of a vehicle at position (local)."""
        height = max(0.0, surface.position[2] - position[2] - self.ORIGIN_HEIGHT_M)
        share = self._share * (self.ROTOR_HEIGHT_M / (self.ROTOR_HEIGHT_M + height)) ** 2
        self._taken_back += (share - self._taken_back) * STEP_S / self.INTEGRAL_S
        return GRAVITY * (share - self._taken_back)
