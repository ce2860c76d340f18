"""Tells whether a touched pad carries the vehicle: then the vehicle's own velocity is the pad's.

When the vehicle's velocity departs from the pad's known one, either the pad has changed its
velocity (it brakes, starts or jerks) and carries the vehicle, or wind pushes the vehicle across a
pad that drives on. The filter's estimate is too late to tell which; unfiltered sight tells: a pad
that carries the vehicle stays where it is under the feet.
"""

import math

from landerd.estimation.observation import PadFix
from landerd.geometry import Vec3, horizontal, sub

# Displacement of the pad under the feet, expected by its known velocity, from which on sight is
# consulted, m. Less is within the error of sight: the touch turns the airframe faster than the
# lens's direction is known, and two degrees at half a metre are 2 cm.
TELLS_M = 0.03
STAYS_SHARE = 0.5  # share of it that the pad may be seen to move and still count as staying
# Expected displacement after which a pad that is seen to move certainly did, m. The comparison then
# starts afresh: a vehicle that slid across a braking pad may stand on it now.
MOVES_M = 0.06


class SlipDetector:
    """Compares the fixes of the pad from contact on.

    Attributes:
        is_carried: the vehicle moves with the pad, at another velocity than the pad's known one.
    """

    def __init__(self) -> None:
        self.begin(math.inf)

    def begin(self, t: float) -> None:
        """Start when the feet have touched, at time t (s)."""
        self.is_carried = False
        self._touched_t = t
        self._first: PadFix | None = None  # the first since then
        self._last: PadFix | None = None
        self._from: PadFix | None = None  # the one that the newest is compared with
        self._known = (0.0, 0.0)  # expected displacement of the pad under the feet since that, m

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
            pad_velocity: as known before contact, local, m/s.
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
