"""A link whose bytes are passed to a listener as well, such as the recorder."""

import asyncio
from typing import Protocol

from landerd.ports import ByteLink


class Tap(Protocol):
    """Is given all bytes of a link; must not block."""

    def __call__(self, now: float, data: bytes, *, outgoing: bool) -> None:
        """Take bytes that passed at loop time now, s."""


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
