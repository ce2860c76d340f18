"""The simulated devices that faults act on, and helpers for faults that overlap in time."""

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
    """The companion computer that runs landerd's process.

    Attributes:
        search_s: time added to the search of a picture, s.
        slow_disk_s: time for which recording a picture blocks the event loop, s.
    """

    search_s: float
    slow_disk_s: float

    def stall(self, duration_s: float) -> None:
        """Block the process for this time, s."""

    def fail(self, part: str, error: Exception | None) -> None:
        """Let a part ("search", "core", "sending", "disk") raise an error; None: no longer."""

    def terminate(self) -> None:
        """Ask the process to end, as SIGTERM and SIGINT do."""

    def kill(self) -> None:
        """Kill the process at once, as SIGKILL does; it is started again."""


@dataclass(frozen=True)
class Vehicle:
    """The autopilot, its link to landerd, and the pilot."""

    near: MemoryLink  # landerd's end of the link
    far: MemoryLink  # the autopilot's end of the link
    tampering: Tampering  # changes the autopilot's messages on their way to landerd
    switch: GateSwitch
    pilot: Pilot
    stand_in: SimAutopilot | None = None  # None: a real autopilot flies


@dataclass(frozen=True)
class Bench:
    """The world, the simulated devices and the computer, on which faults act."""

    world: World
    camera: SimCamera
    gimbal: Gimbal
    mount: SimMount
    vehicle: Vehicle
    computer: Computer
    plate: Plate
    frustum: Frustum
    renderer: Callable[[RenderOptions, PadOptions], Renders]  # makes a renderer
    rng: Random  # random numbers of this fault

    def between(self, least: float, most: float, severity: float) -> float:
        """Map a severity of 0 to 1 linearly to the range from least to most."""
        return least + severity * (most - least)


# Takes the bench and the severity (0 to 1); the fault lasts as long as the context returned.
Effect = Callable[[Bench, float], AbstractContextManager[None]]


def stand_in(bench: Bench) -> SimAutopilot:
    """Return the simulated autopilot, in flights that have no real one."""
    assert bench.vehicle.stand_in is not None, "checked with the command line"
    return bench.vehicle.stand_in


@contextmanager
def changed(target: object, **values: Any) -> Iterator[None]:
    """Set attributes of an object while the context lasts; faults may end in any order."""
    layers = _CHANGED.setdefault(id(target), _Layers(target))
    layers.begin(values)
    try:
        yield
    finally:
        if layers.end(values):
            del _CHANGED[id(target)]


class _Layers:
    """Values that overlapping faults give an object's attributes; the newest fault counts."""

    def __init__(self, target: object) -> None:
        self._target = target
        self._sound: dict[str, Any] = {}
        self._layers: list[dict[str, Any]] = []

    def begin(self, layer: dict[str, Any]) -> None:
        """Add the values of a new fault."""
        for name in layer:
            self._sound.setdefault(name, getattr(self._target, name))
        self._layers.insert(0, layer)
        self._apply()

    def end(self, layer: dict[str, Any]) -> bool:
        """Remove the values of a fault; return whether no fault is left."""
        self._layers = [each for each in self._layers if each is not layer]
        self._apply()
        return not self._layers

    def _apply(self) -> None:
        for name, value in ChainMap(*self._layers, self._sound).items():
            setattr(self._target, name, value)


_CHANGED: dict[int, _Layers] = {}  # by id() of the object, as some objects are not hashable


@contextmanager
def held(
    device: object, what: str, put: Callable[[], None], free: Callable[[], None]
) -> Iterator[Callable[[], bool]]:
    """Keep a part of a device in a state while the context lasts; the newest fault counts.

    Args:
        device: object of the device, the same for all its faults.
        what: name of the part of the device.
        put: brings the part into the state of this fault.
        free: brings it back when no fault is left.

    Yields:
        A function that tells whether this is the newest fault of the part.
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


_HELD: dict[tuple[int, str], list[_Hold]] = {}  # by id() of the device, and part; newest last


@contextmanager
def goes_on(work: Coroutine[None, None, None]) -> Iterator[None]:
    """Run an endless coroutine while the context lasts."""
    task = asyncio.create_task(work)
    yield
    task.cancel()
