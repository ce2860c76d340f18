"""`landerd run` as a process over a real link: the vehicle, a ground station, signed or not."""

import asyncio
import os
import signal
import socket
import sys
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec
from hw.autopilots.signing import Signing
from hw.links import open_link
from hw.links.memory import memory_pair
from landerd.config.files import config_dir
from tests.hw.flight import Client, PlainAirframe, plain_autopilot

ROOT = Path(__file__).parents[2]
# Only the simulator has devices of the name "sim": here they are some that say nothing.
RUN = """
import sys
from landerd.drivers import DRIVERS, Driver
for section in ("camera", "gimbal"):
    DRIVERS[section]["sim"] = Driver("tests.hw.idle:Idle", "tests.hw.idle:IdleOptions")
from landerd.cli import main
sys.exit(main(["run", *sys.argv[1:]]))
"""


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        port: int = s.getsockname()[1]
        return port


async def landerd(folder: Path, *arguments: str, before: str = "") -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", before + RUN, *arguments),
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=asyncio.subprocess.PIPE,
    )


async def until(done: Any, what: str) -> None:
    for _ in range(600):
        if done():
            return
        await asyncio.sleep(0.05)
    pytest.fail(f"{what} did not come")


def test_it_serves_a_vehicle_and_a_ground_station_and_ends_when_told(tmp_path: Path) -> None:
    port = free_port()
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        f"include: [{config_dir() / 'default.yaml'}]\n"
        f"autopilot: {{url: 'udpin:127.0.0.1:{port}'}}\n"
    )

    async def main() -> None:
        near, far = memory_pair()
        client = Client(near)
        standin = plain_autopilot(
            PlainAirframe((0.0, 0.0, 0.0)),
            [far, open_link(f"udpout:127.0.0.1:{port}")],
        )
        tasks = [asyncio.create_task(job) for job in (standin.run(), client.run())]
        process = await landerd(tmp_path, "-c", "mine.yaml")

        def heard(kind: str) -> list[Any]:
            return [m for _, m in client.of(kind) if m.get_srcComponent() == 191]

        await until(lambda: heard("HEARTBEAT"), "its heartbeat")
        await until(lambda: len(standin._channels[1].streams) == 5, "its wish for messages")
        await until(lambda: heard("NAMED_VALUE_FLOAT"), "its figures")
        await until(lambda: "landerd: not armed" in client.texts, "its reason not to fly")
        client.send(mavlink.MAVLink_param_set_message(1, 191, b"RC_GATE_CH", 9.0, 9))
        client.send(mavlink.MAVLink_command_long_message(1, 191, 245, 0, 1.0, *(0.0,) * 6))
        await until(lambda: heard("COMMAND_ACK"), "its acknowledgement")
        assert heard("COMMAND_ACK")[-1].result == 0
        assert "gate_channel: 9" in (tmp_path / "mine.saved.yaml").read_text()
        process.send_signal(signal.SIGTERM)
        assert await asyncio.wait_for(process.wait(), 20.0) == 0
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await standin._channels[1].link.close()
        # What was saved is in force at the next start, and a wrong value in it is told.
        (tmp_path / "mine.saved.yaml").write_text("rc: {gate_channel: 99}\n")
        process = await landerd(tmp_path, "-c", "mine.yaml")
        _, stderr = await asyncio.wait_for(process.communicate(), 20.0)
        assert process.returncode == 2
        assert b"mine.saved.yaml:1: rc.gate_channel: found 99" in stderr

    asyncio.run(asyncio.wait_for(main(), 90.0))


def test_with_a_key_all_messages_are_signed_and_a_key_that_others_may_read_is_refused(
    tmp_path: Path,
) -> None:
    key = tmp_path / "key"
    key.write_text("correct horse")
    key.chmod(0o600)
    (tmp_path / "key.time").write_text("")  # as a loss of power may leave it

    async def main() -> None:
        heard: list[Any] = []
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as s:
            s.bind(("127.0.0.1", 0))
            port = s.getsockname()[1]
        link = open_link(f"tcpin:127.0.0.1:{port}")
        await link.open()
        config = (
            *("-c", str(config_dir() / "default.yaml")),
            *("--set", f"autopilot.url=tcp:127.0.0.1:{port}"),
            *("--set", f"autopilot.signing_key={key}"),
        )
        process = await landerd(tmp_path, *config)
        codec = MavlinkCodec(255, 190, Signing(key, tmp_path / "peer.time"))
        while not heard:
            heard += codec.decode(await asyncio.wait_for(link.read(), 20.0))
        assert not codec.counters
        process.send_signal(signal.SIGTERM)
        assert await asyncio.wait_for(process.wait(), 20.0) == 0
        await link.close()
        key.chmod(0o644)
        process = await landerd(tmp_path, *config)
        _, stderr = await asyncio.wait_for(process.communicate(), 20.0)
        assert process.returncode == 2
        assert stderr.decode() == (f"{key}: others may read the key; expected: chmod 600 {key}\n")
        await asyncio.sleep(0.05)

    asyncio.run(asyncio.wait_for(main(), 90.0))


# The core fails at the first tick after the vehicle's heartbeats are there.
FAILING = """
from landerd.lander import Lander
from landerd.messages import Heartbeat, Tick
sound, heard = Lander.step, []
def step(self, message):
    heard.extend([message] if isinstance(message, Heartbeat) else [])
    if isinstance(message, Tick) and len(heard) > 2:
        raise OverflowError("in the core")
    return sound(self, message)
Lander.step = step
"""


def test_a_core_that_fails_ends_the_process_with_code_1_so_that_systemd_restarts_it(
    tmp_path: Path,
) -> None:
    port = free_port()

    async def main() -> None:
        near, far = memory_pair()
        client = Client(near)
        standin = plain_autopilot(
            PlainAirframe((0.0, 0.0, 0.0)), [far, open_link(f"udpout:127.0.0.1:{port}")]
        )
        tasks = [asyncio.create_task(job) for job in (standin.run(), client.run())]
        file = str(config_dir() / "default.yaml")
        url = f"autopilot.url=udpin:127.0.0.1:{port}"
        process = await landerd(tmp_path, "-c", file, "--set", url, before=FAILING)
        _, stderr = await asyncio.wait_for(process.communicate(), 60.0)
        assert process.returncode == 1
        assert b"the core failed" in stderr
        assert b"OverflowError: in the core" in stderr
        await asyncio.sleep(0.1)
        assert "landerd: failed: pilot, take over" in client.texts
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await standin._channels[1].link.close()

    asyncio.run(asyncio.wait_for(main(), 90.0))
