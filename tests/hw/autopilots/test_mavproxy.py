"""A ground station that others wrote, MAVProxy, with the stand-in and landerd's driver.

Runs where MAVProxy is installed (`LANDERD_MAVPROXY` names its program, or it is on the PATH); it is
no dependency, for its wheel brings another OpenCV that would replace the headless one.
"""

import asyncio
import os
import shutil
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.links import open_link
from landerd.config.models import Config
from landerd.config.parameters import ParameterSet, parameters
from landerd.messages import (
    Attitude,
    Heartbeat,
    LocalPosition,
    ParameterChange,
    RcChannels,
    Setpoint,
)
from landerd.ports import ByteLink
from tests.hw.flight import PlainAirframe, plain_autopilot

MAVPROXY = os.environ.get("LANDERD_MAVPROXY") or shutil.which("mavproxy.py")
pytestmark = pytest.mark.skipif(MAVPROXY is None, reason="MAVProxy is not installed")


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


class Scene:
    """The stand-in, landerd's driver and MAVProxy, running."""

    def __init__(self) -> None:
        self.airframe = PlainAirframe()
        self.tuned = ParameterSet(Config())
        self.got: list[Any] = []
        self.said = ""  # by MAVProxy
        self.driver: MavlinkAutopilot
        self.mavproxy: asyncio.subprocess.Process

    def enter(self, *lines: str) -> None:
        """Type lines into MAVProxy."""
        assert self.mavproxy.stdin is not None
        self.mavproxy.stdin.write("".join(f"{line}\n" for line in lines).encode())

    async def until(self, done: Callable[[], bool], what: str) -> None:
        for _ in range(400):
            if done():
                return
            await asyncio.sleep(0.05)
        pytest.fail(f"{what} did not come; MAVProxy said:\n{self.said}")

    def kinds(self) -> set[type]:
        return {type(m) for m in self.got}

    def changes(self) -> list[ParameterChange]:
        """Return the parameters set by hand, without those that the autopilot reports itself."""
        own = (m for m in self.got if isinstance(m, ParameterChange))
        return [m for m in own if not m.key.startswith("autopilot.")]


@asynccontextmanager
async def running(
    folder: Path, standin: Sequence[ByteLink], landerd: ByteLink, *arguments: str
) -> AsyncIterator[Scene]:
    scene = Scene()
    autopilot = plain_autopilot(scene.airframe, standin, flying=True)
    scene.driver = MavlinkAutopilot(landerd, parameters=scene.tuned)

    async def serve() -> None:
        await scene.driver.open()
        while True:
            scene.got.append(await scene.driver.receive())

    async def live() -> None:
        while True:
            await asyncio.sleep(1.0)
            scene.driver.heartbeat()

    async def listen() -> None:
        assert scene.mavproxy.stdout is not None
        while data := await scene.mavproxy.stdout.read(4096):
            scene.said += data.decode(errors="replace")

    tasks = [asyncio.create_task(job) for job in (autopilot.run(), serve(), live())]
    await asyncio.sleep(0.1)
    scene.mavproxy = await asyncio.create_subprocess_exec(
        *(str(MAVPROXY), "--nowait", "--default-modules=param,link,mode", *arguments),
        cwd=folder,
        env={"HOME": str(folder), "PATH": os.environ["PATH"], "PYTHONUNBUFFERED": "1"},
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    tasks.append(asyncio.create_task(listen()))
    try:
        yield scene
    finally:
        scene.mavproxy.kill()
        await scene.mavproxy.wait()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for link in standin:
            await link.close()
        await scene.driver.close()
        await asyncio.sleep(0.05)


def test_it_lists_and_sets_parameters_through_the_autopilots_routing(tmp_path: Path) -> None:
    async def main() -> None:
        port, telem = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
        standin = [open_link(f"tcpin:127.0.0.1:{port}"), open_link(f"udpout:127.0.0.1:{telem}")]
        landerd = open_link(f"udpin:127.0.0.1:{telem}")
        master = ("--master", f"tcp:127.0.0.1:{port}")
        async with running(tmp_path, standin, landerd, *master) as s:
            await s.until(lambda: "online system 1" in s.said, "the vehicle")
            await s.until(lambda: Heartbeat in s.kinds(), "the heartbeat")
            s.enter("set param_ftp False", "set target_component 191", "param fetch")
            await s.until(
                lambda: f"Received {len(parameters())} parameters" in s.said, "the parameter list"
            )
            s.enter("param show PID_UP_*")
            await s.until(lambda: "PID_UP_KP        0.8999999" in s.said, "a value")
            s.enter("param set PID_UP_KP 1.5", "param set LIM_SPEED 2")
            await s.until(lambda: len(s.changes()) > 0, "the change")
            (change,) = s.changes()
            assert (change.key, change.value) == ("guidance.pid.up.kp", 1.5)
            await s.until(lambda: "LIM_SPEED: only while disarmed" in s.said, "the refusal")
            assert s.tuned.value("LIM_SPEED") == Config().guidance.limits.speed_mps

    asyncio.run(asyncio.wait_for(main(), 60.0))


def test_it_lists_within_5_s_although_it_would_fetch_a_file_first(tmp_path: Path) -> None:
    async def main() -> None:
        port, telem = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
        standin = [open_link(f"tcpin:127.0.0.1:{port}"), open_link(f"udpout:127.0.0.1:{telem}")]
        landerd = open_link(f"udpin:127.0.0.1:{telem}")
        master = ("--master", f"tcp:127.0.0.1:{port}", "--load-module=ftp")
        async with running(tmp_path, standin, landerd, *master) as s:
            await s.until(lambda: "online system 1" in s.said, "the vehicle")
            await s.until(lambda: Heartbeat in s.kinds(), "the heartbeat")
            s.enter("set param_ftp True", "set target_component 191", "param fetch")
            async with asyncio.timeout(5.0):
                await s.until(
                    lambda: f"Received {len(parameters())} parameters" in s.said, "the list"
                )

    asyncio.run(asyncio.wait_for(main(), 60.0))


def test_landerd_flies_through_it(tmp_path: Path) -> None:
    async def main() -> None:
        port, out = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
        standin = [open_link(f"tcpin:127.0.0.1:{port}")]
        landerd = open_link(f"udpin:127.0.0.1:{out}")
        urls = ("--master", f"tcp:127.0.0.1:{port}", "--out", f"udpout:127.0.0.1:{out}")
        async with running(tmp_path, standin, landerd, *urls) as s:
            await s.until(
                lambda: s.kinds() >= {Heartbeat, Attitude, LocalPosition, RcChannels}, "telemetry"
            )
            s.enter("mode GUIDED")
            await s.until(
                lambda: any(isinstance(m, Heartbeat) and m.guided for m in s.got), "GUIDED"
            )
            s.driver.fly(Setpoint((1.0, -0.5, 0.25), 0.1))
            await s.until(lambda: s.airframe.velocity != (0.0, 0.0, 0.0), "the set-point")
            assert s.airframe.velocity == pytest.approx((1.0, -0.5, 0.25))

    asyncio.run(asyncio.wait_for(main(), 60.0))
