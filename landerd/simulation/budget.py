"""Benchmark of this computer: the daemon searches a simulated landing's pictures in real time.

The landing is flown once, as fast as possible, and recorded. Then its pictures, telemetry and
gimbal angles are played to a new daemon in real time, so that drawing the pictures does not count.
"""

import asyncio
import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from landerd.config.files import Loaded
from landerd.messages import (
    AutopilotMessage,
    Command,
    Frame,
    GimbalCommand,
    GimbalState,
    Input,
    LandingTarget,
    PressDown,
    Prior,
    RcChannels,
    Setpoint,
    Shutdown,
    Sightings,
    StatusText,
    Tick,
)
from landerd.ports import GimbalTraits
from landerd.runtime.clock import run_realtime, run_virtual
from landerd.runtime.daemon import Daemon, Devices
from landerd.runtime.observer import Observer
from landerd.simulation.flight import Simulation
from landerd.vision import Vision

# Largest number of pictures; they are of the last part of the flight, where set-points follow them.
_PICTURES = 300
_LONGEST_S = 60.0  # longest duration of the simulated flight
_ON_THE_WAY_S = 0.03  # age of pictures when they arrive

T = TypeVar("T")
_LANDERS_OWN = (Tick, Shutdown, Sightings)  # inputs that the daemon makes itself


@dataclass(frozen=True)
class Budget:
    """What was measured; the times are those of pictures that a set-point followed."""

    pictures_hz: float  # rate at which pictures are searched one after the other
    median_s: float  # median time from a picture's arrival to the next set-point
    p99_s: float  # 99th percentile of that time
    pictures: int  # number of pictures with such a time
    gap_s: float  # longest time between two steps of the control task


def measure(loaded: Loaded) -> Budget:
    """Return the speed of this computer; it takes a minute to measure a slow one.

    Args:
        loaded: a configuration for the simulator.

    Raises:
        CalibrationError: the camera's calibration cannot be used.
        PadError: the pad's layout cannot be used.
    """
    kept = _Kept()
    simulation = Simulation(loaded, 1, observers=(kept,))
    run_virtual(simulation.run(longest_s=_LONGEST_S))
    del kept.frames[:-_PICTURES]
    vision = Vision(simulation.layout, simulation.camera_model, loaded.config.vision)
    began = time.perf_counter()
    for frame, prior in kept.frames:
        vision.process(frame, prior)
    pictures_hz = len(kept.frames) / (time.perf_counter() - began)

    times, traits = _Times(), simulation.gimbal.traits
    gap_s = run_realtime(_play(kept, simulation, traits, times))
    after = np.array(times.after or [np.inf])
    median_s, p99_s = (float(q) for q in np.quantile(after, (0.5, 0.99), method="nearest"))
    return Budget(pictures_hz, median_s, p99_s, len(times.after), gap_s)


async def _play(
    kept: "_Kept", simulation: Simulation, traits: GimbalTraits, times: "_Times"
) -> float:
    """Run a new daemon on the recorded input; return its control task's longest gap, s."""
    # It starts early enough to know its position, and that it may fly, before the first picture.
    begin = kept.frames[0][0].t - 3.0
    shift = asyncio.get_running_loop().time() + 0.5 - begin
    frames = [frame for frame, _ in kept.frames]
    messages = [_switch_low_before(begin + 2.0, m) for m in kept.messages if m.t > begin]
    devices = Devices(
        _Camera(_Played(frames, shift, lambda f: f.t + _ON_THE_WAY_S, newest=True)),
        _Gimbal(_Played([s for s in kept.angles if s.t > begin], shift, lambda s: s.t), traits),
        _Autopilot(_Played(messages, shift, lambda m: m.t)),
    )
    daemon = Daemon(
        simulation.config,
        simulation.layout,
        simulation.camera_model,
        devices,
        observers=(times,),
    )
    running = asyncio.create_task(daemon.run())
    await asyncio.wait({running}, timeout=frames[-1].t - begin + 1.0)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    return daemon.monitor.longest_s


def _switch_low_before(t: float, message: AutopilotMessage) -> AutopilotMessage:
    """Return a message with the pilot's switches low if it is older than t, s.

    landerd flies only after it has seen the switch low.
    """
    if not isinstance(message, RcChannels) or message.t > t:
        return message
    return dataclasses.replace(message, channels_us=(1000,) * len(message.channels_us))


@dataclass
class _Kept(Observer):
    """Records all input of a flight."""

    frames: list[tuple[Frame, Prior]] = field(default_factory=list)
    angles: list[GimbalState] = field(default_factory=list)
    messages: list[AutopilotMessage] = field(default_factory=list)

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        self.frames.append((frame, prior))
        del self.frames[: -2 * _PICTURES]  # to save memory: a picture may have a megabyte

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        if isinstance(message, GimbalState):
            self.angles.append(message)
        elif not isinstance(message, _LANDERS_OWN):
            self.messages.append(message)


@dataclass
class _Times(Observer):
    """Measures the time from each picture's arrival to the set-point that used it."""

    after: list[float] = field(default_factory=list)
    _came: float | None = None

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        if isinstance(message, Sightings):
            self._came = message.t + _ON_THE_WAY_S
        elif self._came is not None and any(isinstance(c, Setpoint) for c in commands):
            self.after.append(now - self._came)
            self._came = None


# ---- devices that play -------------------------------------------------------------------------


class _Played(Generic[T]):
    """Hands out recorded items at their times; after the last one it waits forever."""

    def __init__(
        self, things: list[T], shift: float, due: Callable[[T], float], *, newest: bool = False
    ) -> None:
        """Take recorded items.

        Args:
            things: items with a time `t` each, in order.
            shift: the loop's time minus that of the recording, s.
            due: returns the time of the recording at which an item arrives, s.
            newest: whether items that have not been fetched are replaced by later ones.
        """
        self._things, self._shift, self._due, self._newest = things, shift, due, newest
        self._next = 0

    async def next(self) -> T:
        """Wait for the next item; return it with its time on the loop's clock."""
        loop = asyncio.get_running_loop()
        if self._next == len(self._things):
            await asyncio.Event().wait()
        await asyncio.sleep(self._due_at(self._next) - loop.time())
        while self._newest and self._next + 1 < len(self._things):
            if self._due_at(self._next + 1) > loop.time():
                break
            self._next += 1
        thing = self._things[self._next]
        self._next += 1
        return dataclasses.replace(thing, t=thing.t + self._shift)  # type: ignore[type-var,attr-defined]

    def _due_at(self, i: int) -> float:
        return self._due(self._things[i]) + self._shift


class _Device:
    async def open(self) -> None: ...

    async def close(self) -> None: ...


class _Camera(_Device):
    def __init__(self, played: _Played[Frame]) -> None:
        self.newest = played.next


class _Gimbal(_Device):
    def __init__(self, played: _Played[GimbalState], traits: GimbalTraits) -> None:
        self.state, self.traits = played.next, traits

    def command(self, command: GimbalCommand) -> None: ...


class _Autopilot(_Device):
    """Accepts all orders and obeys none."""

    counters: Mapping[str, int] = {}
    vehicle_parameters: Mapping[str, float] = {}

    def __init__(self, played: _Played[AutopilotMessage]) -> None:
        self.receive = played.next

    def ask_parameter(self, name: str) -> None: ...

    def heartbeat(self) -> None: ...

    def fly(self, setpoint: Setpoint) -> None: ...

    def press_down(self, order: PressDown) -> None: ...

    def tell(self, text: StatusText) -> None: ...

    def disarm(self) -> None: ...

    def show_target(self, target: LandingTarget) -> None: ...

    def plot(self, values: Mapping[str, float]) -> None: ...
