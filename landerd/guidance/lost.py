"""What is done after the pad went out of sight: hover and look, climb, search, hand back.

The camera looks where the pad should be and then sweeps (guidance.aim), whatever is flown.
"""

from landerd.config.models import LostSection
from landerd.geometry import ZERO, Vec3
from landerd.guidance import pilot_texts


class LostPlan:
    """Hold, then climb to see more, then hand back; every step has its time."""

    def __init__(self, options: LostSection) -> None:
        self.configure(options)
        self._since = 0.0
        self._start_down: float | None = None  # local z where that was, m; None: not known yet
        self._hold_s = 0.0

    def configure(self, options: LostSection) -> None:
        """Take new options."""
        self._options = options

    def begin(self, now: float, *, low: bool = False) -> None:
        """Start at time now, s; low: climb without holding first.

        Just over a pad that may move or heave a hover without sight is the worst place to wait.
        """
        self._since = now
        self._start_down = None
        self._hold_s = 0.0 if low else self._options.hold_s

    def waited_s(self, now: float) -> float:
        """Return for how long it has been out of sight, s."""
        return now - self._since

    def step(self, now: float, down_m: float | None) -> tuple[Vec3, str] | None:
        """Return the velocity to fly (local NED) and the step's name; None: hand back.

        `down_m` is the vehicle's local z, None while that is not known: it climbs from where it was
        known first.
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
