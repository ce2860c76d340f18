"""Faults of the companion computer: stalls, unexpected exceptions, the disk, signals."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from hw.sim.faults.bench import Bench, Effect, changed, held


def _raising(part: str, error: Exception) -> Effect:
    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        computer = bench.computer
        with held(
            computer, part, lambda: computer.fail(part, error), lambda: computer.fail(part, None)
        ):
            yield

    return effect


@contextmanager
def _core_raises(bench: Bench, severity: float) -> Iterator[None]:
    bench.computer.fail("core", OverflowError("in the core"))  # only once, at its next step
    yield


@contextmanager
def _stalls(bench: Bench, severity: float) -> Iterator[None]:
    bench.computer.stall(bench.between(0.1, 3.0, severity))
    yield


@contextmanager
def _slow_search(bench: Bench, severity: float) -> Iterator[None]:
    with changed(bench.computer, search_s=bench.between(0.1, 3.0, severity)):
        yield


@contextmanager
def _slow_disk(bench: Bench, severity: float) -> Iterator[None]:
    with changed(bench.computer, slow_disk_s=bench.between(0.01, 0.1, severity)):
        yield


@contextmanager
def _terminated(bench: Bench, severity: float) -> Iterator[None]:
    bench.computer.terminate()
    yield


@contextmanager
def _killed(bench: Bench, severity: float) -> Iterator[None]:
    bench.computer.kill()
    yield


FAULTS: Mapping[str, Effect] = {
    "loop-stalls": _stalls,
    "search-slow": _slow_search,
    "search-raises": _raising("search", ZeroDivisionError("in vision")),
    "core-raises": _core_raises,
    "sending-raises": _raising("sending", KeyError("in the autopilot's driver")),
    "disk-full": _raising("disk", OSError(28, "No space left on device")),
    "disk-slow": _slow_disk,
    "sigterm": _terminated,
    "sigint": _terminated,
    "killed": _killed,
}
