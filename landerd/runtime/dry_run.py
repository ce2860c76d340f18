"""Runs the core and vision over a recording; the orders are not sent to any device."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from landerd.camera_model import CameraModel
from landerd.config.models import Config
from landerd.lander import Lander
from landerd.messages import (
    Command,
    Frame,
    GimbalCommand,
    Heartbeat,
    Input,
    RcChannels,
    Setpoint,
    Sightings,
    Tick,
)
from landerd.pad import PadLayout
from landerd.runtime.observer import Observer
from landerd.vision import Vision

VISION_LATENCY_S = 0.1  # from exposure to the sighting, on a small board
GATE_LOW_S = 1.0  # time for which the assumed pilot's switch is low before it is high
HEARTBEAT_S, RC_S = 1.0, 0.05
LOW_US, HIGH_US = 1100, 1900

Measure = Callable[[float], Sequence[Input]]
Expose = Callable[[float], Frame | None]


@dataclass
class DryRunResult:
    """What the core ordered during the recording."""

    frames: int = 0
    seen: int = 0  # number of frames in which the pad was found
    first_seen_t: float | None = None
    setpoints: int = 0
    steps: list[tuple[float, list[Command]]] = field(default_factory=list)
    outcome: str | None = None


class DryRun:
    """Feeds the core like a vehicle that is armed and in GUIDED, with the pilot's switch high."""

    def __init__(
        self,
        config: Config,
        layout: PadLayout,
        camera: CameraModel,
        observers: Iterable[Observer] = (),
    ) -> None:
        self._config = config
        self._vision = Vision(layout, camera, config.vision)
        self._observers = tuple(observers)
        self.lander = Lander(config, layout)
        self.gimbal = GimbalCommand(0.0, 0.0)  # as last ordered
        self.result = DryRunResult()

    def run(self, start: float, end: float, measure: Measure, expose: Expose) -> None:
        """Run from start to end, s on the recording's clock.

        Args:
            start: time of the first tick, s.
            end: time of the last tick, s.
            measure: returns the telemetry up to a time (s) that it has not returned yet, in order.
            expose: returns the oldest picture exposed up to a time (s) that it has not returned
                yet.
        """
        for observer in self._observers:
            observer.on_flight(self.lander)
        beat = rc = start - 10.0
        period = 1.0 / self._config.control.rate_hz
        for i in range(int((end - start) / period)):
            now = start + i * period
            if now - beat >= HEARTBEAT_S:
                beat = now
                self._step(now, Heartbeat(now, armed=True, guided=True, mode="GUIDED"))
            if now - rc >= RC_S:
                rc = now
                self._step(now, self._pulses(now, now - start < GATE_LOW_S))
            for message in measure(now):
                self._step(now, message)
            while (frame := expose(now - VISION_LATENCY_S)) is not None:
                if frame.t >= start:
                    self._search(now, frame)
            self._step(now, Tick(now))
        self.result.outcome = self.lander.outcome

    def _pulses(self, now: float, low: bool) -> RcChannels:
        gate = self._config.rc.gate_channel
        pulses = [1500] * 18
        pulses[gate - 1] = LOW_US if low else HIGH_US
        return RcChannels(now, tuple(pulses))

    def _search(self, now: float, frame: Frame) -> None:
        prior = self.lander.prior(frame.t)
        sightings: Sightings = self._vision.process(frame, prior)
        result = self.result
        result.frames += 1
        if sightings.pad:
            result.seen += 1
            result.first_seen_t = frame.t if result.first_seen_t is None else result.first_seen_t
        for observer in self._observers:
            observer.on_frame(frame, prior, sightings)
        self._step(now, sightings)

    def _step(self, now: float, message: Input) -> None:
        commands = list(self.lander.step(message))
        self.result.steps.append((now, commands))
        for command in commands:
            if isinstance(command, GimbalCommand):
                self.gimbal = command
            elif isinstance(command, Setpoint):
                self.result.setpoints += 1
        for observer in self._observers:
            observer.on_step(now, message, commands)
