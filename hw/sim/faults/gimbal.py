"""The gimbal: silent, lost, stuck, slipping, reversed, off, late."""

import asyncio
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from hw.sim.faults.bench import Bench, Effect, goes_on
from hw.sim.gimbals.sim import GimbalFault, SimGimbal

_SLIPS_EVERY_S = 0.02


def _device(fault: GimbalFault) -> Effect:
    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        gimbal = _simulated(bench)
        gimbal.fault = fault
        yield
        gimbal.fault = None

    return effect


def _simulated(bench: Bench) -> SimGimbal:
    assert isinstance(bench.gimbal, SimGimbal), "checked with the configuration"
    return bench.gimbal


@contextmanager
def _late(bench: Bench, severity: float) -> Iterator[None]:
    gimbal = _simulated(bench)
    gimbal.late_s = bench.between(0.02, 0.3, severity)
    yield
    gimbal.late_s = 0.0


@contextmanager
def _offset(bench: Bench, severity: float) -> Iterator[None]:
    angle = math.radians(bench.between(1.0, 20.0, severity)) * bench.rng.choice((-1.0, 1.0))
    bench.mount.slipped = (angle, angle)
    yield
    bench.mount.slipped = (0.0, 0.0)


@contextmanager
def _slipping(bench: Bench, severity: float) -> Iterator[None]:
    rate = math.radians(bench.between(0.5, 10.0, severity)) * bench.rng.choice((-1.0, 1.0))

    async def slip() -> None:
        while True:
            await asyncio.sleep(_SLIPS_EVERY_S)
            yaw, pitch = bench.mount.slipped
            bench.mount.slipped = (yaw, pitch + rate * _SLIPS_EVERY_S)

    with goes_on(slip()):  # it stays where it has slipped to
        yield


@contextmanager
def _stuck(bench: Bench, severity: float) -> Iterator[None]:
    axes = (bench.mount.plant.yaw, bench.mount.plant.pitch)
    for axis in axes:
        axis.stuck = True
    yield
    for axis in axes:
        axis.stuck = False


@contextmanager
def _reversed(bench: Bench, severity: float) -> Iterator[None]:
    bench.mount.reversed = True
    yield
    bench.mount.reversed = False


FAULTS: Mapping[str, Effect] = {
    "gimbal-silent": _device(GimbalFault.SILENT),
    "gimbal-frozen": _device(GimbalFault.FROZEN),
    "gimbal-nan": _device(GimbalFault.NAN),
    "gimbal-lost": _device(GimbalFault.LOST),
    "gimbal-raises": _device(GimbalFault.RAISES),
    "gimbal-late": _late,
    "gimbal-offset": _offset,
    "gimbal-slipping": _slipping,
    "gimbal-stuck": _stuck,
    "gimbal-reversed": _reversed,
}
