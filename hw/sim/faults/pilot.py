"""The pilot, his radio, and what the autopilot decides by itself."""

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from hw.autopilots.arducopter import Mode
from hw.sim.faults.bench import Bench, Effect


@contextmanager
def _low(bench: Bench, severity: float) -> Iterator[None]:
    bench.switch.set(high=False)
    yield
    bench.switch.set(high=True)


@contextmanager
def _flapping(bench: Bench, severity: float) -> Iterator[None]:
    period_s = bench.between(1.0, 0.1, severity)

    async def flap() -> None:
        while True:
            bench.switch.set(high=False)
            await asyncio.sleep(period_s)
            bench.switch.set(high=True)
            await asyncio.sleep(period_s)

    flapping = asyncio.create_task(flap())
    yield
    flapping.cancel()
    bench.switch.set(high=True)


@contextmanager
def _stuck(bench: Bench, severity: float) -> Iterator[None]:
    bench.switch.stuck = True
    yield
    bench.switch.stuck = False


@contextmanager
def _radio_lost(bench: Bench, severity: float) -> Iterator[None]:
    bench.autopilot.pilot.lose()
    yield
    bench.autopilot.pilot.restore()
    bench.autopilot.copter.set_mode(Mode.GUIDED)


def _mode(mode: Mode) -> Effect:
    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        bench.autopilot.copter.set_mode(mode)
        yield
        bench.autopilot.copter.set_mode(Mode.GUIDED)

    return effect


@contextmanager
def _disarm_refused(bench: Bench, severity: float) -> Iterator[None]:
    bench.autopilot.copter.refuses_disarm = True
    yield
    bench.autopilot.copter.refuses_disarm = False


@contextmanager
def _restarts(bench: Bench, severity: float) -> Iterator[None]:
    bench.autopilot.reboot()
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
    "autopilot-restarts": _restarts,
}
