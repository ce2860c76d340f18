"""MAVLink's two UDP roles: wait for a peer on a port, or speak first to a known one."""

import asyncio
from typing import Any, cast

from hw.links.inbox import Inbox
from hw.links.reasons import in_words
from landerd.ports import DeviceLost


class UdpLink(asyncio.DatagramProtocol):
    """Datagrams as a ByteLink. There is no connection: a silent peer is not a lost link."""

    def __init__(self, host: str, port: int, *, listen: bool) -> None:
        """With listen, bind host:port and answer whoever spoke last; else speak to host:port."""
        self._address = (host, port)
        self._listen = listen
        self._inbox = Inbox()
        self._transport: asyncio.DatagramTransport | None = None
        self._peer: Any = None

    async def open(self) -> None:
        """Bind the socket. Raises DeviceLost."""
        await self.close()
        self._inbox.clear()
        self._peer = None
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
        """Send one datagram; dropped while a listening link has not heard its peer."""
        if self._transport is None or (self._listen and self._peer is None):
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
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take a datagram."""
        if self._listen:
            self._peer = addr
        self._inbox.put(data)

    def error_received(self, exc: Exception) -> None:
        """Ignore: a refused datagram says only that the peer is not there yet."""
