"""Measurements by their own time, interpolated to the time of an exposure (thesis 2.3.6).

A picture is some 100 ms old when its markers are found; the attitude and gimbal angles that belong
to it are those at its exposure, not the newest ones.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from functools import lru_cache

from landerd.geometry import wrap

KEEP_S = 1.0  # how far back measurements are kept
CUT_BLOCK = 32  # entries, under a second of the fastest stream; chosen by hand
# Angles are extrapolated by their rates for this long at most, s: two periods of a stream of 20 Hz.
# A swinging airframe reverses within a quarter of a second.
ANGLES_AHEAD_S = 0.1

Values = tuple[float, ...]


class History:
    """The last second of one kind of measurement, each a fixed number of floats.

    Where rates come with them, values between two measurements lie on the cubic that has both
    (Hermite interpolation): at 25 Hz a straight line through the attitude of a nimble airframe is
    off by half a degree.

    Attributes:
        newest: time (s) and values of the newest measurement; None: there is none.
        newest_rates: its rates of change, per s; empty without rates.
    """

    def __init__(
        self,
        *,
        angles: int,
        max_gap_s: float = 0.2,
        rates: Callable[[Values], Values] | None = None,
        ahead_s: float = ANGLES_AHEAD_S,
        held_s: float | None = None,
    ) -> None:
        """Make an empty history.

        Args:
            angles: how many of the values, from the first, are angles that wrap, rad.
            max_gap_s: longest gap between two measurements that is interpolated over.
            rates: returns the rates of change of the first few values, per s; None: not known.
            ahead_s: how long values are extrapolated by their rates; then they are held.
            held_s: how long after the newest measurement values are known; None: max_gap_s.
        """
        self._rates = rates
        self._ahead_s = ahead_s
        self._held_s = max_gap_s if held_s is None else held_s
        self._angles = angles
        self.max_gap_s = max_gap_s
        self.newest: tuple[float, Values] | None = None
        self.newest_rates: Values = ()
        self._times: list[float] = []
        self._values: list[Values] = []
        self._slopes: list[Values] = []  # the rates of each, reckoned once; empty without rates
        # The same few times about an exposure are asked for again and again, and what lies between
        # two measurements stays what it is.
        self._between = lru_cache(maxsize=8)(self._interpolated)

    def just_before(self, t: float) -> tuple[float, Values] | None:
        """Return the age at t (s) of the newest measurement, and its values.

        None where it is not older than t, or by more than max_gap_s.
        """
        dt = self.age(t)
        return (dt, self._values[-1]) if 0.0 < dt <= self.max_gap_s else None

    def since(self, t: float) -> list[tuple[float, tuple[float, ...]]]:
        """Return time and values of the measurements after t, as far back as they are kept."""
        first = bisect_right(self._times, t)
        return list(zip(self._times[first:], self._values[first:], strict=True))

    def age(self, now: float) -> float:
        """Return the age of the newest measurement at time now, s; infinite without one."""
        return now - self.newest[0] if self.newest is not None else float("inf")

    def add(self, t: float, values: Values) -> bool:
        """Add a measurement; one that is not newer than the last is refused (False)."""
        if self._times and t <= self._times[-1]:
            return False
        self.newest = (t, values)
        self._times.append(t)
        self._values.append(values)
        if self._rates is not None:
            self.newest_rates = self._rates(values)
            self._slopes.append(self.newest_rates)
        first = bisect_left(self._times, t - KEEP_S)
        # Cut in blocks: removing one entry a message from the front would move the whole list.
        if first > CUT_BLOCK:
            del self._times[:first]
            del self._values[:first]
            del self._slopes[:first]
        return True

    def clear(self) -> None:
        """Forget all measurements, as after a restart of the source."""
        self._between.cache_clear()
        self.newest, self.newest_rates = None, ()
        self._times.clear()
        self._values.clear()
        self._slopes.clear()

    def at(self, t: float) -> Values | None:
        """Return the values at time t (s), None where the measurements do not reach."""
        if not self._times or t < self._times[0]:
            return None
        if t > self._times[-1]:
            return self._ahead(t) if t - self._times[-1] <= self._held_s else None
        return self._between(t)

    def _interpolated(self, t: float) -> Values | None:
        i = bisect_left(self._times, t)
        if self._times[i] == t:
            return self._values[i]
        t0, t1 = self._times[i - 1], self._times[i]
        if t1 - t0 > self.max_gap_s:
            return None
        dt = t1 - t0
        k = (t - t0) / dt
        before, after = self._values[i - 1], self._values[i]
        steps = self._wrapped([b - a for a, b in zip(before, after, strict=True)])
        line = [a + k * step for a, step in zip(before, steps, strict=True)]
        if self._slopes:
            # What the cubic adds to the line: shares of the step and of the rates at both ends.
            bend = k * (1.0 - k)
            of_step = bend * (2.0 * k - 1.0)
            of_first, of_last = bend * (1.0 - k) * dt, bend * k * dt
            first, last = self._slopes[i - 1], self._slopes[i]
            for j, (u, v) in enumerate(zip(first, last, strict=True)):
                line[j] = line[j] + of_step * steps[j] + of_first * u - of_last * v
        return self._wrapped(line)

    def _ahead(self, t: float) -> Values:
        """Return the values at a time after the newest measurement."""
        values = self._values[-1]
        if not self._slopes:
            return values
        dt = min(t - self._times[-1], self._ahead_s)
        on = [value + dt * rate for value, rate in zip(values, self.newest_rates, strict=False)]
        return self._wrapped([*on, *values[len(on) :]])

    def _wrapped(self, values: list[float]) -> Values:
        """Return values whose angles are wrapped, in place."""
        for j in range(self._angles):
            if not -math.pi < values[j] <= math.pi:  # a call takes longer than the question
                values[j] = wrap(values[j])
        return tuple(values)
