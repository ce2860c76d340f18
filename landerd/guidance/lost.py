"""The plan after the pad went out of sight: hold, climb, search, hand back.

Meanwhile the camera looks where the pad should be, and then sweeps (guidance.aim).
"""

from landerd.config.models import LostSection
from landerd.geometry import ZERO, Vec3
from landerd.guidance import pilot_texts


class LostPlan:
    """Hold for a while, climb to see more, hold there, and hand back when the time is over."""

    def __init__(self, options: LostSection) -> None:
        self.configure(options)
        self._since = 0.0
        self._start_down: float | None = None  # local z at the start of the climb, m; None: unknown
        self._hold_s = 0.0

    def configure(self, options: LostSection) -> None:
        """Take new options."""
        self._options = options

    def begin(self, now: float, *, low: bool = False) -> None:
        """Start at time now (s); low: climb at once, without holding first.

        Just over a pad that may move or heave is the worst place to hover without sight.
        """
        self._since = now
        self._start_down = None
        self._hold_s = 0.0 if low else self._options.hold_s

    def waited_s(self, now: float) -> float:
        """Return how long the plan has run, s."""
        return now - self._since

    def step(self, now: float, down_m: float | None) -> tuple[Vec3, str] | None:
        """Return the velocity to fly (local NED, m/s) and the step's name; None: hand back.

        Args:
            now: s.
            down_m: local z of the vehicle, m; None: not known. The climb is measured from the first
                one that is known.
        """
        o = self._options
        waited = self.waited_s(now)
        if waited > o.give_up_s:
            return None
        if self._start_down is None:
            self._start_down = down_m
        climbed = 0.0 if self._start_down is None or down_m is None else self._start_down - down_m
        if waited < self._hold_s:
            return ZERO, pilot_texts.HOLDING
        if climbed >= o.climb_m:
            return ZERO, pilot_texts.SEARCHING
        return (0.0, 0.0, -o.climb_mps), pilot_texts.CLIMBING
