"""Two joined ends of a link in memory, for virtual time: no sockets, no threads."""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

from hw.links.inbox import Inbox
from landerd.ports import DeviceLost

Tap = Callable[[float, bytes], None]

BITS_A_BYTE = 10  # start bit, eight of data, stop bit
# Most bytes that wait to be sent on a wire, as in Linux's serial driver: further ones are lost.
# Without the limit a flood of 150 kB was queued for half a minute, and everything after it was as
# late.
BUFFER_BYTES = 4096


@dataclass
class LinkFaults:
    """Faults of the bytes that one end writes; they may be changed at any time."""

    drop: float = 0.0  # probability that a write is lost
    corrupt: float = 0.0  # probability that a byte is changed
    delay_s: float = 0.0
    jitter_s: float = 0.0  # longest extra delay of a write; uniformly distributed
    # Bits per second, ten per byte; at most BUFFER_BYTES wait. None: bytes take no time.
    baud: float | None = None
    double: float = 0.0  # probability that a write arrives twice
    rng: Random = field(default_factory=lambda: Random(0))


class MemoryLink:
    """One end of a pair; a ByteLink.

    Attributes:
        faults: faults of the bytes written at this end.
        tap: called with (loop time in s, bytes) for each write, before any fault.
        heard: called with the same for bytes that arrive at this end.
    """

    def __init__(self) -> None:
        self.faults = LinkFaults()
        self.tap: Tap | None = None
        self.heard: Tap | None = None
        self._peer: MemoryLink = self
        self._inbox = Inbox()
        self._under_way: deque[tuple[float, bytes]] = deque()  # time of arrival (s), bytes
        self._wire_free_t = 0.0  # when the last byte written will have left, s
        self._cut = False
        self._is_open = False

    def join(self, peer: "MemoryLink") -> None:
        """Make peer the other end of this one."""
        self._peer = peer
        peer._peer = self

    async def open(self) -> None:
        """Connect. Raises DeviceLost while the link is cut."""
        if self._cut:
            raise DeviceLost("memory: the link is cut")
        self._inbox.clear()
        self._is_open = True

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there. Raises DeviceLost."""
        if not self._is_open:
            raise DeviceLost("memory: not open")
        return await self._inbox.get()

    def write(self, data: bytes) -> None:
        """Hand bytes to the other end; a cut or closed link drops them."""
        if not self._is_open or self._cut:
            return
        now = asyncio.get_running_loop().time()
        if self.tap is not None:
            self.tap(now, data)
        faults = self.faults
        if faults.drop > 0.0 and faults.rng.random() < faults.drop:
            return
        if faults.corrupt > 0.0:
            data = _corrupted(data, faults)
        if faults.double > 0.0 and faults.rng.random() < faults.double:
            data += data
        if self._is_full(now, len(data)):
            return
        arrival = now + self._delay(now, len(data))
        if arrival > now or self._under_way:
            self._send_off(arrival, data)
        else:
            self._peer._deliver(data)

    def _is_full(self, now: float, size: int) -> bool:
        """Tell whether the transmit buffer has no room for this many more bytes."""
        baud = self.faults.baud
        if baud is None:
            return False
        waiting = max(0.0, self._wire_free_t - now) * baud / BITS_A_BYTE
        return waiting > 0.0 and waiting + size > BUFFER_BYTES

    def _delay(self, now: float, size: int) -> float:
        """Return the time that a write of this many bytes takes to the other end, s."""
        faults = self.faults
        delay = faults.delay_s
        if faults.jitter_s > 0.0:
            delay += faults.rng.uniform(0.0, faults.jitter_s)
        if faults.baud is not None:
            self._wire_free_t = max(self._wire_free_t, now) + BITS_A_BYTE * size / faults.baud
            delay += self._wire_free_t - now
        return delay

    def _send_off(self, arrival: float, data: bytes) -> None:
        """Schedule the arrival of bytes, never before that of bytes written earlier."""
        if self._under_way:
            arrival = max(arrival, self._under_way[-1][0])
        self._under_way.append((arrival, data))
        # Timers set for the same time run in any order, so each delivers the oldest bytes.
        asyncio.get_running_loop().call_at(arrival, self._arrive)

    def _arrive(self) -> None:
        _, data = self._under_way.popleft()
        self._peer._deliver(data)

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
        self._is_open = False
        self._inbox.lose("memory: closed")

    def cut(self) -> None:
        """Break the link: both ends raise DeviceLost and cannot be opened until `mend`."""
        for end in (self, self._peer):
            end._cut = True
            end._is_open = False
            end._inbox.lose("memory: the link is cut")

    def mend(self) -> None:
        """Let both ends be opened again."""
        self._cut = self._peer._cut = False

    def _deliver(self, data: bytes) -> None:
        if not self._is_open:
            return
        if self.heard is not None:
            self.heard(asyncio.get_running_loop().time(), data)
        self._inbox.put(data)


def _corrupted(data: bytes, faults: LinkFaults) -> bytes:
    damaged = bytearray(data)
    for i in range(len(damaged)):
        if faults.rng.random() < faults.corrupt:
            damaged[i] ^= faults.rng.randrange(1, 256)
    return bytes(damaged)


def memory_pair() -> tuple[MemoryLink, MemoryLink]:
    """Return the two ends of a new link."""
    a, b = MemoryLink(), MemoryLink()
    a.join(b)
    return a, b
