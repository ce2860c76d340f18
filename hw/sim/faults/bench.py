"""What faults act on (the bench), what a fault is, and helpers for faults that overlap."""

import asyncio
from collections import ChainMap
from collections.abc import Callable, Coroutine, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from random import Random
from typing import Any, Protocol

from hw.links.memory import MemoryLink
from hw.sim.gimbals.mount import SimMount
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.physics.world import World
from hw.sim.picture.camera import Renders, SimCamera
from hw.sim.picture.view import Frustum
from hw.sim.stand_in.autopilot import SimAutopilot
from hw.sim.stand_in.switch import GateSwitch, Pilot
from hw.sim.tampering import Tampering
from landerd.pad import Plate
from landerd.ports import Gimbal


class Computer(Protocol):
    """The companion computer with landerd's process.

    Attributes:
        search_s: added to what the search of a picture takes, s.
        slow_disk_s: for so long a picture that is recorded holds up the loop, s.
    """

    search_s: float
    slow_disk_s: float

    def stall(self, duration_s: float) -> None:
        """Let the process stand still."""

    def fail(self, part: str, error: Exception | None) -> None:
        """Let a part ("search", "core", "sending", "disk") raise this from now on; None: end it."""

    def terminate(self) -> None:
        """Tell the process to stop, as SIGTERM and SIGINT do."""

    def kill(self) -> None:
        """End the process at once; it is started again."""


@dataclass(frozen=True)
class Vehicle:
    """The autopilot, its link and who flies it."""

    near: MemoryLink  # landerd's end of its link
    far: MemoryLink  # the autopilot's end
    tampering: Tampering  # what becomes of the autopilot's messages
    switch: GateSwitch
    pilot: Pilot
    stand_in: SimAutopilot | None = None  # None: a real autopilot flies


@dataclass(frozen=True)
class Bench:
    """The simulated devices, the world, and the computer."""

    world: World
    camera: SimCamera
    gimbal: Gimbal
    mount: SimMount
    vehicle: Vehicle
    computer: Computer
    plate: Plate
    frustum: Frustum
    renderer: Callable[[RenderOptions, PadOptions], Renders]  # makes one
    rng: Random  # the fault's own

    def between(self, least: float, most: float, severity: float) -> float:
        """Return what a severity of 0 to 1 is on a scale."""
        return least + severity * (most - least)


# From the bench and the severity: the fault is there while the context is.
Effect = Callable[[Bench, float], AbstractContextManager[None]]


def stand_in(bench: Bench) -> SimAutopilot:
    """Return the autopilot that is in this process."""
    assert bench.vehicle.stand_in is not None, "checked with the command line"
    return bench.vehicle.stand_in


@contextmanager
def changed(target: object, **values: Any) -> Iterator[None]:
    """Give an object's attributes these values; overlapping faults may end in any order."""
    layers = _CHANGED.setdefault(id(target), _Layers(target))
    layers.begin(values)
    try:
        yield
    finally:
        if layers.end(values):
            del _CHANGED[id(target)]


class _Layers:
    """Values of an object's attributes by overlapping faults; the newest is on top."""

    def __init__(self, target: object) -> None:
        self._target = target
        self._sound: dict[str, Any] = {}
        self._layers: list[dict[str, Any]] = []

    def begin(self, layer: dict[str, Any]) -> None:
        """Lay these values on top."""
        for name in layer:
            self._sound.setdefault(name, getattr(self._target, name))
        self._layers.insert(0, layer)
        self._apply()

    def end(self, layer: dict[str, Any]) -> bool:
        """Take these values away; return whether none are left."""
        self._layers = [each for each in self._layers if each is not layer]
        self._apply()
        return not self._layers

    def _apply(self) -> None:
        for name, value in ChainMap(*self._layers, self._sound).items():
            setattr(self._target, name, value)


_CHANGED: dict[int, _Layers] = {}  # by the object's id: some cannot be keys


@contextmanager
def held(
    device: object, what: str, put: Callable[[], None], free: Callable[[], None]
) -> Iterator[Callable[[], bool]]:
    """Hold a part of a device in place; of overlapping faults the newest one says where.

    Args:
        device: the same object for all of them.
        what: of the device.
        put: holds it there.
        free: lets it go once nobody holds it.

    Yields:
        A function that tells whether this fault is the newest that holds it.
    """
    hold = _Hold(put)
    holds = _HELD.setdefault((id(device), what), [])
    holds.append(hold)
    put()
    try:
        yield lambda: holds[-1] is hold
    finally:
        holds.remove(hold)
        if not holds:
            del _HELD[id(device), what]
    if holds:
        holds[-1].put()
    else:
        free()


@dataclass(frozen=True, eq=False)
class _Hold:
    put: Callable[[], None]


_HELD: dict[tuple[int, str], list[_Hold]] = {}  # by the device's id; the newest is the last


@contextmanager
def goes_on(work: Coroutine[None, None, None]) -> Iterator[None]:
    """Run an endless coroutine for as long as a fault lasts."""
    task = asyncio.create_task(work)
    yield
    task.cancel()
