"""Random values that a seed gave a simulated flight, other than distributions in its options."""

import math

from hw.sim.gimbals.mount import SimMount
from hw.sim.physics.world import World
from hw.sim.stand_in.ekf import Ekf


def seed_draws(world: World, mount: SimMount, ekf: Ekf | None) -> dict[str, float]:
    """Return the random values by key, `drawn.…`, for the result's `world`.

    Args:
        world: at the start, before the vehicle moves.
        mount: the gimbal.
        ekf: of the simulated autopilot; None: a real one flies.
    """
    vehicle, pad = world.vehicle, world.pad
    drawn = {
        "start.north_m": vehicle.position[0] - pad.position[0],
        "start.east_m": vehicle.position[1] - pad.position[1],
        "start.heading_deg": math.degrees(vehicle.yaw),
        "gimbal.yaw_bias_deg": math.degrees(mount.yaw_bias),
        "gimbal.pitch_bias_deg": math.degrees(mount.pitch_bias),
    }
    if ekf is not None:
        drawn["ekf.velocity_bias_north_mps"] = ekf.velocity_bias[0]
        drawn["ekf.velocity_bias_east_mps"] = ekf.velocity_bias[1]
        drawn["ekf.height_scale"] = ekf.height_scale
    return {f"drawn.{key}": value for key, value in drawn.items()}
