"""Peers over real UDP, TCP and pseudo-terminals that die and come back, under the real daemon."""

import asyncio
import contextlib
import os
import pty
import socket
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.links import open_link
from hw.links.inbox import Inbox
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.config.models import Config
from landerd.messages import (
    Attitude,
    AutopilotMessage,
    AutopilotRestarted,
    Command,
    Heartbeat,
    Input,
    LocalPosition,
    RcChannels,
)
from landerd.pad import load_pad
from landerd.ports import ByteLink
from landerd.runtime.daemon import Daemon, Devices
from landerd.runtime.observer import Observer
from tests.hw.flight import PlainAirframe, plain_autopilot
from tests.hw.idle import Idle
from tests.quick_clock import run_quickly

NEEDED = (Heartbeat, Attitude, LocalPosition, RcChannels)


class Heard(Observer):
    """An observer that keeps the messages that reached the core."""

    def __init__(self) -> None:
        self.messages: list[tuple[float, Input]] = []

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        self.messages.append((now, message))

    def kinds(self) -> set[type]:
        return {type(m) for _, m in self.messages}


class PtyEnd:
    """The autopilot's end of a pseudo-terminal; landerd opens `path`, as a serial port."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._fd = -1
        self._inbox = Inbox()

    async def open(self) -> None:
        self._fd, port = pty.openpty()
        tty.setraw(port)
        self._path.unlink(missing_ok=True)
        self._path.symlink_to(os.ttyname(port))
        os.set_blocking(self._fd, False)
        self._port = port
        asyncio.get_running_loop().add_reader(self._fd, self._receive)

    def _receive(self) -> None:
        self._inbox.put(os.read(self._fd, 4096))

    async def read(self) -> bytes:
        return await self._inbox.get()

    def write(self, data: bytes) -> None:
        try:
            os.write(self._fd, data)
        except BlockingIOError:
            return

    async def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._fd)
        os.close(self._port)
        os.close(self._fd)


def port_of(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def udp(folder: Path) -> tuple[str, Callable[[], ByteLink]]:
    port = port_of(socket.SOCK_DGRAM)
    return f"udpin:127.0.0.1:{port}", lambda: open_link(f"udpout:127.0.0.1:{port}")


def udp_out(folder: Path) -> tuple[str, Callable[[], ByteLink]]:
    port = port_of(socket.SOCK_DGRAM)
    return f"udpout:127.0.0.1:{port}", lambda: open_link(f"udpin:127.0.0.1:{port}")


def tcp(folder: Path) -> tuple[str, Callable[[], ByteLink]]:
    port = port_of(socket.SOCK_STREAM)
    return f"tcp:127.0.0.1:{port}", lambda: open_link(f"tcpin:127.0.0.1:{port}")


def tcp_in(folder: Path) -> tuple[str, Callable[[], ByteLink]]:
    port = port_of(socket.SOCK_STREAM)
    return f"tcpin:127.0.0.1:{port}", lambda: open_link(f"tcp:127.0.0.1:{port}")


def serial(folder: Path) -> tuple[str, Callable[[], ByteLink]]:
    return f"serial:{folder / 'tty'}?baud=57600", lambda: PtyEnd(folder / "tty")


@pytest.mark.parametrize("link", [udp, udp_out, tcp, tcp_in, serial])
@pytest.mark.parametrize("restarted", [False, True])
def test_a_peer_that_dies_and_comes_back_is_heard_again(
    tmp_path: Path,
    link: Callable[[Path], tuple[str, Callable[[], ByteLink]]],
    *,
    restarted: bool,
) -> None:
    url, peer = link(tmp_path)
    run_quickly(asyncio.wait_for(scene(url, peer, restarted=restarted), 60.0))


async def scene(url: str, peer: Callable[[], ByteLink], *, restarted: bool) -> None:
    loop = asyncio.get_running_loop()
    heard = Heard()
    driver = MavlinkAutopilot(open_link(url))
    idle = Idle()
    daemon = Daemon(
        Config(),
        load_pad(config_dir() / "pads" / "thesis.yaml"),
        load_camera(config_dir() / "cameras" / "thesis.yaml"),
        Devices(idle, idle, driver),
        observers=(heard,),
    )
    flying = asyncio.create_task(daemon.run())
    booted = loop.time() - 60.0
    for life in range(3):
        heard.messages.clear()
        age = (60.0, 30.0, 0.5)[life] if restarted else loop.time() - booted
        far = peer()
        autopilot = plain_autopilot(PlainAirframe(), [far], flying=True, boot_age_s=age)
        living = asyncio.create_task(autopilot.run())
        while not heard.kinds() >= set(NEEDED):
            assert not flying.done()
            await asyncio.sleep(0.02)
        for now, m in heard.messages:
            assert now - m.t < 1.0, "data of the life before"
        restarts = [m for _, m in heard.messages if isinstance(m, AutopilotRestarted)]
        assert len(restarts) == int(restarted and life > 0)
        living.cancel()
        await asyncio.gather(living, return_exceptions=True)
        await far.close()
        await asyncio.sleep(0.3)
    assert not flying.done()
    flying.cancel()
    await asyncio.gather(flying, return_exceptions=True)


class Relay(asyncio.DatagramProtocol):
    """Passes datagrams between landerd's port and another peer, and damages or drops some."""

    transport: asyncio.DatagramTransport

    def __init__(self, landerd: int, corrupt: float, lost: float) -> None:
        """Corrupt: share of the bytes. Lost: share of the datagrams."""
        self._landerd = landerd
        self._corrupt, self._lost = corrupt, lost
        self._autopilot: Any = None
        self._rng = np.random.default_rng(1)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        from_landerd = addr[1] == self._landerd
        if not from_landerd:
            self._autopilot = addr
        if self._rng.random() < self._lost:
            return
        bad = np.frombuffer(data, np.uint8).copy()
        hit = self._rng.random(len(bad)) < self._corrupt
        bad[hit] ^= self._rng.integers(1, 256, hit.sum(), dtype=np.uint8)
        to = self._autopilot if from_landerd else ("127.0.0.1", self._landerd)
        if to is not None:
            self.transport.sendto(bad.tobytes(), to)


async def heard_through_relay(corrupt: float, lost: float) -> list[AutopilotMessage]:
    """Listen to the stand-in until ten positions came."""
    near, far = port_of(socket.SOCK_DGRAM), port_of(socket.SOCK_DGRAM)
    loop = asyncio.get_running_loop()
    relay, _ = await loop.create_datagram_endpoint(
        lambda: Relay(near, corrupt, lost), local_addr=("127.0.0.1", far)
    )
    driver = MavlinkAutopilot(open_link(f"udpin:127.0.0.1:{near}"))
    await driver.open()
    peer = open_link(f"udpout:127.0.0.1:{far}")
    autopilot = plain_autopilot(PlainAirframe(), [peer], flying=True)
    living = asyncio.create_task(autopilot.run())
    got: list[AutopilotMessage] = []

    async def receive() -> None:
        while sum(isinstance(m, LocalPosition) for m in got) < 10:
            got.append(await driver.receive())

    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(receive(), 60.0)
    living.cancel()
    await asyncio.gather(living, return_exceptions=True)
    await peer.close()
    await driver.close()
    relay.close()
    await asyncio.sleep(0.01)
    return got


@pytest.mark.parametrize(("corrupt", "lost"), [(0.05, 0.0), (0.0, 0.3)])
def test_a_real_link_with_damaged_bytes_and_lost_packets_keeps_its_times_and_values(
    corrupt: float, lost: float
) -> None:
    """Through UDP and a relay that damages 5 % of the bytes or loses 30 % of the datagrams."""
    got = run_quickly(heard_through_relay(corrupt, lost))
    positions = [m for m in got if isinstance(m, LocalPosition)]
    assert len(positions) >= 10
    assert {m.position for m in positions} == {(0.0, 0.0, -10.0)}
    assert not [m for m in got if isinstance(m, AutopilotRestarted)]
