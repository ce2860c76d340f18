"""The attempts at landing: how long one takes, how many were broken off, how the last ended."""

import math

from landerd.config.models import LostSection


class Attempts:
    """Counts what guidance.lost limits: descents broken off, and the time of a landing.

    Attributes:
        outcome: of the last landing, None while none has ended.
        aborts: how often a descent was broken off, or sight of the pad was lost while flying.
        tracked_t: when the vehicle last flew by sight of the pad, s; -inf: not since an abort.
    """

    def __init__(self, options: LostSection) -> None:
        self.configure(options)
        self.outcome: str | None = None
        self.aborts = 0
        self.tracked_t = -math.inf
        self._began = math.inf  # start of a landing that has not come to commit, s
        self._descents_broken_off = 0

    def configure(self, options: LostSection) -> None:
        """Take changed parameters."""
        self._options = options

    def begin(self, now: float) -> None:
        """Start the time that a landing may take, unless it runs already."""
        self._began = min(self._began, now)

    def end(self) -> None:
        """Stop that time: the landing has come to commit, or is over."""
        self._began = math.inf

    def takes_too_long(self, now: float) -> bool:
        """Tell whether the landing should have come to commit by now (s)."""
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
        """Reset both counts: the pilot flies, or has asked to hold."""
        self._descents_broken_off = 0
        self.end()

    def finish(self, outcome: str) -> None:
        """Keep the first outcome of a landing: what follows is its consequence."""
        if self.outcome is None:
            self.outcome = outcome
