"""A real link to an autopilot that landerd shares with a ground station and the simulated world."""

import asyncio
from collections.abc import Callable

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links.inbox import Inbox
from hw.links.memory import Tap
from landerd.ports import ByteLink


class SharedLink:
    """landerd's end, a ByteLink: the real link, to which others listen, too.

    The others get the bytes that arrive only while landerd's end is being read.

    Attributes:
        tap: called with (loop time in s, bytes) for bytes that landerd writes.
        heard: called with the same for each whole message that arrives.
        listeners: called with each message that arrives, before landerd gets its bytes.
    """

    def __init__(self, link: ByteLink) -> None:
        self.tap: Tap | None = None
        self.heard: Tap | None = None
        self.listeners: list[Callable[[Message], None]] = []
        self._link = link
        self._codec = MavlinkCodec(255, 0)  # used only for decoding
        self._sides: list[_Side] = []

    async def open(self) -> None:
        """Connect. Raises DeviceLost."""
        await self._link.open()
        self._codec.reset()

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there. Raises DeviceLost."""
        data = await self._link.read()
        now = asyncio.get_running_loop().time()
        for message in self._codec.decode(data):
            for listener in self.listeners:
                listener(message)
            if self.heard is not None:
                self.heard(now, bytes(message.get_msgbuf()))
        for side in self._sides:
            side.inbox.put(data)
        return data

    def write(self, data: bytes) -> None:
        """Queue bytes of landerd's."""
        if self.tap is not None:
            self.tap(asyncio.get_running_loop().time(), data)
        self._link.write(data)

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
        await self._link.close()

    def side(self) -> ByteLink:
        """Return a further end: it writes to the link and gets a copy of the bytes that arrive."""
        side = _Side(self._link)
        self._sides.append(side)
        return side


class _Side:
    """A further end, which is open while the shared link is, and cannot open or close it."""

    def __init__(self, link: ByteLink) -> None:
        self.inbox = Inbox()
        self._link = link

    async def open(self) -> None:
        """Nothing to do."""

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there."""
        return await self.inbox.get()

    def write(self, data: bytes) -> None:
        """Queue bytes."""
        self._link.write(data)

    async def close(self) -> None:
        """Nothing to do."""
