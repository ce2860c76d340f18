"""Detects a restart of the autopilot by its time since boot."""

import math
from enum import Enum, auto

from hw.autopilots.boot_clock import WRAP_S

# Boot time going back by more than this is a restart, and one so far off fits no other: a stamp may
# be wrong once. Two in a row are believed, and a TIMESYNC that answers us.
_RESTART_S = 1.0


class Boot(Enum):
    """What a time since boot says of the boot that it counts from."""

    SAME = auto()
    WRAPPED = auto()  # the same, whose stamps had begun anew before any was heard
    NEW = auto()  # the autopilot has restarted
    UNKNOWN = auto()  # the boot time does not fit


class RestartDetector:
    """Judges every time since boot that is received."""

    def __init__(self) -> None:
        self._last_s = -math.inf  # the newest boot time of this boot
        self._last_t = -math.inf  # when that was heard
        self._suspected: float | None = None  # boot time less loop time, that did not fit; s

    def hear(self, boot_s: float, now: float, *, is_answer: bool = False) -> Boot:
        """Take a boot time; tell what it says.

        Args:
            boot_s: that is heard.
            now: s.
            is_answer: to our own TIMESYNC.
        """
        boot = Boot.SAME
        expected = self._last_s + now - self._last_t
        if is_answer and math.isfinite(expected):
            # Stamps of 32 bits that had begun anew before any was heard: only an answer says so.
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
