"""A simulated vehicle for a landerd in another process: MAVLink over UDP, pictures over a socket.

World, autopilot, pilot and judge are those of `landerd sim`, on the wall's clock; where its daemon
would be, its devices are handed out.
"""

import asyncio
import contextlib
import math
import struct
import time
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from hw.links import open_link
from landerd.drivers import read_configuration
from landerd.messages import Frame
from landerd.ports import DeviceLost
from landerd.runtime.daemon import Daemon
from landerd.section import Section
from landerd.simulation.flight import Simulation

CONFIG = Path("/etc/landerd/landerd.yaml")
HEADER = struct.Struct(
    "<dIHH"
)  # middle of the exposure (monotonic clock, s), number, height, width


class Handover:
    """Takes the place of a simulation's daemon, and passes its devices to one elsewhere."""

    def __init__(self, simulation: Simulation, url: str, pictures: Path) -> None:
        """Url: where that landerd listens for MAVLink. pictures: a socket to make, for its camera.

        A camera that has nobody to send to is not plugged in.
        """
        self.lander = simulation.daemon.lander  # has seen nothing, for who asks
        self.faults = simulation.daemon.faults
        self._simulation = simulation
        self._wire = open_link(url)
        self._pictures = pictures
        self._cables: list[asyncio.StreamWriter] = []

    async def run(self) -> None:
        """Serve until cancelled."""
        camera = self._simulation.camera
        self._pictures.unlink(missing_ok=True)
        server = await asyncio.start_unix_server(self._film, self._pictures)
        self._pictures.chmod(0o666)
        await self._wire.open()
        await self._simulation.link.open()
        await camera.open()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._down())
                tasks.create_task(self._up())
        finally:
            server.close()
            for cable in self._cables:
                cable.transport.abort()
            self._pictures.unlink(missing_ok=True)
            await self._wire.close()

    async def _down(self) -> None:
        while True:
            data = await self._simulation.link.read()
            self._wire.write(data)

    async def _up(self) -> None:
        while True:
            self._simulation.link.write(await self._wire.read())

    async def _film(self, _: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        loop = asyncio.get_running_loop()
        self._cables.append(writer)
        with contextlib.suppress(ConnectionError):
            while True:
                frame = await self._simulation.camera.newest()
                t = time.monotonic() - (loop.time() - frame.t)
                writer.write(HEADER.pack(t, frame.seq, *frame.image.shape) + frame.image.tobytes())
                await writer.drain()


class SocketCameraOptions(Section):
    """The camera has no options."""


class SocketCamera:
    """The other end of the pictures; a Camera."""

    path = Path("/run/landerd-pictures")

    def __init__(self, *, options: SocketCameraOptions) -> None:
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def open(self) -> None:
        """Connect. Raises DeviceLost."""
        await self.close()
        try:
            self._streams = await asyncio.open_unix_connection(self.path)
        except OSError as e:
            raise DeviceLost(f"camera {self.path}: {e.strerror}") from None

    async def newest(self) -> Frame:
        """Wait for the next picture. Raises DeviceLost."""
        if self._streams is None:
            raise DeviceLost("camera is closed")
        reader, _ = self._streams
        try:
            t, seq, height, width = HEADER.unpack(await reader.readexactly(HEADER.size))
            data = await reader.readexactly(height * width)
        except (OSError, EOFError):
            raise DeviceLost(f"camera {self.path} has gone") from None
        return Frame(t, seq, np.frombuffer(data, np.uint8).reshape(height, width))

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
        streams, self._streams = self._streams, None
        if streams is not None:
            streams[1].close()


@contextlib.asynccontextmanager
async def flying(
    config: Path, url: str, overrides: Sequence[str] = (), *, seed: int = 1
) -> AsyncIterator[Simulation]:
    """Let a simulated vehicle fly until the context is left.

    Its gate is low; the pilot is `simulation.autopilot.pilot`, the judge `simulation.rules`.
    """
    loaded = read_configuration(config, overrides=overrides)
    simulation = Simulation(loaded, seed, realtime=True)
    simulation.process.daemon = cast(Daemon, Handover(simulation, url, SocketCamera.path))
    simulation._beside.remove(simulation.stand_in.open_gate)
    run = asyncio.create_task(simulation.run(longest_s=math.inf))
    try:
        yield simulation
    finally:
        simulation.over = True
        await run
