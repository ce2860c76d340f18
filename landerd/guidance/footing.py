"""Whether the vehicle goes with the pad that it touches: then its own velocity is the pad's.

A pad that brakes, starts or jerks takes along what stands on it, and what is known of its velocity
is a picture's delay and a filter old. So does wind with what slides across a pad that drives on.
Sight tells one from the other, without any filter: in one the pad stays where it is under the feet.
"""

import math

from landerd.estimation.observation import Glimpse
from landerd.geometry import Vec3, horizontal, sub

# The pad is to have moved so far under the feet, by what is known of its velocity, before sight is
# asked, m. The touch turns the airframe faster than the lens's direction is known: two degrees, at
# half a metre, are 2 cm.
TELLS_M = 0.03
STAYS_SHARE = 0.5  # of that, by which it may be seen to have moved and stays all the same
# Seen to move where it should have moved so far, m, it did, by more than those 2 cm. From there on
# it is looked at afresh: what has slid across a pad that brakes may stand on it now.
MOVES_M = 0.06


class Footing:
    """Looks at every glimpse of the pad from contact on.

    Attributes:
        holds: the vehicle goes with the pad, and not as the pad is known to go.
    """

    def __init__(self) -> None:
        self.begin(math.inf)

    def begin(self, t: float) -> None:
        """The feet have touched at time t, s."""
        self.holds = False
        self._touched_t = t
        self._first: Glimpse | None = None  # since then
        self._last: Glimpse | None = None
        self._from: Glimpse | None = None  # the one that the newest is compared with
        self._known = (0.0, 0.0)  # by which the pad should have moved under the feet since that, m

    @property
    def rise_m(self) -> float:
        """How far the feet are seen to have risen from the pad since they touched, m."""
        if self._first is None or self._last is None:
            return 0.0
        return self._last.to_pad[2] - self._first.to_pad[2]

    def look(self, glimpse: Glimpse, pad_velocity: Vec3) -> bool:
        """Take a glimpse of the pad; tell whether it is a new one.

        Args:
            glimpse: the newest.
            pad_velocity: as known, local, m/s.
        """
        last = self._last
        if glimpse.t < self._touched_t or (last is not None and glimpse.t <= last.t):
            return False
        self._last = glimpse
        if self._from is None or last is None:
            self._first = self._from = glimpse
            return True
        dt, feet = glimpse.t - last.t, sub(glimpse.feet, last.feet)
        north, east = self._known
        self._known = (
            north + dt * pad_velocity[0] - feet[0],
            east + dt * pad_velocity[1] - feet[1],
        )
        known_m = math.hypot(*self._known)
        stays = horizontal(sub(glimpse.to_pad, self._from.to_pad)) < STAYS_SHARE * known_m
        self.holds = stays and known_m > TELLS_M
        if known_m > MOVES_M and not stays:
            self._from, self._known = glimpse, (0.0, 0.0)
        return True
