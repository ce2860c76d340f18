"""The plan after the pad went out of sight: hold, climb, search, hand back.

Meanwhile the camera looks where the pad should be, and then sweeps (guidance.aim).
"""

import math

from landerd.config.models import LostSection
from landerd.geometry import ZERO, Vec3
from landerd.guidance import pilot_texts

# A search that begins so soon after the last one, s, goes on with its climb: with the gimbal's yaw
# reversed, sight came back for 0.1 to 3 s twenty times in two minutes, and the vehicle, which had
# begun 5 m up, was 30 m up in the end.
RESUMES_S = 10.0


class LostPlan:
    """Hold for a while, climb to see more, hold there, and hand back when the time is over."""

    def __init__(self, options: LostSection) -> None:
        self.configure(options)
        self._since = 0.0
        self._stepped_t = -math.inf  # last control step of a search, s
        # Lowest local z since the first of searches that follow one another, m; None: unknown.
        self._lowest_down: float | None = None
        self._hold_s = 0.0

    def configure(self, options: LostSection) -> None:
        """Take new options."""
        self._options = options

    def begin(self, now: float, *, low: bool = False) -> None:
        """Start at time now (s); low: climb at once, without holding first.

        Just over a pad that may move or heave is the worst place to hover without sight.
        """
        self._since = now
        if now - self._stepped_t > RESUMES_S:
            self._lowest_down = None
        self._hold_s = 0.0 if low else self._options.hold_s

    def waited_s(self, now: float) -> float:
        """Return how long the plan has run, s."""
        return now - self._since

    def step(self, now: float, down_m: float | None) -> tuple[Vec3, str] | None:
        """Return the velocity to fly (local NED, m/s) and the step's name; None: hand back.

        Args:
            now: s.
            down_m: local z of the vehicle, m; None: not known. The climb is measured from the
                lowest one that is known.
        """
        o = self._options
        self._stepped_t = now
        waited = self.waited_s(now)
        if waited > o.give_up_s:
            return None
        climbed = 0.0
        if down_m is not None:
            lowest = down_m if self._lowest_down is None else max(self._lowest_down, down_m)
            self._lowest_down, climbed = lowest, lowest - down_m
        if waited < self._hold_s:
            return ZERO, pilot_texts.HOLDING
        if climbed >= o.climb_m:
            return ZERO, pilot_texts.SEARCHING
        return (0.0, 0.0, -o.climb_mps), pilot_texts.CLIMBING
