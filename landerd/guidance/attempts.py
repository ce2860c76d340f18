"""The attempts at landing: how long one takes, how many were broken off, how the last ended."""

import math

from landerd.config.models import LostSection


class Attempts:
    """Counts what guidance.lost limits, until the pilot flies or waits.

    Attributes:
        outcome: of the last landing, None while none has ended.
        aborts: times a descent was broken off, or the pad went out of sight while flying.
        tracked_t: when it was flown by sight of the pad last, s; -inf: not since it was broken off.
    """

    def __init__(self, options: LostSection) -> None:
        self.configure(options)
        self.outcome: str | None = None
        self.aborts = 0
        self.tracked_t = -math.inf
        self._began = math.inf  # the landing, without having come to commit since, s
        self._descents_broken_off = 0

    def configure(self, options: LostSection) -> None:
        """Take changed parameters."""
        self._options = options

    def begin(self, now: float) -> None:
        """Take the time that a landing may take from now on, unless it runs already."""
        self._began = min(self._began, now)

    def end(self) -> None:
        """Take no more time: the landing has come to commit, or is over."""
        self._began = math.inf

    def takes_too_long(self, now: float) -> bool:
        """Tell whether the landing should have come to commit by now."""
        return now - self._began > self._options.total_s

    def break_off(self, *, is_descent: bool) -> None:
        """Count an abort; those of descents are limited in number (guidance.lost.retries)."""
        self.tracked_t = -math.inf
        self.aborts += 1
        if is_descent:
            self._descents_broken_off += 1

    @property
    def tried_enough(self) -> bool:
        """Whether more descents were broken off than are allowed."""
        return self._descents_broken_off > self._options.retries

    def forgive(self) -> None:
        """Count broken-off descents and the landing's time anew: the pilot flies, or waits."""
        self._descents_broken_off = 0
        self.end()

    def finish(self, outcome: str) -> None:
        """Keep the first outcome of a landing: what follows is its consequence."""
        if self.outcome is None:
            self.outcome = outcome
