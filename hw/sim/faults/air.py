"""Faults of the air: gusts, and ground effect."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from hw.sim.faults.bench import Bench, Effect, changed
from hw.sim.physics.ground_effect import GroundEffect


@contextmanager
def _gust(bench: Bench, severity: float) -> Iterator[None]:
    speed, way = bench.between(3.0, 12.0, severity), bench.rng.uniform(-math.pi, math.pi)
    with changed(bench.world, gust=(speed * math.cos(way), speed * math.sin(way))):
        yield


@contextmanager
def _ground_effect(bench: Bench, severity: float) -> Iterator[None]:
    effect = GroundEffect(bench.between(0.1, 0.5, severity))
    with changed(bench.world.vehicle, ground_effect=effect):
        yield


FAULTS: Mapping[str, Effect] = {"gust": _gust, "ground-effect": _ground_effect}
