"""A landing from its flight log: its time series, and sentences about it, for reports."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from datetime import UTC, datetime
from statistics import median
from typing import NamedTuple

from landerd.analysis.intervals import percentile
from landerd.analysis.picture import Sample
from landerd.flightlog.contents import State
from landerd.flightlog.reader import FlightLog, Step
from landerd.flightlog.replay import phases
from landerd.geometry import Vec3, add, norm, sub
from landerd.messages import (
    Battery,
    ClockSync,
    Heartbeat,
    LocalPosition,
    Phase,
    PhaseChange,
    Setpoint,
    Sightings,
    Tick,
)

SIGHT_M = 18.0  # slant range from which the thesis counts time and energy (3.6)


class AgeBudget(NamedTuple):
    """Age of a picture at the first control step that could use it, in parts, s."""

    t: float  # time of that control step since the beginning of the log
    camera: float  # from the middle of the exposure until the driver delivered the picture
    vision: float  # from then until it was searched
    wait: float  # from then until the control step
    clock: float  # uncertainty of all that, by the driver's time stamp and the autopilot's clock

    @property
    def age(self) -> float:
        """Age of the picture at that control step, s."""
        return self.camera + self.vision + self.wait


@dataclass
class Flight:
    """The time series of one log; times are s since its beginning."""

    log: FlightLog
    name: str  # by which the reader knows it
    zero: float  # beginning of the log on the loop's clock, s
    positions: list[tuple[float, LocalPosition]] = field(default_factory=list)
    setpoints: list[tuple[float, Setpoint]] = field(default_factory=list)
    sightings: list[Sightings] = field(default_factory=list)
    batteries: list[Battery] = field(default_factory=list)
    changes: list[tuple[float, PhaseChange]] = field(default_factory=list)
    disarmed_t: float | None = None  # None: the vehicle was not disarmed
    budgets: list["AgeBudget"] = field(default_factory=list)

    @property
    def title(self) -> str:
        """The flight's name, with a remark if it is a dry run's."""
        return self.name + (" (dry run)" if self.log.is_dry else "")

    @property
    def end(self) -> float:
        """Length of the log, s."""
        return self.log.steps[-1].now - self.zero

    @property
    def first_sight_t(self) -> float | None:
        """Time of the first sighting of the pad within SIGHT_M, s; None: there was none."""
        for s in self.sightings:
            if s.pad and norm(s.pad[0].position) <= SIGHT_M:
                return s.t - self.zero
        return None

    @property
    def energy_j(self) -> float | None:
        """Energy from the first sighting to disarming, J; None: unknown."""
        if self.first_sight_t is None or self.disarmed_t is None:
            return None
        a, b = self._energy_at(self.first_sight_t), self._energy_at(self.disarmed_t)
        return None if a is None or b is None else b - a

    def _energy_at(self, t: float) -> float | None:
        """Return the energy consumed until a time, s, in J; None: it is not reported."""
        known = [
            (b.t - self.zero, b.energy_consumed_j)
            for b in self.batteries
            if b.energy_consumed_j is not None
        ]
        if len(known) < 2 or not known[0][0] <= t:
            return None
        i = min(len(known) - 1, max(1, bisect_right([k[0] for k in known], t)))
        (t0, e0), (t1, e1) = known[i - 1], known[i]
        return e0 + (e1 - e0) * (min(t, t1) - t0) / (t1 - t0)

    def state_at(self, t: float) -> State | None:
        """Return the last state in the log until a time, s; None: there is none."""
        before = [s for s in self.log.states if s.t - self.zero <= t + 1e-6]
        return before[-1] if before else None

    def samples(self) -> list[Sample]:
        """Return estimated positions of vehicle and pad: north, east, up of its last place, m."""
        gear = float(self.log.config.get("vehicle", {}).get("gear_height_m", 0.0))
        times = [t for t, _ in self.positions]
        found: list[tuple[float, Vec3, Vec3, Phase]] = []
        for state in self.log.states:
            i = bisect_right(times, state.t - self.zero) - 1
            if state.relative is None or i < 0:
                continue
            feet = add(self.positions[i][1].position, (0.0, 0.0, gear))
            pad = add(feet, state.relative.error)
            found.append((state.t - self.zero, feet, pad, state.phase))
        if not found:
            return []
        origin = found[-1][2]

        def place(p: Vec3) -> Vec3:
            x, y, z = sub(p, origin)
            return (x, y, -z)

        return [Sample(t, place(feet), place(pad), phase) for t, feet, pad, phase in found]


def flight_of(log: FlightLog, name: str | None = None) -> Flight:
    """Return the time series of a log.

    Args:
        log: as read.
        name: of the flight; None: that of its file, without its folder.
    """
    zero = log.steps[0].now
    flight = Flight(log, name or log.path.name, zero)
    armed = False
    budget = _Budgeting(flight)
    for step in log.steps:
        budget.take(step)
        t, message = step.now - zero, step.message
        if isinstance(message, LocalPosition):
            flight.positions.append((t, message))
        elif isinstance(message, Sightings):
            flight.sightings.append(message)
        elif isinstance(message, Battery):
            flight.batteries.append(message)
        elif isinstance(message, Heartbeat):
            if armed and not message.armed and flight.disarmed_t is None:
                flight.disarmed_t = t
            armed = armed or message.armed
        flight.setpoints += [(t, c) for c in step.commands if isinstance(c, Setpoint)]
    flight.changes = [(t - zero, c) for t, c in phases([(s.now, s.commands) for s in log.steps])]
    return flight


class _Budgeting:
    """Adds an `AgeBudget` to a flight for every picture."""

    def __init__(self, flight: Flight) -> None:
        """Take the flight, whose log has the configuration."""
        self._flight = flight
        self._offset_s = float(flight.log.config.get("camera", {}).get("clock_offset_s", 0.0))
        self._clock_s = 0.0
        # Sightings not used by a control step yet, and the time since when, s.
        self._waiting: tuple[float, Sightings] | None = None

    def take(self, step: Step) -> None:
        """Take the next step of the log."""
        message = step.message
        if isinstance(message, ClockSync):
            self._clock_s = message.uncertainty_s
        elif isinstance(message, Sightings):
            self._waiting = (step.now, message)
        elif isinstance(message, Tick) and self._waiting is not None:
            searched_t, seen = self._waiting
            self._waiting = None
            if seen.arrived_t is None:
                return
            self._flight.budgets.append(
                AgeBudget(
                    step.now - self._flight.zero,
                    seen.arrived_t - seen.t + self._offset_s,
                    searched_t - seen.arrived_t,
                    step.now - searched_t,
                    math.hypot(seen.sigma_t, self._clock_s),
                )
            )


def sentences(flight: Flight) -> list[str]:
    """Return sentences on the log, on each event in order, on the outcome and on the estimate."""
    log = flight.log
    seen = len([s for s in flight.sightings if s.pad])
    rate = len(flight.sightings) / flight.end if flight.end > 0.0 else 0.0
    told = [
        f"{_when(log)}, pad: {log.layout.name}.",
        f"The log covers {flight.end:.1f} s; {len(flight.sightings)} pictures were searched "
        f"({rate:.0f} a second), and the pad was seen in {seen} of them.",
    ]
    told += [text for _, text in sorted(_events(flight), key=lambda event: event[0])]
    if not flight.changes:
        told.append("landerd never took over.")
    last = log.states[-1] if log.states else None
    if last is not None:
        lost = {0: "never", 1: "once"}.get(last.aborts, f"{last.aborts} times")
        told.append(f"While flying, landerd lost sight of the pad {lost}.")
        ended = last.outcome or "none yet: the log ends before the landing does"
        told.append(f"Outcome: {ended.replace('_', ' ')}.")
    return [*told, *_health(flight, last)]


def _when(log: FlightLog) -> str:
    """Return the date of a log in words, and whether it was flown."""
    if log.is_dry:
        return "A dry run on a recorded flight: landerd's orders were not flown"
    if log.wall_offset_s == 0.0:
        return "Simulated time, without a date"
    began = datetime.fromtimestamp(log.steps[0].now + log.wall_offset_s, UTC)
    return f"{began:%Y-%m-%d %H:%M:%S} UTC by the computer's clock"


def _events(flight: Flight) -> list[tuple[float, str]]:
    """Return events of a flight: times, s, and sentences."""
    events = [
        (t, f"At {t:.1f} s: {_phase(change)}{_where(flight, t)}.") for t, change in flight.changes
    ]
    first = flight.first_sight_t
    if first is not None:
        text = f"The pad was first seen within {SIGHT_M:.0f} m at {first:.1f} s."
        events.append((first, text))
    landed = flight.disarmed_t
    if landed is None:
        return events
    text = f"The motors were off at {landed:.1f} s"
    if first is not None:
        text += f", {landed - first:.1f} s after first sight"
    if flight.energy_j is not None:
        hj, wh = flight.energy_j / 100.0, flight.energy_j / 3600.0
        text += f", for {hj:.1f} hJ ({wh:.2f} Wh; the thesis counts in hJ, hectojoules, 100 J each)"
    state = flight.state_at(landed)
    if state is not None and state.relative is not None:
        off = 100.0 * state.relative.distance
        text += f"; by landerd's own estimate it then stood {off:.0f} cm from the landing point"
    return [*events, (landed, f"{text}.")]


def _health(flight: Flight, last: State | None) -> list[str]:
    """Return sentences on innovations, ages of pictures, and estimated errors of clock and lens."""
    if last is None or last.sensors is None or not flight.sightings:
        return []
    s = last.sensors
    return [
        *_fit(flight),
        *_ages(flight),
        f"Found of the camera, give or take 1 sigma: its pictures are stamped "
        f"{1e3 * s.clock_s:.1f} ± {1e3 * s.sigma_clock_s:.1f} ms late; it looks "
        f"{math.degrees(s.up):.2f} ± {math.degrees(s.sigma_up):.2f} degrees higher and "
        f"{math.degrees(s.right):.2f} ± {math.degrees(s.sigma_right):.2f} farther right.",
    ]


def _fit(flight: Flight) -> list[str]:
    """Return a sentence on the sightings' innovations; empty: they are not in the log."""
    known = [s.health for s in flight.log.states if s.health is not None]
    if not known:
        return []
    nis = [h.nis for h in known]
    refused = [100.0 * h.refused for h in known]
    return [
        f"Over two seconds each the mean NIS of the sightings was {median(nis):.1f}, at most "
        f"{max(nis):.1f} (3 is expected), and at most {max(refused):.0f} % were refused."
    ]


def _ages(flight: Flight) -> list[str]:
    """Return a sentence on the ages of pictures; empty: they are not in the log."""
    if not flight.budgets:
        return []
    ages = [1e3 * b.age for b in flight.budgets]
    camera, vision, wait, clock = (
        1e3 * median(part) for part in list(zip(*flight.budgets, strict=True))[1:]
    )
    return [
        f"Pictures were {median(ages):.0f} ms old at the control step that could first fly on "
        f"them ({percentile(ages, 95.0) or 0.0:.0f} ms in 95 of 100): {camera:.0f} ms camera and "
        f"transport, {vision:.0f} ms vision, {wait:.0f} ms waiting (medians); the clocks leave "
        f"{clock:.0f} ms of doubt."
    ]


def _phase(change: PhaseChange) -> str:
    """Return a phase and its reason in words."""
    return f"{change.phase.value} ({change.reason})"


def _where(flight: Flight, t: float) -> str:
    """Return where the vehicle was at a time, s, relative to the pad, in words; may be empty."""
    state = flight.state_at(t)
    if state is None or state.relative is None:
        return ""
    relative = state.relative
    return (
        f"; {relative.distance:.1f} m from the pad and {relative.height:.1f} m over it, "
        f"give or take {max(0.01, relative.sigma_m):.2f} m"
    )
