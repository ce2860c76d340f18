"""Faults of the gimbal: silent, lost, stuck, slipping, reversed, with an offset, late."""

import asyncio
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager

from hw.sim.faults.bench import Bench, Effect, changed, goes_on
from hw.sim.gimbals.sim import GimbalFault, SimGimbal

_SLIPS_EVERY_S = 0.02


def _device(fault: GimbalFault) -> Effect:
    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        with changed(_simulated(bench), fault=fault):
            yield

    return effect


def _simulated(bench: Bench) -> SimGimbal:
    assert isinstance(bench.gimbal, SimGimbal), "checked with the configuration"
    return bench.gimbal


@contextmanager
def _late(bench: Bench, severity: float) -> Iterator[None]:
    with changed(_simulated(bench), late_s=bench.between(0.02, 0.3, severity)):
        yield


def _slip(bench: Bench, yaw: float, pitch: float) -> None:
    """Add these to the errors of the measured angles, rad."""
    slipped = bench.mount.slipped
    bench.mount.slipped = (slipped[0] + yaw, slipped[1] + pitch)


@contextmanager
def _offset(bench: Bench, severity: float) -> Iterator[None]:
    angle = math.radians(bench.between(1.0, 20.0, severity)) * bench.rng.choice((-1.0, 1.0))
    _slip(bench, angle, angle)
    yield
    _slip(bench, -angle, -angle)


@contextmanager
def _slipping(bench: Bench, severity: float) -> Iterator[None]:
    rate = math.radians(bench.between(0.5, 10.0, severity)) * bench.rng.choice((-1.0, 1.0))

    async def slip() -> None:
        while True:
            await asyncio.sleep(_SLIPS_EVERY_S)
            _slip(bench, 0.0, rate * _SLIPS_EVERY_S)

    with goes_on(slip()):  # the offset reached stays after the fault
        yield


@contextmanager
def _stuck(bench: Bench, severity: float) -> Iterator[None]:
    with ExitStack() as stack:
        for axis in (bench.mount.plant.yaw, bench.mount.plant.pitch):
            stack.enter_context(changed(axis, stuck=True))
        yield


@contextmanager
def _reversed(bench: Bench, severity: float) -> Iterator[None]:
    with changed(bench.mount, reversed=True):
        yield


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
