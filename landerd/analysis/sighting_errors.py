"""Errors of sightings from flight logs alone, of real or simulated flights.

The true position of a marker is taken to be that seen from nearby at the end of the flight, so that
a sighting from far away is compared to what the same flight knew later. (The thesis had its
simulator's truth: 3.3, 3.4.) Only flights onto a pad that stood still are used.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, median
from typing import NamedTuple

from landerd.analysis.flight import Flight
from landerd.analysis.intervals import mean_interval, percentile, with_interval
from landerd.analysis.page import Block, Heading, Lines, Table, Text
from landerd.analysis.regression import in_words, regression
from landerd.config.files import ConfigError, from_record
from landerd.estimation.camera_pose import PoseHistory
from landerd.estimation.observation import Clocks, ObservationModel
from landerd.geometry import Vec3, norm, sub, wrap
from landerd.messages import Attitude, GimbalState, LocalPosition, Sightings

NEAREST = 20  # number of nearest sightings of a marker whose median is its true pose
STANDS_MPS = 0.1  # largest estimated speed of a pad that stands still
BIN_M = 2.0  # width of the table's bins of distance


class Seen(NamedTuple):
    """A marker seen in one picture, in the local frame of the flight's beginning."""

    kind: str
    range_m: float
    position: Vec3  # m
    heading: float | None  # rad; None: the marker shows none


@dataclass(frozen=True)
class Judged:
    """The error of one sighting."""

    kind: str
    range_m: float
    error_m: float
    yaw_error_rad: float | None  # absolute; None: the marker shows no heading


def judged(flight: Flight) -> list[Judged] | None:
    """Return the errors of a flight's sightings; None: its pad moved, or its speed is unknown.

    Raises:
        ConfigError: the log's configuration cannot be used.
    """
    speeds = [norm(s.relative.pad_velocity) for s in flight.log.states if s.relative is not None]
    if not speeds or median(speeds) > STANDS_MPS:
        return None
    by_kind: dict[str, list[Seen]] = {}
    for seen in _sightings(flight):
        by_kind.setdefault(seen.kind, []).append(seen)
    return [each for of_kind in by_kind.values() for each in _against_nearest(of_kind)]


def _sightings(flight: Flight) -> list[Seen]:
    """Return all markers seen, by their likelier pose and the telemetry at the exposure."""
    log = flight.log
    config, _ = from_record(log.config, log.path.name)
    poses = PoseHistory(config)
    model = ObservationModel(config.estimation, poses)
    sensors = next((s.sensors for s in reversed(log.states) if s.sensors is not None), None)
    late_s = config.camera.clock_offset_s if sensors is None else sensors.clock_s
    found = []
    for step in log.steps:
        message = step.message
        if isinstance(message, (LocalPosition, Attitude, GimbalState)):
            poses.add(message)
        elif isinstance(message, Sightings):
            for marker in message.markers:
                o = model.observe(message.t, marker.solutions[0], Clocks(pictures_s=late_s))
                if o is not None:
                    found.append(Seen(marker.kind, o.range_m, o.position, o.heading))
    return found


def _against_nearest(seen: Sequence[Seen]) -> list[Judged]:
    """Return the errors of the sightings of one marker against its nearest ones."""
    nearest = sorted(seen, key=lambda s: s.range_m)[:NEAREST]
    x, y, z = (median(s.position[i] for s in nearest) for i in range(3))
    headings = [s.heading for s in nearest if s.heading is not None]
    # The median is taken of differences to the first, as angles wrap around at pi.
    truth = headings[0] + median(wrap(h - headings[0]) for h in headings) if headings else None
    return [
        Judged(
            s.kind,
            s.range_m,
            norm(sub(s.position, (x, y, z))),
            None if truth is None or s.heading is None else abs(wrap(s.heading - truth)),
        )
        for s in seen
    ]


def section(flights: Sequence[Flight]) -> list[Block]:
    """Return the part of a report on errors of the sightings of flights; empty: there are none."""
    sightings: list[Judged] = []
    count = 0
    for flight in flights:
        try:
            found = judged(flight)
        except ConfigError:
            continue  # the log is of a version of landerd with another configuration
        if found:
            sightings += found
            count += 1
    if not sightings:
        return []
    intro = (
        f"Of {count} flights onto a pad that stood. Each sighting is judged by where the same "
        f"marker was seen from nearby (the {NEAREST} nearest sightings of the flight). Behind ± "
        "are 95 % intervals of the means."
    )
    blocks: list[Block] = [Heading("How true the sightings were", 2), Text(intro)]
    for kind in dict.fromkeys(s.kind for s in sightings):
        blocks += _of_kind(kind, [s for s in sightings if s.kind == kind])
    return blocks


def _of_kind(kind: str, sightings: Sequence[Judged]) -> list[Block]:
    """Return heading, table by distance, and regressions for one kind of marker."""
    bins: dict[int, list[Judged]] = {}
    for each in sightings:
        bins.setdefault(int(each.range_m / BIN_M), []).append(each)
    rows = []
    for i in sorted(bins):
        errors = [s.error_m for s in bins[i]]
        yaws = [s.yaw_error_rad for s in bins[i] if s.yaw_error_rad is not None]
        yaw = math.nan if not yaws else fmean(yaws)
        rows.append(
            [
                f"{i * BIN_M:g} to {(i + 1) * BIN_M:g}",
                str(len(errors)),
                with_interval(fmean(errors), mean_interval(errors), 3),
                f"{percentile(errors, 95.0):.3f}",
                with_interval(yaw, mean_interval(yaws), 3) if yaws else "-",
            ]
        )
    head = ["distance m", "sightings", "error m", "p95", "yaw error rad"]
    return [Heading(kind, 3), Table(head, rows), Lines(_regressions(sightings))]


def _regressions(sightings: Sequence[Judged]) -> list[str]:
    """Return lines on the regressions of errors over the distance."""
    errors = regression([s.range_m for s in sightings], [s.error_m for s in sightings], 3)
    known = [(s.range_m, s.yaw_error_rad) for s in sightings if s.yaw_error_rad is not None]
    yaws = regression([x for x, _ in known], [y for _, y in known], 2)
    return [
        f"{name} {in_words(fit)}"
        for name, fit in (("error m", errors), ("yaw error rad", yaws))
        if fit is not None
    ]
