"""How healthy the estimate is: whether sightings fit what is known, and how old they are in use.

A filter's normalised innovation squared (NIS) is chi-square of 3 degrees of freedom while its
assumptions hold, so 3 on average (Bar-Shalom, Li and Kirubarajan 2001, 5.4); over a window of
sightings it tells sooner than a landing does that they do not.
"""

import math
from collections import deque
from dataclasses import dataclass

WINDOW_S = 2.0
NIS_EXPECTED = 3.0  # of three coordinates


@dataclass(frozen=True, slots=True)
class Health:
    """Figures of some sightings in a row."""

    sightings: int  # that could be compared with what was expected
    nis: float  # mean, NIS_EXPECTED where all is well; each counts for the limit at most
    refused: float  # share of them
    picture_age_s: float  # mean, from exposure to the first control step that knew of the picture


class _Sums:
    """Sums over sightings and pictures, of which some may be taken out again."""

    def __init__(self) -> None:
        self.sightings = self.refused = self.pictures = 0
        self.nis = self.age_s = 0.0

    def sighting(self, nis: float, *, refused: bool, times: int = 1) -> None:
        """Count a sighting in, or with `times` -1 out."""
        self.sightings += times
        self.refused += times * refused
        self.nis += times * nis

    def picture(self, age_s: float, times: int = 1) -> None:
        """Count a picture in, or with `times` -1 out."""
        self.pictures += times
        self.age_s += times * age_s

    @property
    def health(self) -> Health | None:
        if self.sightings == 0 or self.pictures == 0:
            return None
        n = self.sightings
        return Health(n, self.nis / n, self.refused / n, self.age_s / self.pictures)


class HealthMonitor:
    """Counts sightings and pictures, over the last WINDOW_S and over the flight."""

    def __init__(self, nis_limit: float) -> None:
        """Make it; a sighting beyond the limit says no more than one at it."""
        self._nis_limit = nis_limit
        self._flight, self._newest = _Sums(), _Sums()
        self._sightings: deque[tuple[float, float, bool]] = deque()  # exposure, NIS, refused
        self._pictures: deque[tuple[float, float]] = deque()  # control step, age
        self._picture_t = -math.inf

    def on_sighting(self, t: float, nis: float, *, refused: bool) -> None:
        """Count a sighting, exposed at t (s), that was compared with what was expected."""
        nis = min(nis, self._nis_limit)
        self._sightings.append((t, nis, refused))
        for sums in (self._flight, self._newest):
            sums.sighting(nis, refused=refused)

    def on_tick(self, now: float, picture_t: float) -> None:
        """Take a control step: what the newest picture, exposed at picture_t (s), may fly first."""
        if self._picture_t < picture_t:
            self._picture_t = picture_t
            age_s = now - picture_t
            self._pictures.append((now, age_s))
            for sums in (self._flight, self._newest):
                sums.picture(age_s)
        while self._sightings and self._sightings[0][0] < now - WINDOW_S:
            _, nis, refused = self._sightings.popleft()
            self._newest.sighting(nis, refused=refused, times=-1)
        while self._pictures and self._pictures[0][0] < now - WINDOW_S:
            self._newest.picture(self._pictures.popleft()[1], times=-1)

    @property
    def newest(self) -> Health | None:
        """Of the last WINDOW_S; None without sightings that could be compared."""
        return self._newest.health

    @property
    def flight(self) -> Health | None:
        """Of all so far; None as before."""
        return self._flight.health
