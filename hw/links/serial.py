"""A serial port: a UART of the board, a USB adapter, a pseudo-terminal."""

import asyncio
import errno
import os
import termios

import serial

from hw.links.inbox import Inbox
from landerd.ports import DeviceLost

_READ_SIZE = 4096
# At 57600 baud this much takes 0.7 s to send; nothing older is worth sending.
_UNSENT_LIMIT = 4096
_REASONS = {
    errno.ENOENT: "is not there",
    errno.ENXIO: "is not there",
    errno.ENODEV: "is not there",
    errno.EACCES: "may not be opened: is the user in group dialout?",
    errno.EAGAIN: "is used by another program",  # pyserial's lock
    errno.EBUSY: "is used by another program",
}


class SerialLink:
    """A serial port as a ByteLink: 8 data bits, no parity, one stop bit, no flow control."""

    def __init__(self, path: str, baud: int) -> None:
        self._path, self._baud = path, baud
        self._inbox = Inbox()
        self._unsent = bytearray()
        self._port: serial.Serial | None = None

    async def open(self) -> None:
        """Open and set up the port, for this process alone. Raises DeviceLost."""
        await self.close()
        self._inbox.clear()
        try:
            # pyserial opens without waiting for modem lines and sets any baud rate.
            self._port = serial.Serial(self._path, self._baud, timeout=0, exclusive=True)
        except (OSError, ValueError) as e:
            raise DeviceLost(f"serial {self._path} {_reason(e)}") from None
        os.set_blocking(self._port.fileno(), False)
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._receive)

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there. Raises DeviceLost."""
        return await self._inbox.get()

    def write(self, data: bytes) -> None:
        """Queue bytes; dropped when the port is gone or does not keep up."""
        if self._port is None or len(self._unsent) + len(data) > _UNSENT_LIMIT:
            return
        was_idle = not self._unsent
        self._unsent += data
        if was_idle:
            self._send()

    async def close(self) -> None:
        """Release the port; safe to call twice."""
        self._release("closed")

    def _receive(self) -> None:
        assert self._port is not None
        try:
            data = os.read(self._port.fileno(), _READ_SIZE)
        except BlockingIOError:
            return
        except OSError as e:
            self._release(str(e))
            return
        if data:
            self._inbox.put(data)
        else:
            self._release("the device has gone")

    def _send(self) -> None:
        assert self._port is not None
        fd = self._port.fileno()
        try:
            del self._unsent[: os.write(fd, self._unsent)]
        except BlockingIOError:
            pass
        except OSError as e:
            self._release(str(e))
            return
        loop = asyncio.get_running_loop()
        if self._unsent:
            loop.add_writer(fd, self._send)
        else:
            loop.remove_writer(fd)

    def _release(self, reason: str) -> None:
        port, self._port = self._port, None
        if port is not None:
            loop = asyncio.get_running_loop()
            loop.remove_reader(port.fileno())
            loop.remove_writer(port.fileno())
            port.close()
        self._unsent.clear()
        self._inbox.lose(f"serial {self._path}: {reason}")


def _reason(e: Exception) -> str:
    if isinstance(e.__context__, termios.error):  # of pyserial, which keeps no number then
        return "is no serial port"
    number = e.errno if isinstance(e, OSError) else None
    return _REASONS.get(number or 0) or f"cannot be opened: {e}"
