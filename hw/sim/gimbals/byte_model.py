"""A modelled device that answers requests on a byte link, and its faults."""

import asyncio
from abc import ABC, abstractmethod
from random import Random

from hw.gimbals.frames import FrameScanner
from hw.sim.gimbals.mount import SimMount
from landerd.ports import ByteLink, DeviceLost

_TURNAROUND_S = 0.002  # time from a request to the first byte of its answer
_BYTE_S = 10.0 / 115200.0  # time of a byte on the line, at 115200 baud
_BOOT_S = 3.0  # time after a restart during which the device neither listens nor answers
_REOPEN_S = 0.1  # time until a lost link is opened again


class ByteModel(ABC):
    """A device that takes requests, moves the gimbal, and answers.

    Attributes:
        silent: fault: it obeys, but does not answer.
        garbage: fault: it answers with random bytes, as many as in the right answer.
        late_s: fault: additional delay of its answers.
        mount: the gimbal that it moves.
    """

    def __init__(self, mount: SimMount, link: ByteLink, scanner: FrameScanner) -> None:
        """Take the gimbal, the model's end of the link, and a scanner of requests' frames."""
        self.silent = False
        self.garbage = False
        self.late_s = 0.0
        self.mount = mount
        self._link, self._scanner = link, scanner
        self._rng = Random(0)
        self._boots_until = 0.0

    def reset(self) -> None:
        """Restart, as after a brown-out: after a silence it is in the state after power-on."""
        self._boots_until = asyncio.get_running_loop().time() + _BOOT_S
        self._scanner.reset()
        self._booted()

    async def run(self) -> None:
        """Act as the device until cancelled."""
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
        """Obey and answer one frame, which has been checked."""

    @abstractmethod
    def _booted(self) -> None:
        """Return to the state after power-on: forget what was set over the link."""

    def _answer(self, frame: bytes) -> None:
        """Send an answer after the device's delay, unless a fault prevents it."""
        if self.silent:
            return
        if self.garbage:
            frame = self._rng.randbytes(len(frame))
        delay = self.late_s + _TURNAROUND_S + len(frame) * _BYTE_S
        measured_t = self.mount.measured_t

        def send() -> None:
            self._link.write(frame)
            if not self.garbage:
                self.mount.reported(measured_t)

        asyncio.get_running_loop().call_later(delay, send)
