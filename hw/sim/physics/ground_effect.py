"""Ground effect: rotors give more thrust close to the ground."""

from hw.sim.physics.contact import GRAVITY
from hw.sim.physics.pad_motion import PadState
from hw.sim.physics.response import STEP_S
from landerd.geometry import Vec3


class GroundEffect:
    """The thrust that the ground adds, less what the flight code has compensated so far.

    The share falls with the square of the rotors' height, as the image method says for heights
    above half a rotor's radius (Cheeseman and Bennett 1955; for multirotors Sanchez-Cuevas et al.
    2017, who measured up to 20 % for a whole quadrotor). The flight code's integral of the vertical
    acceleration compensates a steady share within about a second.
    """

    ROTOR_HEIGHT_M = 0.25  # height of the rotors of a standing vehicle over the ground
    ORIGIN_HEIGHT_M = 0.2  # height of its body frame's origin
    INTEGRAL_S = 1.0  # time constant of the integral (PSC_ACCZ_I)

    def __init__(self, share: float) -> None:
        """Make it; share: of the thrust, added to a standing vehicle's."""
        self._share = share
        self._taken_back = 0.0

    def step(self, position: Vec3, surface: PadState) -> float:
        """Advance by STEP_S; return the upward acceleration (m/s^2) at a vehicle's position."""
        height = max(0.0, surface.position[2] - position[2] - self.ORIGIN_HEIGHT_M)
        share = self._share * (self.ROTOR_HEIGHT_M / (self.ROTOR_HEIGHT_M + height)) ** 2
        self._taken_back += (share - self._taken_back) * STEP_S / self.INTEGRAL_S
        return GRAVITY * (share - self._taken_back)
