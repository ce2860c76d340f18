"""A simulated vehicle that stands disarmed near a pad, for bench tests without hardware."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.links.memory import memory_pair
from hw.sim.physics.world import World, stream
from hw.sim.picture.lens import true_camera
from hw.sim.picture.pad_print import printed
from hw.sim.stand_in.autopilot import SimAutopilot
from hw.sim.stand_in.ekf import Ekf
from landerd.camera_model import load_camera
from landerd.config.files import Loaded
from landerd.devices import sim_options, simulated_camera, simulated_gimbal
from landerd.geometry import Vec3, add
from landerd.pad import load_pad
from landerd.runtime.daemon import Devices

_STILL = {"speed_mps": 0.0, "turn_rate_deg_s": 0.0, "heave_m": 0.0, "sway_m": 0.0}


@asynccontextmanager
async def standing(loaded: Loaded, pad: Vec3, seed: int) -> AsyncIterator[Devices]:
    """Simulate a vehicle that stands level until the context is left; yield its devices.

    Args:
        loaded: the configuration, whose simulated world gives light, camera, gimbal and errors.
        pad: landing point relative to the gimbal's pivot, ahead, right and down, m; the pad's north
            points ahead.
        seed: of all that is random.
    """
    config, options = loaded.config, sim_options(loaded)
    ahead, right, down = add(pad, config.vehicle.camera_offset_m)
    start = options.start.model_copy(
        update={
            "position_m": (-ahead, -right),
            "altitude_m": down,
            "heading_deg": 0.0,
            "bearings": 1,
            "spread_m": 0.0,
            "heading_spread_deg": 0.0,
        }
    )
    lying = {**_STILL, "heading_deg": 0.0, "height_m": 0.0, "tilt_deg": 0.0}
    wind = options.wind.model_copy(update={"speed_mps": 0.0, "gust_mps": 0.0})
    sim = options.model_copy(
        update={"start": start, "pad": options.pad.model_copy(update=lying), "wind": wind}
    )
    loaded = replace(loaded, options={**loaded.options, "sim": sim})
    # The true lens and print may differ from the files that landerd uses.
    layout = printed(load_pad(config.pad.layout), sim.pad, seed)
    lens = true_camera(load_camera(config.camera.calibration), sim.camera.calibration_error)
    now = asyncio.get_running_loop().time()
    world = World(sim, config.vehicle, layout.plate, seed, now)
    near, far = memory_pair()
    stand_in = SimAutopilot(
        world, [far], ekf=Ekf(world, sim.ekf, stream(seed, "ekf")), rng=stream(seed, "autopilot")
    )
    autopilot = MavlinkAutopilot(near)
    gimbal = simulated_gimbal(loaded, world, seed, autopilot, stand_in, realtime=False)
    camera = simulated_camera(loaded, layout, lens, world, seed, lambda *_: None)
    jobs: list[Callable[[], Awaitable[None]]] = [stand_in.run]
    if gimbal.model is not None:
        jobs.append(gimbal.model.run)
    tasks = [asyncio.ensure_future(job()) for job in jobs]
    try:
        yield Devices(camera, gimbal.driver, autopilot)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
