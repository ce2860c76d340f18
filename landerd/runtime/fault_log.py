"""Counts what goes wrong while the daemon runs, and logs it at a bounded rate."""

import asyncio
import logging
import math
from collections import Counter

log = logging.getLogger("landerd")

EVERY_S = 1.0  # shortest time between two log lines of a kind
AWAY_S = 60.0  # the same for a device that stays lost for the same reason


class FaultLog:
    """Counts faults by kind, and knows which devices are lost.

    Attributes:
        counts: number of faults by kind.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._logged: dict[str, float] = {}  # loop time (s) of the last log line, by kind
        self._away: dict[str, str] = {}  # reason by device that was logged as lost

    def add(self, kind: str, detail: str) -> None:
        """Count a bad input or a failure; log it unless its kind was logged within EVERY_S."""
        self.counts[kind] += 1
        if self._is_due(kind, EVERY_S):
            log.warning("%s: %s (%d so far)", kind, detail, self.counts[kind])

    def lose(self, device: str, reason: str) -> None:
        """Count the loss of a device; log it if it or its reason is new, else every AWAY_S."""
        self.counts[f"{device} lost"] += 1
        if self._is_due(device, AWAY_S if self._away.get(device) == reason else EVERY_S):
            self._away[device] = reason
            log.warning("%s lost: %s", device, reason)

    def find(self, device: str) -> None:
        """Log that a lost device is back."""
        if self._away.pop(device, None) is not None:
            log.info("%s is back", device)

    def _is_due(self, what: str, every_s: float) -> bool:
        """Tell whether a kind is to be logged: not within every_s; then it counts as logged now."""
        now = asyncio.get_running_loop().time()
        is_due = now - self._logged.get(what, -math.inf) >= every_s
        if is_due:
            self._logged[what] = now
        return is_due
