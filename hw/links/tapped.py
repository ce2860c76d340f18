"""A link that somebody listens to, and its bytes as a .tlog."""

import asyncio
import struct
from typing import Protocol

from hw.autopilots.mavlink_codec import MavlinkCodec
from landerd.ports import ByteLink


class Tap(Protocol):
    """Hears all bytes of a link; must not wait."""

    def __call__(self, now: float, data: bytes, *, outgoing: bool) -> None:
        """Bytes passed, at this loop time in s."""


class TappedLink:
    """Passes everything on to another link; a ByteLink."""

    def __init__(self, link: ByteLink, tap: Tap) -> None:
        self._link = link
        self._tap = tap

    async def open(self) -> None:
        """Connect. Raises DeviceLost."""
        await self._link.open()

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there. Raises DeviceLost."""
        data = await self._link.read()
        self._tap(asyncio.get_running_loop().time(), data, outgoing=False)
        return data

    def write(self, data: bytes) -> None:
        """Queue bytes without waiting."""
        self._tap(asyncio.get_running_loop().time(), data, outgoing=True)
        self._link.write(data)

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
        await self._link.close()


class TlogEncoder:
    """Telemetry log as ground stations write it: each frame behind its Unix time in us."""

    def __init__(self) -> None:
        self._codecs = {outgoing: MavlinkCodec(0, 0) for outgoing in (False, True)}

    def encode(self, epoch_us: int, data: bytes, *, outgoing: bool) -> bytes:
        """Return the frames that these bytes complete; damaged ones are left out."""
        messages = self._codecs[outgoing].decode(data)
        return b"".join(struct.pack(">Q", epoch_us) + bytes(m.get_msgbuf()) for m in messages)
