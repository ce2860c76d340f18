"""What the page shows of the flight, gathered by the control task while somebody looks.

The control task only puts the newest view into a place for one; the server's threads take it from
there and make text and pictures of it. Nobody looks: nothing is put there.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass
from typing import TypeVar

from landerd.config.models import Config
from landerd.estimation.health import Health
from landerd.estimation.pad_filter import SensorErrors
from landerd.guidance.pilot_texts import PREFIX
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.states import State
from landerd.messages import (
    Attitude,
    Battery,
    Command,
    Frame,
    GimbalState,
    Heartbeat,
    Input,
    LocalPosition,
    Phase,
    Prior,
    RcChannels,
    Severity,
    Sightings,
    StatusText,
    Tick,
)
from landerd.runtime.daemon import Daemon
from landerd.runtime.observer import Observer

M = TypeVar("M", bound=Input)

VIEW_S = 0.2  # a new view as often as an eye can use
LOOKED_AT_S = 2.0  # how long after a request views are still made
MOST_LINES = 12
RATED = (Tick, Sightings, Attitude, LocalPosition, GimbalState, RcChannels, Heartbeat)
_WINDOW = 11  # views over which rates are taken: 2 s
_LATENCIES = 64  # pictures


@dataclass(frozen=True, slots=True)
class Line:
    """Something that the pilot was told."""

    t: float  # loop time, s
    text: str
    is_urgent: bool


@dataclass(frozen=True, slots=True)
class View:
    """Everything that the page shows, at one time; immutable."""

    t: float  # loop time, s
    config: Config
    state: State
    phase: Phase
    reason: str
    outcome: str | None
    aborts: int
    relative: RelativeState | None
    sensors: SensorErrors
    health: Health | None  # of the last moments; None: nothing was seen
    heartbeat: Heartbeat | None
    rc: RcChannels | None
    attitude: Attitude | None
    position: LocalPosition | None
    battery: Battery | None
    ages: dict[str, float]  # s, of the newest message of a type
    rates: dict[str, float]  # 1/s, of messages of a type
    pad_age: float  # s since the exposure of the last picture with the pad
    latencies: tuple[float, ...]  # s from exposure to the core
    gaps: int  # of the control task
    longest_gap_s: float
    faults: dict[str, int]
    lines: tuple[Line, ...]  # oldest first
    frame: Frame | None
    sightings: Sightings | None  # of that frame


class LiveView(Observer):
    """An observer that keeps the newest view while it is looked at.

    Attributes:
        newest: the last view, None before the first.
        armed: by the last heartbeat; True before the first, as the vehicle may be flying.
    """

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self._rate_hz = daemon.lander.config.control.rate_hz
        self._looked_at = 0  # ticks for which somebody still looks
        self._viewed_t = -math.inf
        self._stepped_t = 0.0
        self._messages: dict[type, Input] = {}
        self._counts: Counter[type[Input]] = Counter()
        self._counted: deque[tuple[float, Counter[type[Input]]]] = deque(maxlen=_WINDOW)
        self._latencies: deque[float] = deque(maxlen=_LATENCIES)
        self._lines: deque[Line] = deque(maxlen=MOST_LINES)
        self._pad_t = -math.inf
        self._frame: Frame | None = None
        self._sightings: Sightings | None = None
        self.newest: View | None = None
        self.armed = True

    def look(self) -> View | None:
        """Return the newest view, and have more made for a while; from any thread."""
        was_looked_at = self._looked_at > 0
        self._looked_at = int(LOOKED_AT_S * self._rate_hz)
        return self.newest if was_looked_at else None  # else it may be hours old

    def finish(self) -> None:
        """Keep the last view for good; the daemon runs no more."""
        self.newest = self._view(self._stepped_t)
        self._looked_at = 1

    # ---- seen by the control task: must not wait -----------------------------------------------

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Keep the newest picture, and no other."""
        self._frame, self._sightings = frame, sightings

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Keep the newest of each type; make a view now and again, if somebody looks."""
        for command in commands:
            if isinstance(command, StatusText):
                text = command.text.removeprefix(PREFIX)
                self._lines.append(Line(now, text, command.severity <= Severity.WARNING))
        kind = type(message)
        self._stepped_t = now
        self._messages[kind] = message
        if isinstance(message, Heartbeat):
            self.armed = message.armed
        if isinstance(message, Sightings) and message.pad:
            self._pad_t = message.t
        if isinstance(message, Tick):
            self._tick(now)
        if self._looked_at <= 0:
            return
        self._counts[kind] += 1
        if isinstance(message, Sightings):
            self._latencies.append(now - message.t)

    def _tick(self, now: float) -> None:
        if self._looked_at <= 0:
            return
        self._looked_at -= 1
        if self._looked_at == 0:
            self._forget()
        elif now - self._viewed_t >= VIEW_S:
            self._viewed_t = now
            self.newest = self._view(now)

    def _forget(self) -> None:
        """Let go of what would be a gap in the rates."""
        self.newest = None
        self._counted.clear()
        self._latencies.clear()

    def _view(self, now: float) -> View:
        lander, monitor = self._daemon.lander, self._daemon.monitor
        self._counted.append((now, self._counts.copy()))
        return View(
            t=now,
            config=lander.config,
            state=lander.state,
            phase=lander.phase,
            reason=lander.reason,
            outcome=lander.outcome,
            aborts=lander.aborts,
            relative=lander.relative_state(now),
            sensors=lander.sensor_errors,
            health=lander.health,
            heartbeat=self._last(Heartbeat),
            rc=self._last(RcChannels),
            attitude=self._last(Attitude),
            position=self._last(LocalPosition),
            battery=self._last(Battery),
            ages={kind.__name__: now - m.t for kind, m in self._messages.items()},
            rates=self._rates(),
            pad_age=now - self._pad_t,
            latencies=tuple(self._latencies),
            gaps=monitor.gaps.total(),
            longest_gap_s=monitor.longest_s,
            faults=dict(self._daemon.faults),
            lines=tuple(self._lines),
            frame=self._frame,
            sightings=self._sightings,
        )

    def _last(self, kind: type[M]) -> M | None:
        message = self._messages.get(kind)
        return message if isinstance(message, kind) else None

    def _rates(self) -> dict[str, float]:
        (t0, first), (t1, last) = self._counted[0], self._counted[-1]
        if t1 <= t0:
            return {}
        return {kind.__name__: (last[kind] - first[kind]) / (t1 - t0) for kind in RATED}
