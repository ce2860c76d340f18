"""The far end of a pseudo-terminal: where a modelled device sits on a serial port."""

import asyncio
import contextlib
import os

from hw.links.inbox import Inbox
from landerd.ports import DeviceLost

_READ_SIZE = 4096


class PtyLink:
    """The master of a pseudo-terminal; a ByteLink. It is open from the start."""

    def __init__(self, master: int, slave: int) -> None:
        """Take both file descriptors; the slave's is kept so that a driver may come and go."""
        self._master, self._slave = master, slave
        os.set_blocking(master, False)
        self._inbox = Inbox()
        self._is_closed = False

    async def open(self) -> None:
        """Listen."""
        if self._is_closed:
            raise DeviceLost("pty: closed")
        asyncio.get_running_loop().add_reader(self._master, self._receive)

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there. Raises DeviceLost."""
        return await self._inbox.get()

    def write(self, data: bytes) -> None:
        """Write bytes; what the terminal does not take is lost, as on a wire."""
        with contextlib.suppress(OSError):
            os.write(self._master, data)

    async def close(self) -> None:
        """Hang up; safe to call twice."""
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
