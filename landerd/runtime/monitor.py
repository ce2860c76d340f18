"""Watches that nothing holds up the event loop."""

import asyncio
import logging
import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

log = logging.getLogger("landerd")

GAP_S = 0.05  # without the loop for longer than this a set-point is late (rule 3)
LOG_EVERY_S = 1.0  # each place is logged at most so often


class LoopMonitor:
    """Counts and logs gaps of the loop with the place where they arose.

    Attributes:
        gaps: longer than GAP_S, by place.
        longest_s: of them.
    """

    def __init__(self) -> None:
        self.gaps: Counter[str] = Counter()
        self.longest_s = 0.0
        self._told_t = 0.0  # until then all gaps are counted
        self._logged: dict[str, float] = {}

    @contextmanager
    def at(self, place: str) -> Iterator[None]:
        """Watch what is done in the block, in which nothing may be awaited."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        try:
            yield
        finally:
            if loop.time() - began > GAP_S:
                self._note(place, began, loop.time())

    def woke(self, due: float) -> float:
        """Say that a task that was due then (loop time, s) has its turn now.

        Returns:
            The gap, s; 0 if there was none.
        """
        now = asyncio.get_running_loop().time()
        if now - due <= GAP_S:
            return 0.0
        if due > self._told_t - GAP_S:
            self._note("elsewhere, or the computer was busy", due, now)
        return now - due

    def _note(self, place: str, began: float, ended: float) -> None:
        self.gaps[place] += 1
        self.longest_s = max(self.longest_s, ended - began)
        self._told_t = ended
        if ended - self._logged.get(place, -math.inf) >= LOG_EVERY_S:
            self._logged[place] = ended
            gap_ms = 1e3 * (ended - began)
            log.warning("held up for %.0f ms: %s (%d so far)", gap_ms, place, self.gaps[place])
