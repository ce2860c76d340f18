"""Faults of the link to the autopilot: cut, dead, lossy, corrupted, doubled, late."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, Literal

from hw.links.memory import MemoryLink
from hw.sim.faults.bench import Bench, Effect, changed, held

Way = Literal["up", "down", "both"]


def _with(way: Way, settings: Callable[[float], dict[str, Any]]) -> Effect:
    """Return a fault that sets fields of LinkFaults by its severity."""

    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        ends: list[MemoryLink] = {
            "up": [bench.vehicle.near],
            "down": [bench.vehicle.far],
            "both": [bench.vehicle.near, bench.vehicle.far],
        }[way]
        with ExitStack() as stack:
            for end in ends:
                stack.enter_context(changed(end.faults, **settings(severity)))
            yield

    return effect


@contextmanager
def _cut(bench: Bench, severity: float) -> Iterator[None]:
    link = bench.vehicle.near
    with held(link, "link", link.cut, link.mend):
        yield


FAULTS: Mapping[str, Effect] = {
    "link-cut": _cut,
    "link-dead-up": _with("up", lambda s: {"drop": 1.0}),
    "link-dead-down": _with("down", lambda s: {"drop": 1.0}),
    "link-lossy": _with("both", lambda s: {"drop": 0.02 + 0.48 * s}),
    "link-corrupted": _with("both", lambda s: {"corrupt": 0.001 + 0.019 * s}),
    "link-doubled": _with("both", lambda s: {"double": 0.1 + 0.9 * s}),
    "link-late": _with("both", lambda s: {"delay_s": 0.02 + 0.38 * s}),
}
