"""Runs a log's inputs through the present core, and its frames through the present vision."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from landerd.config.models import Config
from landerd.flightlog import codec
from landerd.flightlog.reader import FlightLog, read_images
from landerd.lander import Lander
from landerd.messages import Command, Frame, Phase, PhaseChange, Sightings
from landerd.vision import Vision

TOLERANCE = 1e-9  # largest difference of commands on machines with other sine functions
PIXEL_TOLERANCE, POSITION_TOLERANCE_M = 0.02, 1e-6  # for sightings on another platform


@dataclass(frozen=True)
class Difference:
    """Where a replay first differs."""

    step: int  # of the core; of vision: the frame's number
    t: float  # s
    field: str  # as "Setpoint.velocity[0]"
    logged: Any
    replayed: Any

    def as_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return asdict(self)


@dataclass
class Comparison:
    """The differences between a replay and its log."""

    compared: int = 0  # commands, or frames
    differing: int = 0
    largest: float = 0.0  # difference of a number; infinite where the shape differs
    first: Difference | None = None

    @property
    def identical(self) -> bool:
        """Whether every byte is the same."""
        return self.differing == 0

    def add(self, step: int, t: float, logged: Any, replayed: Any, what: str) -> None:
        """Compare two JSON values that are not the same."""
        self.differing += 1
        for field, a, b in _differences(logged, replayed, what):
            both = isinstance(a, (int, float)) and isinstance(b, (int, float))
            self.largest = max(self.largest, abs(a - b) if both else math.inf)
            if self.first is None:
                self.first = Difference(step, t, field, a, b)


@dataclass
class Replayed:
    """The commands of the present core on a log's inputs."""

    comparison: Comparison
    steps: list[tuple[float, list[Command]]]  # loop time and commands
    outcome: str | None
    aborts: int


def phases(steps: list[tuple[float, list[Command]]]) -> list[tuple[float, PhaseChange]]:
    """Return the changes of phase among commands, without mere changes of reason."""
    changes: list[tuple[float, PhaseChange]] = []
    for now, commands in steps:
        for command in commands:
            if isinstance(command, PhaseChange):
                before = changes[-1][1].phase if changes else Phase.NOT_LANDING
                if command.phase is not before:
                    changes.append((now, command))
    return changes


def replay(log: FlightLog, config: Config) -> Replayed:
    """Give a core the log's inputs in their order, and compare its commands."""
    lander = Lander(config, log.layout)
    comparison = Comparison()
    steps = []
    for step in log.steps[: log.replayable]:
        commands = list(lander.step(step.message))
        steps.append((step.now, commands))
        encoded = [(type(c).__name__, codec.encode(c)) for c in commands]
        comparison.compared += len(step.json)
        if encoded != step.json:
            logged, replayed = _named(step.json), _named(encoded)
            kinds = [kind for kind, _ in step.json], [kind for kind, _ in encoded]
            if kinds[0] != kinds[1]:
                comparison.add(step.number, step.now, *kinds, "commands")
            else:
                for (kind, a), (_, b) in zip(logged, replayed, strict=True):
                    if a != b or str(a) != str(b):
                        comparison.add(step.number, step.now, a, b, kind)
    return Replayed(comparison, steps, lander.outcome, lander.aborts)


@dataclass
class VisionReplayed:
    """The sightings of the present vision in a log's frames."""

    comparison: Comparison
    pixels: float = 0.0  # largest difference of an outline
    metres: float = 0.0  # largest difference of a position

    @property
    def within_tolerance(self) -> bool:
        """Whether the differences may be due to another platform."""
        return self.pixels <= PIXEL_TOLERANCE and self.metres <= POSITION_TOLERANCE_M


def replay_vision(log: FlightLog, config: Config) -> VisionReplayed | str:
    """Search the log's frames again and compare the sightings; or return why that is impossible.

    Those after the landing, which are not recorded, are left out.
    """
    few = (
        f"{log.images} of {len(log.searched)} searched frames were recorded; vision replays "
        "from log.images=lossless and log.every_nth=1"
    )
    if not log.searched or not log.images:
        return few
    seen = {s.message.seq: s.message for s in log.steps if isinstance(s.message, Sightings)}
    meters = config.camera.exposure == "pad"
    vision = Vision(log.layout, log.camera, config.vision, meters=meters)
    result = VisionReplayed(Comparison())
    for searched, (frame, form) in zip(log.searched, read_images(log.path), strict=False):
        if frame.seq != searched.seq:
            return few
        if form != "png":
            return f"frame {searched.seq} was not recorded without loss"
        if searched.anew:
            vision = Vision(log.layout, log.camera, config.vision, meters=meters)
        sightings = vision.process(Frame(searched.t, searched.seq, frame.image), searched.prior)
        logged = seen.get(searched.seq)
        if logged is None:  # the log ends before the core took these sightings
            continue
        # These two come from the camera, not from vision.
        sightings = replace(sightings, sigma_t=logged.sigma_t, arrived_t=logged.arrived_t)
        result.comparison.compared += 1
        a, b = codec.encode(logged), codec.encode(sightings)
        if a != b:
            result.comparison.add(
                searched.seq, searched.t, json.loads(a), json.loads(b), "Sightings"
            )
            _measure(result, logged, sightings)
    return result


def _measure(result: VisionReplayed, a: Sightings, b: Sightings) -> None:
    if [(m.kind, m.id) for m in a.markers] != [(m.kind, m.id) for m in b.markers] or (
        len(a.pad) != len(b.pad)
    ):
        result.pixels = result.metres = math.inf
        return
    for m, n in zip(a.markers, b.markers, strict=True):
        for p, q in zip(m.outline_px, n.outline_px, strict=False):
            result.pixels = max(result.pixels, math.dist(p, q))
    for x, y in zip(a.pad, b.pad, strict=True):
        result.metres = max(result.metres, math.dist(x.position, y.position))


def _named(encoded: list[tuple[str, bytes]]) -> list[tuple[str, Any]]:
    return [(kind, json.loads(data)) for kind, data in encoded]


def _differences(a: Any, b: Any, where: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield (field, logged, replayed) of all that differs between two JSON values."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(k for k in b if k not in a)]:
            yield from _differences(a.get(key), b.get(key), f"{where}.{key}")
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from _differences(x, y, f"{where}[{i}]")
    elif a != b or repr(a) != repr(b):
        yield where, a, b
