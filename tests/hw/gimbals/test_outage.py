"""A gimbal whose cable is pulled, or that is switched off: the outage is told, then it works again.

The whole daemon with the real driver over a real socket or terminal; its device comes and goes.
"""

import asyncio
import logging
import random

import pytest

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.links.memory import memory_pair
from hw.sim.gimbals.bench import Bench
from hw.sim.gimbals.byte_model import ByteModel
from hw.sim.gimbals.mount import SimMount
from hw.sim.options import SimGimbalOptions
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.config.models import Config
from landerd.devices import gimbal_model
from landerd.drivers import options_models
from landerd.messages import Command, GimbalState, Input
from landerd.pad import load_pad
from landerd.runtime.clock import run_realtime
from landerd.runtime.daemon import Daemon, Devices
from landerd.runtime.observer import Observer
from tests.hw.gimbals.benches import EXACT, ON_BYTES
from tests.hw.idle import Idle
from tests.hw.sim.worlds import world

AWAY_S = 1.6  # longer than a driver waits for an answer
BACK_S = 1.0


class Heard(Observer):
    """An observer that keeps the times of gimbal angles."""

    def __init__(self) -> None:
        self.times: list[float] = []

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        if isinstance(message, GimbalState):
            self.times.append(now)


@pytest.mark.parametrize("name", ON_BYTES)
def test_an_outage_is_told_and_over_within_a_second(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "landerd")
    run_realtime(asyncio.wait_for(scene(name), 30.0))
    told = [r.getMessage() for r in caplog.records if r.getMessage().startswith("gimbal ")]
    assert told[0].startswith("gimbal lost: ")
    assert "no answer" in told[0]
    assert told[1:] == ["gimbal is back"]


async def scene(name: str) -> None:
    loop = asyncio.get_running_loop()
    mount = SimMount(world(gimbal=EXACT), SimGimbalOptions.model_validate(EXACT), random.Random(2))
    autopilot = MavlinkAutopilot(memory_pair()[0])
    connect = gimbal_model(name)
    assert connect is not None
    block = options_models()[f"gimbal.{name}"]()
    gimbal, model = connect(block, Bench(mount, None, autopilot, realtime=True))
    assert isinstance(model, ByteModel)
    heard, idle = Heard(), Idle()
    daemon = Daemon(
        Config(),
        load_pad(config_dir() / "pads" / "thesis.yaml"),
        load_camera(config_dir() / "cameras" / "thesis.yaml"),
        Devices(idle, gimbal, autopilot),
        observers=(heard,),
    )
    tasks = [asyncio.create_task(job) for job in (model.run(), daemon.run())]
    try:
        while len(heard.times) < 20:
            await asyncio.sleep(0.01)
        model.silent = True
        await asyncio.sleep(AWAY_S)
        assert heard.times[-1] < loop.time() - 0.5 * AWAY_S
        model.silent = False
        back = loop.time()
        while heard.times[-1] < back:
            await asyncio.sleep(0.01)
        assert heard.times[-1] < back + BACK_S
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
