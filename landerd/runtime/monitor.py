"""Detects what holds up the event loop."""

import asyncio
import logging
import math
import sys
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType

log = logging.getLogger("landerd")

GAP_S = 0.05  # a longer gap of the loop makes a set-point late (rule 3)
LOG_EVERY_S = 1.0  # shortest time between two log lines on one place
BUSY = "elsewhere, or the computer was busy"
_LOOKS_S = 0.5 * GAP_S
_ROOT = Path(__file__).resolve().parents[2]  # the folder that contains landerd and hw


class LoopMonitor:
    """Counts and logs gaps of the loop with the place where they arose.

    Attributes:
        gaps: number of gaps longer than GAP_S, by place.
        longest_s: the longest gap, s.
    """

    def __init__(self) -> None:
        self.gaps: Counter[str] = Counter()
        self.longest_s = 0.0
        self._told_t = 0.0  # end of the last gap that was counted, s
        self._logged: dict[str, float] = {}
        self._onlooker: _Onlooker | None = None

    def look_on(self) -> None:
        """Start a thread that samples what the loop's thread is doing while the loop is held up."""
        self._onlooker = _Onlooker(asyncio.get_running_loop())
        self._onlooker.start()

    def close(self) -> None:
        """End the thread; safe to call without one."""
        if self._onlooker is not None:
            self._onlooker.over.set()
            self._onlooker = None

    def at(self, place: str) -> "_Block":
        """Return a context manager that times a block, in which nothing may be awaited."""
        return _Block(self.note, place)

    def woke(self, due: float) -> float:
        """Note that a task due at a loop time (s) runs now.

        Returns:
            how late it is, s; 0 if by no more than GAP_S.
        """
        now = asyncio.get_running_loop().time()
        seen = self._onlooker.turned(now) if self._onlooker is not None else None
        if now - due <= GAP_S:
            return 0.0
        if due > self._told_t - GAP_S:
            self.note(seen or BUSY, due, now)
        return now - due

    def note(self, place: str, began: float, ended: float) -> None:
        """Count a gap between two loop times (s); log each place at most every LOG_EVERY_S."""
        self.gaps[place] += 1
        self.longest_s = max(self.longest_s, ended - began)
        self._told_t = ended
        if ended - self._logged.get(place, -math.inf) >= LOG_EVERY_S:
            self._logged[place] = ended
            gap_ms = 1e3 * (ended - began)
            log.warning("held up for %.0f ms: %s (%d so far)", gap_ms, place, self.gaps[place])


class _Block:
    """Times a block of code; a class, as a generator is slower and one is made per message."""

    __slots__ = ("_began", "_loop", "_note", "_place")

    def __init__(self, note: Callable[[str, float, float], None], place: str) -> None:
        self._note, self._place = note, place

    def __enter__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._began = self._loop.time()

    def __exit__(self, *error: object) -> None:
        ended = self._loop.time()
        if ended - self._began > GAP_S:
            self._note(self._place, self._began, ended)


class _Onlooker(threading.Thread):
    """Samples the stack of the loop's thread when the loop has not turned for GAP_S.

    Attributes:
        over: set it to end the thread.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Called in the loop's thread."""
        super().__init__(name="onlooker", daemon=True)
        self.over = threading.Event()
        self._loop = loop
        self._watched = threading.get_ident()
        self._turned_t = math.inf
        self._seen: str | None = None

    def turned(self, now: float) -> str | None:
        """Note that the loop turns now (s); return where it was held up since the last turn."""
        seen, self._seen = self._seen, None
        self._turned_t = now
        return seen

    def run(self) -> None:
        """Sample until `over` is set."""
        while not self.over.wait(_LOOKS_S):
            if self._loop.time() - self._turned_t > GAP_S:
                self._seen = _place(sys._current_frames().get(self._watched)) or self._seen


def _place(frame: FrameType | None) -> str | None:
    """Return the innermost place in landerd's own code; None where the loop only waits."""
    while frame is not None and frame.f_code.co_name != "_run_once":
        file = Path(frame.f_code.co_filename)
        if file.is_relative_to(_ROOT):
            return f"{file.relative_to(_ROOT)}:{frame.f_lineno} {frame.f_code.co_name}"
        frame = frame.f_back
    return None
