"""A device that answers requests on a byte link, and what can go wrong with it."""

import asyncio
from abc import ABC, abstractmethod
from random import Random

from hw.gimbals.frames import FrameScanner
from hw.sim.gimbals.mount import SimMount
from landerd.ports import ByteLink, DeviceLost

_TURNAROUND_S = 0.002  # from a request to the first byte of its answer
_BYTE_S = 10.0 / 115200.0  # on the line, at 115200 baud
_BOOT_S = 3.0  # deaf and dumb after a restart
_REOPEN_S = 0.1


class ByteModel(ABC):
    """Takes requests, moves the gimbal, answers.

    Attributes:
        silent: it hears and obeys but says nothing.
        garbage: it answers with as many random bytes.
        late_s: its answers come so much later.
        mount: the gimbal it moves.
    """

    def __init__(self, mount: SimMount, link: ByteLink, scanner: FrameScanner) -> None:
        self.silent = False
        self.garbage = False
        self.late_s = 0.0
        self.mount = mount
        self._link, self._scanner = link, scanner
        self._rng = Random(0)
        self._boots_until = 0.0

    def reset(self) -> None:
        """Restart, as after a brown-out: deaf and dumb for a while, then as freshly switched on."""
        self._boots_until = asyncio.get_running_loop().time() + _BOOT_S
        self._scanner.reset()
        self._booted()

    async def run(self) -> None:
        """Be the device until cancelled."""
        loop = asyncio.get_running_loop()
        try:
            while True:
                try:
                    await self._link.open()
                    while True:
                        data = await self._link.read()
                        if loop.time() < self._boots_until:
                            continue
                        for frame in self._scanner.feed(data):
                            self.mount.advance()
                            self._take(frame)
                except DeviceLost:
                    await asyncio.sleep(_REOPEN_S)
        finally:
            await self._link.close()

    @abstractmethod
    def _take(self, frame: bytes) -> None:
        """Obey and answer one sound frame."""

    @abstractmethod
    def _booted(self) -> None:
        """Forget what was set up over the link."""

    def _answer(self, frame: bytes) -> None:
        if self.silent:
            return
        if self.garbage:
            frame = self._rng.randbytes(len(frame))
        delay = self.late_s + _TURNAROUND_S + len(frame) * _BYTE_S
        asyncio.get_running_loop().call_later(delay, self._link.write, frame)
