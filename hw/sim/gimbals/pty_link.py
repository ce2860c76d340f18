"""The far end of a pseudo-terminal, to which a device model on a serial port is connected."""

import asyncio
import contextlib
import os

from hw.links.inbox import Inbox
from landerd.ports import DeviceLost

_READ_SIZE = 4096


class PtyLink:
    """The master of a pseudo-terminal as a `landerd.ports.ByteLink`; it is open from the start."""

    def __init__(self, master: int, slave: int) -> None:
        """Take both file descriptors.

        The slave is kept open, so that a driver may close it and open it again.
        """
        self._master, self._slave = master, slave
        os.set_blocking(master, False)
        self._inbox = Inbox()
        self._is_closed = False

    async def open(self) -> None:
        """Start to receive. Raises DeviceLost."""
        if self._is_closed:
            raise DeviceLost("pty: closed")
        asyncio.get_running_loop().add_reader(self._master, self._receive)

    async def read(self) -> bytes:
        """Wait for bytes and return all that have arrived. Raises DeviceLost."""
        return await self._inbox.get()

    def write(self, data: bytes) -> None:
        """Write bytes; those that the terminal does not take are lost, as on a wire."""
        with contextlib.suppress(OSError):
            os.write(self._master, data)

    async def close(self) -> None:
        """Close both ends; safe to call twice."""
        if not self._is_closed:
            self._is_closed = True
            asyncio.get_running_loop().remove_reader(self._master)
            os.close(self._master)
            os.close(self._slave)
            self._inbox.lose("pty: closed")

    def _receive(self) -> None:
        try:
            self._inbox.put(os.read(self._master, _READ_SIZE))
        except OSError as e:
            self._inbox.lose(f"pty: {e}")
