"""MAVLink's two UDP roles: wait on a port for a peer, or send first to a known address."""

import asyncio
import logging
import math
from collections.abc import Callable
from typing import Any, Protocol, cast

from hw.links.inbox import Inbox
from hw.links.reasons import in_words
from landerd.ports import DeviceLost

log = logging.getLogger(__name__)

# Silence after which the peer is accepted from another address, too; as long as a heartbeat is
# valid.
SILENT_S = 3.0


class _Transport(Protocol):
    """The part of an asyncio.DatagramTransport that is used, with its write buffer's size."""

    def sendto(self, data: bytes, addr: Any = None, /) -> None: ...
    def get_write_buffer_size(self) -> int: ...
    def abort(self) -> None: ...


class UdpLink(asyncio.DatagramProtocol):
    """Datagrams as a ByteLink. There is no connection: a silent peer is not a lost link.

    Attributes:
        strangers: number of datagrams from others than the peer, which were dropped.
    """

    def __init__(
        self, host: str, port: int, *, listen: bool, is_peer: Callable[[bytes], bool] | None = None
    ) -> None:
        """Make a link; `open` binds its socket.

        Args:
            host: name or number of the host to bind to or to send to.
            port: its port.
            listen: bind host:port and wait for a peer; else send to host:port.
            is_peer: tells by a datagram whether its sender is the peer. Others are ignored until
                the peer has been silent for SILENT_S. None: the peer is whoever sent last.
        """
        self._address = (host, port)
        self._is_peer = is_peer
        self._heard_t = -math.inf
        self.strangers = 0
        self._listen = listen
        self._inbox = Inbox()
        self._transport: _Transport | None = None
        self._peer: Any = None

    async def open(self) -> None:
        """Bind the socket. Raises DeviceLost."""
        await self.close()
        self._inbox.clear()
        self._peer, self._heard_t = None, -math.inf
        local, remote = (self._address, None) if self._listen else (None, self._address)
        try:
            await asyncio.get_running_loop().create_datagram_endpoint(
                lambda: self, local_addr=local, remote_addr=remote
            )
        except OSError as e:
            raise DeviceLost(f"udp {self._address[0]}:{self._address[1]}: {in_words(e)}") from None

    async def read(self) -> bytes:
        """Wait for datagrams and return all that are there, joined. Raises DeviceLost."""
        return await self._inbox.get()

    def write(self, data: bytes) -> None:
        """Send one datagram; it is dropped while a listening link knows no peer.

        It is also dropped while the socket takes none: kept, it would be stale when it is sent.
        """
        if self._transport is None or (self._listen and self._peer is None):
            return
        if self._transport.get_write_buffer_size() > 0:
            return
        self._transport.sendto(data, self._peer)

    async def close(self) -> None:
        """Release the socket; safe to call twice."""
        if self._transport is not None:
            self._transport.abort()
            self._transport = None
        self._inbox.lose("udp: closed")

    # ---- asyncio.DatagramProtocol ----

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self._transport = cast(_Transport, transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take a datagram."""
        if self._listen and not self._accepts(data, addr):
            self.strangers += 1
            if self.strangers == 1:
                log.warning("udp: %s:%s is not the autopilot and not listened to", *addr[:2])
            return
        self._inbox.put(data)

    def _accepts(self, data: bytes, addr: Any) -> bool:
        """Tell whether a datagram is the peer's; note the peer's address."""
        now = asyncio.get_running_loop().time()
        if self._is_peer is not None and addr != self._peer:
            if now - self._heard_t <= SILENT_S or not self._is_peer(data):
                return False
            log.info("udp: the autopilot is at %s:%s", *addr[:2])
        self._peer, self._heard_t = addr, now
        return True

    def error_received(self, exc: Exception) -> None:
        """Ignore it: a refused datagram only shows that the peer is not there yet."""
