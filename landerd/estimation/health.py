"""Health of the estimate: do sightings fit their prediction, and how old are they when used?

A filter's normalised innovation squared (NIS) is chi-square with 3 degrees of freedom while its
assumptions hold, so 3 on average (Bar-Shalom, Li and Kirubarajan 2001, 5.4). Its mean over a window
of sightings shows that they do not hold before a landing goes wrong.
"""

import math
from collections import deque
from dataclasses import dataclass

WINDOW_S = 2.0
NIS_EXPECTED = 3.0  # of three coordinates


@dataclass(frozen=True, slots=True)
class Health:
    """Figures of consecutive sightings."""

    sightings: int  # how many could be compared with a prediction
    nis: float  # their mean NIS, each cut at the limit; NIS_EXPECTED where all is well
    refused: float  # share of them that the filter refused, 0 to 1
    picture_age_s: float  # mean time from exposure to the first control step that used the picture


class _Sums:
    """Running sums over sightings and pictures, which can be taken out again."""

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
        """Make one; each NIS is cut at nis_limit, so that one outlier does not make the mean."""
        self._nis_limit = nis_limit
        self._flight, self._newest = _Sums(), _Sums()
        self._sightings: deque[tuple[float, float, bool]] = deque()  # exposure, NIS, refused
        self._pictures: deque[tuple[float, float]] = deque()  # control step, age
        self._picture_t = -math.inf

    def on_sighting(self, t: float, nis: float, *, refused: bool) -> None:
        """Count a sighting, exposed at t (s), that was compared with a prediction."""
        nis = min(nis, self._nis_limit)
        self._sightings.append((t, nis, refused))
        for sums in (self._flight, self._newest):
            sums.sighting(nis, refused=refused)

    def on_tick(self, now: float, picture_t: float) -> None:
        """Take a control step; picture_t: exposure of the newest picture it knows of, s."""
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
