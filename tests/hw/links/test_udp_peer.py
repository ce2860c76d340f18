"""Who is listened to on a UDP port (docs/safety.md, rule 7)."""

import asyncio
import socket
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.heartbeats import heartbeat_of
from hw.autopilots.mavlink_codec import MavlinkCodec
from hw.links.udp import UdpLink


def heartbeat(system: int) -> bytes:
    message = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)
    return MavlinkCodec(system, 1).encode(message, 0.0)


def socket_of_somebody() -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind(("127.0.0.1", 0))
    s.setblocking(False)
    return s


def received(s: socket.socket) -> bytes | None:
    try:
        return s.recv(2048)
    except BlockingIOError:
        return None


def with_link(scene: Callable[[UdpLink, int], object]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]

    async def run() -> None:
        link = UdpLink("127.0.0.1", port, listen=True, is_peer=heartbeat_of(1, None))
        await link.open()
        try:
            result = scene(link, port)
            assert asyncio.iscoroutine(result)
            await result
        finally:
            await link.close()

    asyncio.run(run())


def test_a_stranger_is_neither_heard_nor_answered() -> None:
    async def scene(link: UdpLink, port: int) -> None:
        with socket_of_somebody() as autopilot, socket_of_somebody() as stranger:
            for datagram in (b"\0", heartbeat(2)):
                stranger.sendto(datagram, ("127.0.0.1", port))
            autopilot.sendto(heartbeat(1), ("127.0.0.1", port))
            assert await link.read() == heartbeat(1)
            # Not even with the autopilot's own words, while the autopilot is heard.
            for _ in range(20):
                stranger.sendto(heartbeat(1), ("127.0.0.1", port))
            autopilot.sendto(b"next", ("127.0.0.1", port))
            assert await link.read() == b"next"
            assert link.strangers == 22
            link.write(b"order")
            await asyncio.sleep(0.05)
            assert received(autopilot) == b"order"
            assert received(stranger) is None

    with_link(scene)


def test_a_silent_autopilot_may_come_back_from_elsewhere() -> None:
    async def scene(link: UdpLink, port: int) -> None:
        with socket_of_somebody() as before, socket_of_somebody() as after:
            before.sendto(heartbeat(1), ("127.0.0.1", port))
            await link.read()
            link._heard_t -= 3.1
            after.sendto(b"not yet", ("127.0.0.1", port))
            after.sendto(heartbeat(1), ("127.0.0.1", port))
            assert await link.read() == heartbeat(1)

    with_link(scene)


def test_bytes_that_the_socket_does_not_take_are_not_sent_later() -> None:
    """A set-point of ten seconds ago is worse than none."""

    class Stuffed:
        def __init__(self, sound: socket.socket) -> None:
            self.sound, self.is_full = sound, True
            self.sent: list[bytes] = []

        def send(self, data: bytes) -> int:
            if self.is_full:
                raise BlockingIOError
            self.sent.append(data)
            return len(data)

        def sendto(self, data: bytes, _address: object) -> int:
            return self.send(data)

        def fileno(self) -> int:
            return self.sound.fileno()

        def close(self) -> None:
            self.sound.close()

    async def run() -> list[bytes]:
        with socket_of_somebody() as there:
            link = UdpLink(*there.getsockname(), listen=False)
            await link.open()
            transport = link._transport
            assert transport is not None
            stuffed = Stuffed(transport._sock)  # type: ignore[attr-defined]
            transport._sock = stuffed  # type: ignore[attr-defined]
            for i in range(400):
                link.write(b"%d" % i)
            stuffed.is_full = False
            await asyncio.sleep(0.05)
            link.write(b"now")
            await asyncio.sleep(0.05)
            await link.close()
        return stuffed.sent

    assert asyncio.run(run()) == [b"0", b"now"]
