"""Received bytes on their way from a transport's callbacks to `ByteLink.read`."""

import asyncio

from landerd.ports import DeviceLost

# Most bytes kept, so that a reader that has stopped does not fill the memory: further ones are
# lost, as in a serial port's buffer.
_CAPACITY = 1 << 16  # bytes


class Inbox:
    """Collects bytes; the one reader waits for them or for the loss of the link."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._loss: str | None = None
        self._waiter: asyncio.Future[None] | None = None

    def put(self, data: bytes) -> None:
        """Add received bytes."""
        if len(self._bytes) + len(data) <= _CAPACITY:
            self._bytes += data
            self._wake()

    def lose(self, reason: str) -> None:
        """Make every `get` raise DeviceLost with this text until `clear`."""
        self._loss = reason
        self._wake()

    def clear(self) -> None:
        """Forget bytes and loss, for a link that is opened again."""
        self._bytes.clear()
        self._loss = None

    async def get(self) -> bytes:
        """Wait for bytes and return all there are.

        Raises:
            DeviceLost: the link is gone.
        """
        while self._loss is None and not self._bytes:
            self._waiter = asyncio.get_running_loop().create_future()
            await self._waiter
        if self._loss is not None:
            raise DeviceLost(self._loss)
        data = bytes(self._bytes)
        self._bytes.clear()
        return data

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)
