"""Every driver with the model of its device, in a world where the vehicle hovers."""

import asyncio
import random
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.links.memory import memory_pair
from hw.sim.gimbals.bench import Bench, Model
from hw.sim.gimbals.mount import SimMount
from hw.sim.options import SimGimbalOptions
from hw.sim.physics.world import World
from hw.sim.stand_in.autopilot import SimAutopilot
from landerd.devices import gimbal_model
from landerd.drivers import gimbal_speaks_over, names, options_models
from landerd.messages import GimbalCommand, GimbalState
from landerd.ports import Gimbal
from landerd.runtime.clock import run_realtime, run_virtual
from tests.hw.sim.worlds import ekf_in, world

DRIVERS = sorted(set(names()["gimbal"]) - {"sim"})
MOVING = [driver for driver in DRIVERS if driver != "fixed"]
ON_BYTES = ["simplebgc", "siyi", "storm32"]
EXACT = {"bias_deg": 0.0, "noise_deg": 0.0}
YAW_AND_PITCH = {  # of servos; the default has no yaw
    "yaw": {"channel": 1, "table": [[-90.0, 2000.0], [90.0, 1000.0]]},
    "pitch": {"channel": 2, "table": [[-135.0, 1000.0], [-45.0, 1500.0], [45.0, 2000.0]]},
}


@dataclass
class Stand:
    """A driver that talks to its model."""

    driver: Any  # a Gimbal with traits
    model: Any  # None where the device has no life of its own
    world: World
    autopilot: SimAutopilot

    async def watch(
        self, seconds: float, command: GimbalCommand | None = None
    ) -> list[GimbalState]:
        """Collect reports for some time, while orders are sent at 40 Hz as by the core."""
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds

        async def order() -> None:
            while command is not None:
                self.driver.command(command)
                await asyncio.sleep(0.025)

        ordering = asyncio.create_task(order())
        states = []
        try:
            while loop.time() < end:
                async with asyncio.timeout_at(end):
                    states.append(await self.driver.state())
        except TimeoutError:
            pass
        finally:
            ordering.cancel()
        return states


def on_stand(
    name: str,
    scene: Callable[[Stand], Awaitable[None]],
    *,
    options: dict[str, Any] | None = None,
    gimbal: dict[str, Any] | None = None,
    realtime: bool = False,
) -> None:
    """Run a scene with a driver that is open."""

    async def main() -> None:
        w = world(gimbal=gimbal or EXACT)
        near, far = memory_pair()
        autopilot = SimAutopilot(w, [far], ekf=ekf_in(w), rng=random.Random(1), flying=True)
        driver = MavlinkAutopilot(near)
        mount = SimMount(w, SimGimbalOptions.model_validate(gimbal or EXACT), random.Random(2))
        connect = gimbal_model(name)
        assert connect is not None
        servo = YAW_AND_PITCH if name.startswith("servo") else {}
        block = options_models()[f"gimbal.{name}"].model_validate(servo | (options or {}))
        gimbal_driver: Gimbal
        model: Model | None
        gimbal_driver, model = connect(block, Bench(mount, autopilot, driver, realtime=realtime))

        async def listen() -> None:
            await driver.open()
            while True:
                await driver.receive()

        tasks = []
        if gimbal_speaks_over(name) == "autopilot":
            tasks += [asyncio.create_task(autopilot.run()), asyncio.create_task(listen())]
            await asyncio.sleep(0.5)  # links are open and streams asked for
        if model is not None:
            tasks.append(asyncio.create_task(model.run()))
        await gimbal_driver.open()
        try:
            await scene(Stand(gimbal_driver, model, w, autopilot))
        finally:
            await gimbal_driver.close()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    (run_realtime if realtime else run_virtual)(main())
