"""TCP as client (ArduPilot's SITL listens) or as server for one peer at a time."""

import asyncio
import logging
import math
import socket

from hw.links.inbox import Inbox
from hw.links.reasons import in_words
from hw.links.udp import SILENT_S
from landerd.ports import DeviceLost

log = logging.getLogger(__name__)

# Bytes waiting to be sent from which on new ones are dropped: a peer that reads nothing must
# neither fill the memory nor get stale set-points later.
_UNSENT_LIMIT = 1 << 13
# Time after which the kernel gives up a connection whose peer acknowledges nothing; its own default
# is about 15 minutes.
_USER_TIMEOUT_MS = 5000
# Time limit for connecting. The kernel itself would try for two minutes, at ever longer intervals.
_CONNECT_S = 2.0


class TcpLink:
    """One TCP connection as a ByteLink."""

    def __init__(self, host: str, port: int, *, listen: bool) -> None:
        """With listen, bind host:port and serve one caller until it is silent; else connect."""
        self._host, self._port, self._listen = host, port, listen
        self._inbox = Inbox()
        self._server: asyncio.Server | None = None
        self._transport: asyncio.Transport | None = None
        self._heard_t = -math.inf  # when the peer last sent something, s

    async def open(self) -> None:
        """Connect, or start to listen. Raises DeviceLost."""
        await self.close()
        self._inbox.clear()
        loop = asyncio.get_running_loop()
        try:
            if self._listen:
                # Kept before it starts to serve, so that `close` finds it if this is cancelled.
                self._server = await loop.create_server(
                    lambda: _Connection(self), self._host, self._port, start_serving=False
                )
                await self._server.start_serving()
            else:
                async with asyncio.timeout(_CONNECT_S):
                    await loop.create_connection(lambda: _Connection(self), self._host, self._port)
        except OSError as e:
            raise DeviceLost(f"tcp {self._host}:{self._port}: {in_words(e)}") from None

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there. Raises DeviceLost."""
        return await self._inbox.get()

    def write(self, data: bytes) -> None:
        """Queue bytes; they are dropped without a peer, or while the peer reads nothing."""
        transport = self._transport
        if transport is not None and transport.get_write_buffer_size() < _UNSENT_LIMIT:
            transport.write(data)

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.abort()
        if self._server is not None:
            self._server.close()
            self._server = None
        self._inbox.lose("tcp: closed")

    def _connected(self, transport: asyncio.Transport) -> None:
        now = asyncio.get_running_loop().time()
        if self._transport is not None and now - self._heard_t <= SILENT_S:
            log.warning("tcp: somebody else connects while the autopilot speaks: turned away")
            transport.abort()
            return
        previous, self._transport = self._transport, transport
        self._heard_t = now
        if previous is not None:
            previous.abort()

    def _received(self, transport: asyncio.Transport, data: bytes) -> None:
        if transport is self._transport:
            self._heard_t = asyncio.get_running_loop().time()
            self._inbox.put(data)

    def _disconnected(self, transport: asyncio.Transport, reason: str) -> None:
        if transport is self._transport:
            self._transport = None
            self._inbox.lose(f"tcp {self._host}:{self._port}: {reason}")


class _Connection(asyncio.Protocol):
    """Tells the link which of its connections the bytes came from."""

    def __init__(self, link: TcpLink) -> None:
        self._link = link
        self._transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            transport.get_extra_info("socket").setsockopt(
                socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _USER_TIMEOUT_MS
            )
        self._link._connected(transport)

    def data_received(self, data: bytes) -> None:
        self._link._received(self._transport, data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._link._disconnected(self._transport, str(exc) if exc else "the peer hung up")
