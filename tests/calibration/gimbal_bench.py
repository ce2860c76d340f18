"""A vehicle that stands still over a pad, with a real driver, its model, and real vision."""

import asyncio
import random
from typing import Any

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.links.memory import memory_pair
from hw.sim.gimbals.bench import Bench
from hw.sim.gimbals.byte_model import ByteModel
from hw.sim.gimbals.mount import SimMount
from hw.sim.options import SimOptions
from hw.sim.physics.pad_motion import PadState
from hw.sim.physics.world import World
from hw.sim.picture.camera import SimCamera
from hw.sim.picture.renderer import Renderer
from hw.sim.stand_in.autopilot import SimAutopilot
from landerd.camera_model import load_camera
from landerd.commands.calibrate_gimbal import calibrate_gimbal
from landerd.config.files import Loaded, config_dir
from landerd.devices import gimbal_model
from landerd.drivers import read_configuration
from landerd.pad import load_pad
from landerd.runtime.clock import run_virtual
from landerd.runtime.daemon import Devices
from tests.hw.sim.worlds import ekf_in

STANDS = (  # as on a table, the pad before it; little is disturbed
    "sim.start={position_m: [-2.6, 0.0], altitude_m: 1.5, spread_m: 0.0, heading_spread_deg: 0.0}",
    "sim.gimbal.bias_deg=0.0",
    "sim.gimbal.noise_deg=0.02",
    "sim.camera={fps: 15.0, clock_offset_s: 0.0}",
)


class Standing(World):
    """A vehicle that stands on a table: only the gimbal moves."""

    def _move(self, pad: PadState | None) -> None:
        pass


def set_up(*overrides: str) -> Loaded:
    """Return the configuration of the stationary scenario with overrides, KEY=VALUE."""
    return read_configuration(
        config_dir() / "default.yaml",
        overlays=[config_dir() / "scenarios" / "stationary.yaml"],
        overrides=[*STANDS, *overrides],
    )


def calibrated(
    loaded: Loaded, *, armed: bool = False, speaks: bool = True, late_s: float = 0.0
) -> dict[str, Any]:
    """Calibrate the gimbal and return the report.

    Args:
        loaded: the configuration; `sim.gimbal.mount` is how the gimbal really is built in.
        armed: the vehicle is.
        speaks: the autopilot does.
        late_s: answers of a gimbal on bytes come so much later.
    """
    config = loaded.config
    sim = loaded.options["sim"]
    assert isinstance(sim, SimOptions)
    layout, camera_model = load_pad(config.pad.layout), load_camera(config.camera.calibration)
    world = Standing(sim, config.vehicle, layout.plate, seed=0)
    near, far = memory_pair()
    stand_in = SimAutopilot(
        world, [far], ekf=ekf_in(world, seed=0), rng=random.Random(1), flying=armed
    )
    autopilot = MavlinkAutopilot(near)
    connect = gimbal_model(config.gimbal.driver)
    assert connect is not None
    mount = SimMount(world, sim.gimbal, random.Random(2))
    bench = Bench(mount, stand_in, autopilot, realtime=False)
    gimbal, model = connect(loaded.options[f"gimbal.{config.gimbal.driver}"], bench)
    if late_s:
        assert isinstance(model, ByteModel)
        model.late_s = late_s
    # The camera really is the packaged one, whatever calibration the configuration has.
    lens = load_camera(config_dir() / "cameras" / "thesis.yaml")
    camera = SimCamera(
        Renderer(layout, lens, sim.render, 1, sim.camera), world.snapshot, sim.camera
    )
    assert (lens.width, lens.height) == (camera_model.width, camera_model.height)

    async def main() -> dict[str, Any]:
        jobs = [stand_in.run()] if speaks else []
        jobs += [model.run()] if model is not None else []
        tasks = [asyncio.create_task(job) for job in jobs]
        try:
            return await calibrate_gimbal(loaded, Devices(camera, gimbal, autopilot))
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    return run_virtual(main())
