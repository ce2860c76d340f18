"""Whether the vehicle goes with the pad that it touches: then its own velocity is the pad's.

A pad that brakes, starts or jerks takes along what stands on it, and what is known of its velocity
is a picture's delay and a filter old. So does wind with what slides across a pad that drives on.
Sight tells one from the other, without any filter: in one the pad stays where it is under the feet.
"""

import math

from landerd.estimation.observation import PadFix
from landerd.geometry import Vec3, horizontal, sub

# The pad is to have moved so far under the feet, by what is known of its velocity, before sight is
# asked, m. The touch turns the airframe faster than the lens's direction is known: two degrees, at
# half a metre, are 2 cm.
TELLS_M = 0.03
STAYS_SHARE = 0.5  # of that, by which it may be seen to have moved and stays all the same
# Seen to move where it should have moved so far, m, it did, by more than those 2 cm. From there on
# it is looked at afresh: what has slid across a pad that brakes may stand on it now.
MOVES_M = 0.06


class SlipDetector:
    """Looks at every fix of the pad from contact on.

    Attributes:
        is_carried: the vehicle goes with the pad, and not as the pad is known to go.
    """

    def __init__(self) -> None:
        self.begin(math.inf)

    def begin(self, t: float) -> None:
        """The feet have touched at time t, s."""
        self.is_carried = False
        self._touched_t = t
        self._first: PadFix | None = None  # since then
        self._last: PadFix | None = None
        self._from: PadFix | None = None  # the one that the newest is compared with
        self._known = (0.0, 0.0)  # by which the pad should have moved under the feet since that, m

    @property
    def rise_m(self) -> float:
        """How far the feet are seen to have risen from the pad since they touched, m."""
        if self._first is None or self._last is None:
            return 0.0
        return self._last.to_pad[2] - self._first.to_pad[2]

    def look(self, fix: PadFix, pad_velocity: Vec3) -> bool:
        """Take a fix of the pad; tell whether it is a new one.

        Args:
            fix: the newest.
            pad_velocity: as known, local, m/s.
        """
        last = self._last
        if fix.t < self._touched_t or (last is not None and fix.t <= last.t):
            return False
        self._last = fix
        if self._from is None or last is None:
            self._first = self._from = fix
            return True
        dt, feet = fix.t - last.t, sub(fix.feet, last.feet)
        north, east = self._known
        self._known = (
            north + dt * pad_velocity[0] - feet[0],
            east + dt * pad_velocity[1] - feet[1],
        )
        known_m = math.hypot(*self._known)
        stays = horizontal(sub(fix.to_pad, self._from.to_pad)) < STAYS_SHARE * known_m
        self.is_carried = stays and known_m > TELLS_M
        if known_m > MOVES_M and not stays:
            self._from, self._known = fix, (0.0, 0.0)
        return True
