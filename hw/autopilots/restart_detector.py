"""Detects a restart of the autopilot by its time since boot."""

import math
from enum import Enum, auto

from hw.autopilots.boot_clock import WRAP_S

# A time since boot that steps back by more than this shows a restart; one this far off either way
# is suspect, as a single stamp may be wrong. Two in a row that agree are believed, and any answer
# to our own TIMESYNC.
_RESTART_S = 1.0


class Boot(Enum):
    """What a time since boot says of the boot that it counts from."""

    SAME = auto()
    WRAPPED = auto()  # the same boot; its 32-bit stamps had wrapped before the first was received
    NEW = auto()  # the autopilot has restarted
    UNKNOWN = auto()  # it does not fit, and is not believed yet


class RestartDetector:
    """Judges every time since boot that is received."""

    def __init__(self) -> None:
        self._last_s = -math.inf  # the newest time since this boot, s
        self._last_t = -math.inf  # when that was received, s
        self._suspected: float | None = None  # the last one that did not fit, minus loop time, s

    def hear(self, boot_s: float, now: float, *, is_answer: bool = False) -> Boot:
        """Take a time since boot; tell what it says.

        Args:
            boot_s: time since boot, s.
            now: loop time, s.
            is_answer: it answers our own TIMESYNC, and is believed.
        """
        boot = Boot.SAME
        expected = self._last_s + now - self._last_t
        if is_answer and math.isfinite(expected):
            # Stamps of 32 bits had wrapped before the first was received: only an answer shows it.
            wraps = round((boot_s - expected) / WRAP_S)
            if wraps > 0 and abs(boot_s - expected - wraps * WRAP_S) < _RESTART_S:
                boot = Boot.WRAPPED
                self._last_s += wraps * WRAP_S
                expected += wraps * WRAP_S
        is_back = boot_s < self._last_s - _RESTART_S
        is_ahead = math.isfinite(expected) and boot_s > expected + _RESTART_S
        if is_ahead or (is_back and not is_answer):
            suspected, self._suspected = self._suspected, boot_s - now
            if suspected is None or abs(self._suspected - suspected) > _RESTART_S:
                return Boot.UNKNOWN
        self._suspected = None
        if is_back:
            boot = Boot.NEW
            self._last_s = boot_s
        if boot_s >= self._last_s:
            self._last_s, self._last_t = boot_s, now
        return boot
