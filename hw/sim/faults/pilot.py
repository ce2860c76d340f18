"""Acts of the pilot, faults of the radio, and what the autopilot decides by itself."""

import asyncio
import itertools
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager

from hw.autopilots.arducopter import Mode
from hw.sim.faults.bench import Bench, Effect, changed, goes_on, held, stand_in
from hw.sim.stand_in.switch import Pilot

_ASKS_EVERY_S = 0.2


def _switch_held(bench: Bench) -> AbstractContextManager[Callable[[], bool]]:
    switch = bench.vehicle.switch
    return held(switch, "switch", lambda: switch.set(high=False), lambda: switch.set(high=True))


@contextmanager
def _low(bench: Bench, severity: float) -> Iterator[None]:
    with _switch_held(bench):
        yield


@contextmanager
def _flapping(bench: Bench, severity: float) -> Iterator[None]:
    period_s = bench.between(1.0, 0.1, severity)

    with _switch_held(bench) as is_ours:

        async def flap() -> None:
            for high in itertools.cycle((False, True)):
                if is_ours():
                    bench.vehicle.switch.set(high=high)
                await asyncio.sleep(period_s)

        with goes_on(flap()):
            yield


@contextmanager
def _stuck(bench: Bench, severity: float) -> Iterator[None]:
    with changed(bench.vehicle.switch, stuck=True):
        yield


@contextmanager
def _radio_lost(bench: Bench, severity: float) -> Iterator[None]:
    pilot = bench.vehicle.pilot
    # Without a radio the pilot selects no mode, not even GUIDED; the autopilot flies home.
    with (
        _mode_held(pilot, lambda: None),
        held(pilot, "radio", pilot.lose_radio, pilot.restore_radio),
    ):
        yield


def _mode(mode: Mode) -> Effect:
    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        pilot = bench.vehicle.pilot
        with _mode_held(pilot, lambda: pilot.select(mode)):
            yield

    return effect


def _mode_held(pilot: Pilot, put: Callable[[], None]) -> AbstractContextManager[Callable[[], bool]]:
    return held(pilot, "mode", put, lambda: pilot.select(Mode.GUIDED))


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
