"""A serial port: a UART of the board, a USB adapter, a pseudo-terminal."""

import asyncio
import contextlib
import errno
import os
import termios
import threading
from collections.abc import Callable
from functools import partial

import serial

from hw.links.inbox import Inbox
from hw.links.reasons import in_words
from landerd.ports import DeviceLost

_READ_SIZE = 4096
# Most bytes that wait to be sent. At 57600 baud they take 0.7 s; older ones are of no use.
_UNSENT_LIMIT = 4096
_DRAIN_S = 0.1  # longest wait on closing for the last bytes to be sent
_POLL_S = 0.002
_REASONS = {
    errno.ENOENT: "is not there",
    errno.ENXIO: "is not there",
    errno.ENODEV: "is not there",
    errno.EACCES: "may not be opened: is the user in group dialout?",
    errno.EAGAIN: "is used by another program",  # another holds pyserial's lock
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
        opened: list[serial.Serial | Exception] = []

        def work() -> None:
            try:
                # pyserial opens without waiting for modem lines and sets any baud rate. Given an
                # inter-byte timeout, it sets VMIN 1: then an empty read means that the device is
                # gone. With VMIN 0 it could also mean that another program has read the bytes.
                port = serial.Serial(
                    self._path, self._baud, timeout=0, inter_byte_timeout=0, exclusive=True
                )
                opened.append(port)
            except (OSError, ValueError, termios.error) as e:
                opened.append(e)

        opening = _aside(work)
        while opening.is_alive():
            await asyncio.sleep(_POLL_S)
        if not isinstance(opened[0], serial.Serial):
            raise DeviceLost(f"serial {self._path} {_reason(opened[0])}")
        self._port = opened[0]
        os.set_blocking(self._port.fileno(), False)
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._receive)

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there. Raises DeviceLost."""
        return await self._inbox.get()

    def write(self, data: bytes) -> None:
        """Queue bytes; they are dropped if the port is gone or does not keep up."""
        if self._port is None or len(self._unsent) + len(data) > _UNSENT_LIMIT:
            return
        was_idle = not self._unsent
        self._unsent += data
        if was_idle:
            self._send()

    async def close(self) -> None:
        """Release the port after the last bytes are sent, or _DRAIN_S; safe to call twice."""
        loop = asyncio.get_running_loop()
        end = loop.time() + _DRAIN_S
        try:
            with contextlib.suppress(OSError):
                while (port := self._port) is not None and port.out_waiting and loop.time() < end:
                    await asyncio.sleep(_POLL_S)
        finally:  # also if the daemon ends while this waits
            closing = self._release("closed")
        while closing is not None and closing.is_alive() and loop.time() < end:
            await asyncio.sleep(_POLL_S)

    def _receive(self) -> None:
        assert self._port is not None
        try:
            data = os.read(self._port.fileno(), _READ_SIZE)
        except BlockingIOError:
            return
        except OSError as e:
            self._release(in_words(e))
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
            self._release(in_words(e))
            return
        loop = asyncio.get_running_loop()
        if self._unsent:
            loop.add_writer(fd, self._send)
        else:
            loop.remove_writer(fd)

    def _release(self, reason: str) -> threading.Thread | None:
        """Give up the port, and return the thread that closes it; None: it was not open."""
        port, self._port = self._port, None
        closing = None
        if port is not None:
            loop = asyncio.get_running_loop()
            loop.remove_reader(port.fileno())
            loop.remove_writer(port.fileno())
            closing = _aside(partial(_close, port))
        self._unsent.clear()
        self._inbox.lose(f"serial {self._path}: {reason}")
        return closing


def _close(port: serial.Serial) -> None:
    """Close a port, and discard bytes that the device has not taken.

    Otherwise the kernel waits 30 s for them, even at the end of a process.
    """
    with contextlib.suppress(OSError, termios.error):
        termios.tcflush(port.fileno(), termios.TCOFLUSH)
    port.close()


def _aside(work: Callable[[], None]) -> threading.Thread:
    """Call a function in a daemon thread, for which not even the end of the process waits.

    A driver may block the call that closes a port, and any that opens the port meanwhile.
    """
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    return thread


def _reason(e: Exception) -> str:
    if isinstance(e.__context__, termios.error):  # for which pyserial gives no error number
        return "is no serial port"
    if not isinstance(e, OSError):
        return f"cannot be opened: {e}"
    return _REASONS.get(e.errno or 0) or f"cannot be opened: {in_words(e)}"
