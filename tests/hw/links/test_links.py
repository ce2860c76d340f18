"""Byte links: what is written at one end is read at the other, and a lost link says so."""

import asyncio
import contextlib
import os
import pty
import random
import socket
import termios
import time
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
import serial

from hw.links import open_link
from hw.links.memory import memory_pair
from landerd.ports import ByteLink, DeviceLost
from landerd.runtime.clock import run_virtual
from tests.quick_clock import run_quickly


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def run(scene: Callable[[], Awaitable[None]]) -> None:
    async def main() -> None:
        await asyncio.wait_for(scene(), 5.0)

    asyncio.run(main())


async def hears(writer: ByteLink, reader: ByteLink, data: bytes) -> None:
    writer.write(data)
    heard = b""
    while len(heard) < len(data):
        heard += await reader.read()
    assert heard == data


# ---- in memory ----


def test_memory_joins_both_ends() -> None:
    async def scene() -> None:
        a, b = memory_pair()
        await a.open()
        await b.open()
        await hears(a, b, b"there")
        await hears(b, a, b"back")

    run_virtual(scene())


def test_memory_delay_is_on_the_loops_clock() -> None:
    async def scene() -> None:
        loop = asyncio.get_running_loop()
        a, b = memory_pair()
        await a.open()
        await b.open()
        a.faults.delay_s = 0.25
        start = loop.time()
        await hears(a, b, b"late")
        assert loop.time() - start == pytest.approx(0.25)

    run_virtual(scene())


def test_memory_drops_and_corrupts_the_asked_share_and_the_tap_sees_what_was_written() -> None:
    async def scene() -> None:
        a, b = memory_pair()
        await a.open()
        await b.open()
        seen: list[tuple[float, bytes]] = []
        a.tap = lambda t, data: seen.append((t, data))
        a.faults.drop = 0.3
        arrived = b""
        for _ in range(1000):
            a.write(b"x")
        arrived = await b.read()
        assert len(arrived) == pytest.approx(700, abs=60)
        assert len(seen) == 1000
        a.faults.drop, a.faults.corrupt = 0.0, 0.05
        a.write(bytes(10_000))
        damaged = sum(byte != 0 for byte in await b.read())
        assert damaged == pytest.approx(500, abs=80)
        assert seen[-1][1] == bytes(10_000)

    run_virtual(scene())


def test_a_cut_memory_link_is_lost_at_both_ends_until_mended() -> None:
    async def scene() -> None:
        a, b = memory_pair()
        await a.open()
        await b.open()
        reading = asyncio.create_task(b.read())
        await asyncio.sleep(1.0)
        a.cut()
        with pytest.raises(DeviceLost):
            await reading
        with pytest.raises(DeviceLost):
            await a.read()
        a.write(b"nobody hears")
        with pytest.raises(DeviceLost):
            await b.open()
        a.mend()
        await a.open()
        await b.open()
        await hears(a, b, b"again")

    run_virtual(scene())


def test_an_unread_link_does_not_grow_without_end() -> None:
    async def scene() -> None:
        a, b = memory_pair()
        await a.open()
        await b.open()
        for _ in range(1000):
            a.write(bytes(1000))
        assert len(await b.read()) <= 1 << 16

    run_virtual(scene())


# ---- sockets and ports ----


def test_udp_answers_the_peer_that_spoke_last() -> None:
    async def scene() -> None:
        port = free_port(socket.SOCK_DGRAM)
        server = open_link(f"udpin:127.0.0.1:{port}")
        await server.open()
        server.write(b"nobody is there yet")
        for greeting in (b"first", b"second"):
            client = open_link(f"udpout:127.0.0.1:{port}")
            await client.open()
            await hears(client, server, greeting)
            await hears(server, client, b"answer")
            await client.close()
            with pytest.raises(DeviceLost):
                await client.read()
        await server.close()
        await server.close()

    run(scene)


def test_udp_outlives_a_peer_that_is_not_there_yet() -> None:
    async def scene() -> None:
        port = free_port(socket.SOCK_DGRAM)
        client = open_link(f"udpout:127.0.0.1:{port}")
        await client.open()
        for _ in range(3):
            client.write(b"refused")
            await asyncio.sleep(0.01)
        server = open_link(f"udpin:127.0.0.1:{port}")
        await server.open()
        await hears(client, server, b"heard")
        await client.close()
        await server.close()

    run(scene)


def test_tcp_both_ways_and_the_loss_of_the_peer() -> None:
    async def scene() -> None:
        port = free_port(socket.SOCK_STREAM)
        client = open_link(f"tcp:127.0.0.1:{port}")
        with pytest.raises(DeviceLost):
            await client.open()  # nobody listens
        server = open_link(f"tcpin:127.0.0.1:{port}")
        await server.open()
        for _ in range(2):
            await client.open()
            await hears(client, server, b"there")
            await hears(server, client, b"back")
            await server.close()
            with pytest.raises(DeviceLost):
                await client.read()
            client.write(b"nobody hears")
            await server.open()
        await client.open()
        await hears(client, server, b"there")
        await client.close()
        with pytest.raises(DeviceLost):
            await server.read()
        await server.close()

    run(scene)


def test_a_second_connection_does_not_cut_that_of_the_autopilot() -> None:
    """Once, a stranger's connection ended the autopilot's, and received the set-points."""

    async def scene() -> None:
        port = free_port(socket.SOCK_STREAM)
        server = open_link(f"tcpin:127.0.0.1:{port}")
        await server.open()
        autopilot = open_link(f"tcp:127.0.0.1:{port}")
        await autopilot.open()
        await hears(autopilot, server, b"there")
        stranger = open_link(f"tcp:127.0.0.1:{port}")
        await stranger.open()
        with pytest.raises(DeviceLost):
            await stranger.read()
        await hears(server, autopilot, b"still yours")
        await hears(autopilot, server, b"mine")
        await autopilot.close()
        await server.close()

    run(scene)


def test_a_tcp_peer_that_does_not_answer_is_called_again_soon() -> None:
    """The kernel retries ever more rarely: once landerd came half a minute after its peer."""

    async def scene() -> None:
        with contextlib.ExitStack() as sockets:
            hung = sockets.enter_context(socket.socket())
            hung.bind(("127.0.0.1", 0))
            hung.listen(0)
            address = hung.getsockname()
            for _ in range(4):  # more than it keeps: the next are not answered
                caller = sockets.enter_context(socket.socket())
                caller.setblocking(False)
                caller.connect_ex(address)
            await asyncio.sleep(0.2)
            link = open_link(f"tcp:127.0.0.1:{address[1]}")
            start = asyncio.get_running_loop().time()
            with pytest.raises(DeviceLost, match=r"^tcp 127.0.0.1:\d+: no answer$"):
                await asyncio.wait_for(link.open(), 10.0)
            assert asyncio.get_running_loop().time() - start == pytest.approx(2.0, abs=0.5)

    run_quickly(scene())


def test_a_tcp_peer_that_takes_nothing_does_not_fill_the_memory() -> None:
    async def scene() -> None:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            link = open_link(f"tcp:127.0.0.1:{listener.getsockname()[1]}")
            await link.open()
            peer, _ = listener.accept()
            sent = 64 << 20
            for _ in range(sent >> 16):
                link.write(bytes(1 << 16))
            await link.close()
            taken = 0
            peer.settimeout(1.0)
            try:
                while chunk := peer.recv(1 << 20):
                    taken += len(chunk)
            except OSError:
                pass
            peer.close()
            assert taken < sent // 2

    run(scene)


def test_serial_carries_every_byte_value_and_is_lost_with_its_device() -> None:
    async def scene() -> None:
        device, port = pty.openpty()
        link = open_link(f"serial:{os.ttyname(port)}?baud=57600")
        await link.open()
        every = bytes(range(256))
        link.write(every)
        await asyncio.sleep(0.05)
        assert os.read(device, 4096) == every
        os.write(device, every)
        heard = b""
        while len(heard) < 256:
            heard += await link.read()
        assert heard == every
        os.close(port)
        os.close(device)
        with pytest.raises(DeviceLost):
            await link.read()
        link.write(b"nobody hears")
        with pytest.raises(DeviceLost):
            await link.open()

    run(scene)


def test_another_program_that_reads_the_port_too_is_not_taken_for_a_lost_device() -> None:
    async def scene() -> None:
        device, port = pty.openpty()
        link = open_link(f"serial:{os.ttyname(port)}")
        thieves: list[int] = []
        stolen = bytearray()

        def steal(thief: int) -> None:
            with contextlib.suppress(BlockingIOError):
                stolen.extend(os.read(thief, 100))

        def place_a_thief() -> None:
            thief = os.open(os.ttyname(port), os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
            thieves.append(thief)
            asyncio.get_running_loop().add_reader(thief, steal, thief)

        place_a_thief()  # before and behind the link, which is told of the bytes, too
        await link.open()
        place_a_thief()
        for _ in range(20):
            os.write(device, b"stolen")
            await asyncio.sleep(0.002)
        assert stolen
        for thief in thieves:
            asyncio.get_running_loop().remove_reader(thief)
            os.close(thief)
        os.write(device, b"left")
        heard = b""
        while not heard.endswith(b"left"):
            heard += await link.read()
        os.close(device)
        os.close(port)
        await link.close()

    run(scene)


def test_a_serial_port_slow_to_open_or_close_does_not_block_the_loop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The kernel takes half a minute if the device accepts no bytes."""
    open_port, close_port = serial.Serial.open, serial.Serial.close

    def late(work: Callable[[Any], None]) -> Callable[[Any], None]:
        def do(port: Any) -> None:
            time.sleep(0.6)
            work(port)

        return do

    async def scene() -> None:
        longest = 0.0

        async def tick() -> None:
            nonlocal longest
            while True:
                start = time.monotonic()
                await asyncio.sleep(0.01)
                longest = max(longest, time.monotonic() - start)

        device, port = pty.openpty()
        ticking = asyncio.create_task(tick())
        link = open_link(f"serial:{os.ttyname(port)}")
        monkeypatch.setattr(serial.Serial, "open", late(open_port))
        await link.open()
        monkeypatch.setattr(serial.Serial, "close", late(close_port))
        start = time.monotonic()
        await link.close()
        assert time.monotonic() - start < 0.5
        await asyncio.sleep(1.0)
        assert longest < 0.5
        ticking.cancel()
        os.close(device)
        os.close(port)

    run(scene)


def test_a_serial_port_is_let_go_though_the_daemon_ends_while_it_closes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Otherwise the kernel waits at the process's end for bytes that the device never accepts."""
    flushed: list[int] = []
    monkeypatch.setattr(serial.Serial, "out_waiting", 64)
    monkeypatch.setattr(termios, "tcflush", lambda fd, what: flushed.append(what))

    async def scene() -> None:
        device, port = pty.openpty()
        link = open_link(f"serial:{os.ttyname(port)}")
        await link.open()
        os.close(port)
        os.set_blocking(device, False)
        flushed.clear()
        closing = asyncio.create_task(link.close())
        await asyncio.sleep(0.01)
        closing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await closing
        for _ in range(100):
            await asyncio.sleep(0.01)
            try:
                os.read(device, 1)
            except BlockingIOError:
                continue
            except OSError:  # nobody has its other side any more
                break
        else:
            pytest.fail("the port is still open")
        assert flushed == [termios.TCOFLUSH]
        os.close(device)

    run(scene)


def test_a_serial_port_that_stalls_takes_up_again() -> None:
    async def scene() -> None:
        device, port = pty.openpty()
        os.set_blocking(device, False)
        link = open_link(f"serial:{os.ttyname(port)}")
        await link.open()
        rng = random.Random(3)
        for _ in range(1000):  # nobody reads: the kernel's buffer fills, then landerd's, then drops
            link.write(rng.randbytes(100))
        heard = bytearray()
        for _ in range(50):
            await asyncio.sleep(0.005)
            try:
                heard += os.read(device, 1 << 16)
            except BlockingIOError:
                continue
        assert 4096 <= len(heard) < 50_000
        link.write(b"fresh")
        await asyncio.sleep(0.05)
        assert os.read(device, 4096) == b"fresh"
        await link.close()
        os.close(device)
        os.close(port)

    run(scene)


# ---- URLs ----


@pytest.mark.parametrize(
    "url",
    [
        "",
        "udp:127.0.0.1:14550",
        "udpin:14550",
        "udpin:127.0.0.1",
        "udpin:127.0.0.1:0",
        "tcp:localhost:65536",
        "tcp:localhost:-1",
        "tcp::5760",
        "udpout:drone..local:14550",
        f"tcp:{'a' * 70}.local:5760",
        "udpin:drone\0:14550",
        "serial:",
        "serial:ttyS0",
        "serial:/dev/ttyS0?baud=fast",
        "serial:/dev/ttyS0?baud=0",
        "serial:/dev/ttyS0?bits=7",
        "memory:",
    ],
)
def test_a_bad_url_is_refused_in_one_line(url: str) -> None:
    with pytest.raises(ValueError, match=r"expected|unknown|simulator|cannot be a host") as refusal:
        open_link(url)
    assert "\n" not in str(refusal.value)


def test_a_serial_port_that_cannot_be_opened_says_why() -> None:
    async def scene() -> None:
        with pytest.raises(DeviceLost, match="serial /dev/no-such-port is not there"):
            await open_link("serial:/dev/no-such-port").open()
        with pytest.raises(DeviceLost, match="serial /dev/null is no serial port"):
            await open_link("serial:/dev/null").open()
        device, port = pty.openpty()
        first, second = (open_link(f"serial:{os.ttyname(port)}") for _ in range(2))
        await first.open()
        with pytest.raises(DeviceLost, match="is used by another program"):
            await second.open()
        await first.close()
        os.close(device)
        os.close(port)

    run(scene)


def test_memory_keeps_the_order_of_what_was_written_whatever_the_delays() -> None:
    """Once, three messages of one control step with equal delays sometimes changed their order."""

    async def scene() -> None:
        near, far = memory_pair()
        await near.open()
        await far.open()
        near.faults.delay_s, near.faults.jitter_s = 0.01, 0.02
        for i in range(200):
            near.write(bytes([i]))
            if i % 4 == 3:
                await asyncio.sleep(0.005)
            if i == 100:
                near.faults.delay_s = near.faults.jitter_s = 0.0  # what comes later waits its turn
        await asyncio.sleep(0.1)
        assert await far.read() == bytes(range(200))

    run_virtual(scene())


def test_a_slow_wire_takes_its_time_for_every_byte() -> None:
    async def scene() -> None:
        near, far = memory_pair()
        await near.open()
        await far.open()
        near.faults.baud = 9600.0
        near.write(bytes(48))  # 50 ms
        near.write(bytes(48))  # and 50 ms more, after the first
        started = asyncio.get_running_loop().time()
        await far.read()
        assert asyncio.get_running_loop().time() - started == pytest.approx(0.05)
        await far.read()
        assert asyncio.get_running_loop().time() - started == pytest.approx(0.1)

    run_virtual(scene())


def test_a_flood_delays_a_slow_wire_by_no_more_than_its_buffer_holds() -> None:
    async def scene() -> None:
        near, far = memory_pair()
        await near.open()
        await far.open()
        near.faults.baud = 57600.0
        for _ in range(1000):
            near.write(bytes(100))  # 17 s of it
        await asyncio.sleep(0.75)
        while not (await far.read()).endswith(b"after it"):
            near.write(b"after it")
        assert asyncio.get_running_loop().time() < 2.0

    run_virtual(scene())


def test_the_reason_for_a_missing_connection_is_given_in_words() -> None:
    async def why(url: str) -> str:
        with pytest.raises(DeviceLost) as e:
            await open_link(url).open()
        return str(e.value)

    assert asyncio.run(why("tcp:127.0.0.1:1")) == "tcp 127.0.0.1:1: Connection refused"
    assert "Errno" not in asyncio.run(why("tcp:localhost:1"))
    assert asyncio.run(why("udpin:203.0.113.1:5")).endswith(": Cannot assign requested address")
