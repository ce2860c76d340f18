"""The pilot, his radio, and what the autopilot decides by itself."""

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from hw.autopilots.arducopter import Mode
from hw.sim.faults.bench import Bench, Effect, changed, goes_on, stand_in

_ASKS_EVERY_S = 0.2


@contextmanager
def _low(bench: Bench, severity: float) -> Iterator[None]:
    bench.vehicle.switch.set(high=False)
    yield
    bench.vehicle.switch.set(high=True)


@contextmanager
def _flapping(bench: Bench, severity: float) -> Iterator[None]:
    period_s = bench.between(1.0, 0.1, severity)

    async def flap() -> None:
        while True:
            bench.vehicle.switch.set(high=False)
            await asyncio.sleep(period_s)
            bench.vehicle.switch.set(high=True)
            await asyncio.sleep(period_s)

    with goes_on(flap()):
        yield
    bench.vehicle.switch.set(high=True)


@contextmanager
def _stuck(bench: Bench, severity: float) -> Iterator[None]:
    with changed(bench.vehicle.switch, stuck=True):
        yield


@contextmanager
def _radio_lost(bench: Bench, severity: float) -> Iterator[None]:
    bench.vehicle.pilot.lose_radio()
    yield
    bench.vehicle.pilot.restore_radio()
    bench.vehicle.pilot.select(Mode.GUIDED)


def _mode(mode: Mode) -> Effect:
    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        bench.vehicle.pilot.select(mode)
        yield
        bench.vehicle.pilot.select(Mode.GUIDED)

    return effect


@contextmanager
def _disarm_refused(bench: Bench, severity: float) -> Iterator[None]:
    with changed(stand_in(bench).copter, refuses_disarm=True):
        yield


@contextmanager
def _disarm_asked(bench: Bench, severity: float) -> Iterator[None]:
    async def ask() -> None:
        while True:
            stand_in(bench).copter.disarm()  # refused in the air
            await asyncio.sleep(_ASKS_EVERY_S)

    with goes_on(ask()):
        yield


@contextmanager
def _restarts(bench: Bench, severity: float) -> Iterator[None]:
    stand_in(bench).reboot()
    yield


FAULTS: Mapping[str, Effect] = {
    "switch-low": _low,
    "switch-flapping": _flapping,
    "switch-stuck": _stuck,
    "rc-lost": _radio_lost,
    "mode-loiter": _mode(Mode.LOITER),
    "mode-rtl": _mode(Mode.RTL),
    "mode-land": _mode(Mode.LAND),
    "disarm-refused": _disarm_refused,
    "disarm-asked": _disarm_asked,
    "autopilot-restarts": _restarts,
}
