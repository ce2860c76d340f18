"""Measurements over time, as a recording has them."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise

from landerd.geometry import wrap

MAX_GAP_S = 1.5  # measurements farther apart are not interpolated between
LONG_GAP_S = 5.0

Span = tuple[float, float]  # from when to when, s


class Track:
    """One kind of measurement over time."""

    def __init__(self, *, angles: int = 0, most: float = math.inf) -> None:
        """Begin empty.

        Args:
            angles: the first so many values are angles that wrap, rad.
            most: a value of larger magnitude is damage and not a measurement.
        """
        self.times: list[float] = []
        self.values: list[tuple[float, ...]] = []
        self._angles = angles
        self._most = most
        self._doubtful: tuple[float, tuple[float, ...]] | None = None

    def add(self, t: float, values: tuple[float, ...]) -> None:
        """Add a measurement; what is no number, or not newer than the last, is left out.

        After a long gap a second one must confirm the time: damage in a log makes any number.
        """
        if not (math.isfinite(t) and all(map(self._is_possible, values))):
            return
        if self.times and t <= self.times[-1]:
            return
        doubtful, self._doubtful = self._doubtful, None
        if not self.times or t - self.times[-1] > LONG_GAP_S:
            if doubtful is None or not 0.0 < t - doubtful[0] < LONG_GAP_S:
                self._doubtful = (t, values)
                return
            self.times.append(doubtful[0])
            self.values.append(doubtful[1])
        self.times.append(t)
        self.values.append(values)

    def _is_possible(self, value: float) -> bool:
        return math.isfinite(value) and abs(value) <= self._most

    def at(self, t: float) -> tuple[float, ...] | None:
        """Return the values at time t, interpolated; None where the track does not reach."""
        i = bisect_right(self.times, t)
        if i == 0 or i == len(self.times):
            exact = i > 0 and self.times[-1] == t
            return self.values[-1] if exact else None
        t0, t1 = self.times[i - 1], self.times[i]
        if t1 - t0 > MAX_GAP_S:
            return None
        k = (t - t0) / (t1 - t0)
        pairs = enumerate(zip(self.values[i - 1], self.values[i], strict=True))
        return tuple(
            wrap(a + k * wrap(b - a)) if n < self._angles else a + k * (b - a)
            for n, (a, b) in pairs
        )

    def within(self, span: Span) -> slice:
        """Return which measurements fall into a span."""
        return slice(bisect_left(self.times, span[0]), bisect_right(self.times, span[1]))

    def rate_hz(self, spans: Sequence[Span]) -> float:
        """Return how many measurements a second there are within spans.

        Gaps that are not interpolated over are no part of it: they are said in `covered_s`.
        """
        count, length = self._steps(spans)
        return count / length if length > 0.0 else 0.0

    def covered_s(self, spans: Sequence[Span]) -> float:
        """Return for how long within spans the values are known, s."""
        return self._steps(spans)[1]

    def _steps(self, spans: Sequence[Span]) -> tuple[int, float]:
        """Return number and length, s, of the steps that are interpolated over."""
        count, length = 0, 0.0
        for span in spans:
            times = self.times[self.within(span)]
            for a, b in pairwise(times):
                if b - a <= MAX_GAP_S:
                    count, length = count + 1, length + b - a
        return count, length
