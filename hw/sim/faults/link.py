"""The link between landerd and the autopilot: cut, dead, lossy, corrupted, doubled, late."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Literal
from weakref import WeakKeyDictionary

from hw.links.memory import LinkFaults, MemoryLink
from hw.sim.faults.bench import Bench, Effect

Way = Literal["up", "down", "both"]


def _with(way: Way, settings: Callable[[float], dict[str, Any]]) -> Effect:
    """Return the fault that changes these of the link's faults by the severity."""

    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        ends: list[MemoryLink] = {
            "up": [bench.vehicle.near],
            "down": [bench.vehicle.far],
            "both": [bench.vehicle.near, bench.vehicle.far],
        }[way]
        layer = settings(severity)
        for end in ends:
            _LAYERS.setdefault(end, _Layers(end.faults)).begin(end, layer)
        yield
        for end in ends:
            _LAYERS[end].end(end, layer)

    return effect


class _Layers:
    """The faults of one end, one upon the other: what began first need not end last."""

    def __init__(self, sound: LinkFaults) -> None:
        self._sound = sound
        self._layers: list[dict[str, Any]] = []

    def begin(self, end: MemoryLink, layer: dict[str, Any]) -> None:
        self._layers.append(layer)
        self._apply(end)

    def end(self, end: MemoryLink, layer: dict[str, Any]) -> None:
        self._layers = [each for each in self._layers if each is not layer]
        self._apply(end)

    def _apply(self, end: MemoryLink) -> None:
        end.faults = replace(
            self._sound, **{k: v for each in self._layers for k, v in each.items()}
        )


_LAYERS: WeakKeyDictionary[MemoryLink, _Layers] = WeakKeyDictionary()


@contextmanager
def _cut(bench: Bench, severity: float) -> Iterator[None]:
    bench.vehicle.near.cut()
    yield
    bench.vehicle.near.mend()


FAULTS: Mapping[str, Effect] = {
    "link-cut": _cut,
    "link-dead-up": _with("up", lambda s: {"drop": 1.0}),
    "link-dead-down": _with("down", lambda s: {"drop": 1.0}),
    "link-lossy": _with("both", lambda s: {"drop": 0.02 + 0.48 * s}),
    "link-corrupted": _with("both", lambda s: {"corrupt": 0.001 + 0.019 * s}),
    "link-doubled": _with("both", lambda s: {"double": 0.1 + 0.9 * s}),
    "link-late": _with("both", lambda s: {"delay_s": 0.02 + 0.38 * s}),
}
