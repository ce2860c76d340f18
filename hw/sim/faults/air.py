"""The air: gusts, and that over the ground."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from hw.sim.faults.bench import Bench, Effect
from hw.sim.physics.ground_effect import GroundEffect


@contextmanager
def _gust(bench: Bench, severity: float) -> Iterator[None]:
    speed, way = bench.between(3.0, 12.0, severity), bench.rng.uniform(-math.pi, math.pi)
    bench.world.gust = (speed * math.cos(way), speed * math.sin(way))
    yield
    bench.world.gust = (0.0, 0.0)


@contextmanager
def _ground_effect(bench: Bench, severity: float) -> Iterator[None]:
    vehicle = bench.world.vehicle
    before = vehicle.ground_effect
    vehicle.ground_effect = GroundEffect(bench.between(0.1, 0.5, severity))
    yield
    vehicle.ground_effect = before


FAULTS: Mapping[str, Effect] = {"gust": _gust, "ground-effect": _ground_effect}
