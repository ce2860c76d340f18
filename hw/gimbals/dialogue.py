"""Requests and answers of a gimbal that sends its angles on request only."""

import asyncio
import logging
from collections import deque
from collections.abc import Callable

from hw.gimbals.frames import FrameScanner
from landerd.ports import ByteLink, DeviceLost

log = logging.getLogger(__name__)

SILENCE_S = 1.0  # longer than any pause of a healthy gimbal; after it the link is reopened
PAUSE_S = 0.3  # shorter than any gimbal takes to restart; after it the gimbal is set up again
_LOG_S = 1.0


class Dialogue:
    """Sends requests at a fixed rate and returns the frames received."""

    def __init__(
        self,
        who: str,
        link: ByteLink,
        scanner: FrameScanner,
        ask: Callable[[], None],
        rate_hz: float,
    ) -> None:
        """Make one; ask: sends one request, called rate_hz times a second while `frame` waits."""
        self._who, self._link, self._scanner = who, link, scanner
        self._ask, self._period = ask, 1.0 / rate_hz
        self._frames: deque[tuple[float, bytes]] = deque()
        self._due = self._answered = self._logged = 0.0
        self._is_new = True
        self._told = 0

    async def open(self) -> None:
        """Open the link. Raises DeviceLost."""
        await self._link.open()
        self._scanner.reset()
        self._frames.clear()
        self._due = self._answered = asyncio.get_running_loop().time()
        self._is_new = True

    async def frame(self) -> tuple[float, bytes]:
        """Wait for the next frame and return the loop time of its arrival and its bytes.

        Raises DeviceLost, also after SILENCE_S without an answer (see `answered`).
        """
        loop = asyncio.get_running_loop()
        while not self._frames:
            now = loop.time()
            if now - self._answered > SILENCE_S:
                raise DeviceLost(f"{self._who}: no answer for {SILENCE_S:.0f} s")
            if now >= self._due:
                self._due = max(self._due + self._period, now)
                self._ask()
            try:
                async with asyncio.timeout_at(self._due):
                    data = await self._link.read()
            except TimeoutError:
                continue
            now = loop.time()
            self._frames.extend((now, frame) for frame in self._scanner.feed(data))
            self._tell(now)
        return self._frames.popleft()

    def answered(self, t: float) -> bool:
        """Note that a frame that arrived at time t (s) was an answer.

        Returns True for the first answer and the first after a pause: the gimbal may have been
        switched on or have restarted, and must be set up.
        """
        is_new = self._is_new or t - self._answered > PAUSE_S
        self._answered, self._is_new = t, False
        return is_new

    def send(self, frame: bytes) -> None:
        """Send a frame; a lost link drops it silently."""
        self._link.write(frame)

    async def close(self) -> None:
        """Close the link; safe to call twice."""
        await self._link.close()

    def _tell(self, now: float) -> None:
        garbled = self._scanner.counters["garbled bytes"]
        if garbled > self._told and now - self._logged >= _LOG_S:
            self._told, self._logged = garbled, now
            log.warning("%s: %d garbled bytes so far", self._who, garbled)
