"""Worlds for the tests of the simulated physics."""

from typing import Any

from hw.sim.options import SimOptions
from hw.sim.physics.world import World, stream
from hw.sim.stand_in.ekf import Ekf
from landerd.config.models import VehicleSection
from landerd.pad import Plate

PLATE = Plate(north_m=1.02, south_m=0.62, east_m=0.62, west_m=0.62)  # the thesis's pad


def world(seed: int = 1, began_s: float = 0.0, **options: Any) -> World:
    """Return a world with the thesis's plate; options are those of `sim:`."""
    return World(SimOptions.model_validate(options), VehicleSection(), PLATE, seed, t0=began_s)


def over_pad(seed: int = 1, altitude_m: float = 0.8, **options: Any) -> World:
    """Return a world in which the vehicle hovers close over the landing point."""
    start = {"altitude_m": altitude_m, "follow_from_mps": 0.0, "follow_m": 0.0}
    return world(seed, start=start, **options)


def ekf_in(w: World, seed: int = 1) -> Ekf:
    """Return the estimator of an autopilot in a world."""
    return Ekf(w, w.options.ekf, stream(seed, "ekf"))


def descend(w: World, speed_mps: float, until_s: float, lateral_mps: float = 0.0) -> float | None:
    """Follow the pad and descend; return the time of the detected landing."""
    landed = None
    steps = round((until_s - w.t) / 0.02)
    for _ in range(steps):
        vn, ve, _ = w.pad.velocity
        w.vehicle.order((vn + lateral_mps, ve, speed_mps), 0.0)
        w.advance(w.t + 0.02)
        if landed is None and w.vehicle.landed_detected:
            landed = w.t
    return landed
