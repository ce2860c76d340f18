"""ArduPilot's own recordings: DataFlash `.bin` and telemetry `.tlog`, as one set of tracks.

Times are the autopilot's, in s since its boot. Positions are its local NED.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hw.replay.dataflash import MARKER, has_formats
from hw.replay.dataflash_flight import read_dataflash
from hw.replay.recorded import EARTH_M, Recorded, attitude_track, local, position_track
from hw.replay.tlog_flight import read_tlog
from hw.replay.track import Span, Track

LEAST_RATE_HZ = 2.0  # slower telemetry says too little between its measurements

_GUESSED = {  # what else a position is that the estimator's own is not
    "GLOBAL_POSITION_INT": "position is from GLOBAL_POSITION_INT, metres about its first place",
    "POS": "position is from POS, its velocities are differences: no estimator's own in it",
    "GPS": "position is the GPS receiver's, metres off and late: no estimator's in it",
}


class TelemetryError(Exception):
    """A recording cannot be used; the text names the file and what is missing."""


@dataclass
class Telemetry:
    """A flight as the autopilot recorded it.

    Attributes:
        attitude: roll pitch yaw, rad, and body rates, rad/s.
        position: NED m, m/s.
        position_source: the kind of message it is from.
        gimbal: yaw pitch roll, rad; pitch and roll by the horizon, yaw by the airframe.
        battery: V, J (0: not reported).
        armed: when it was armed, as far as it says so.
        says_armed: it says when it was armed and when not.
        origin: latitude, longitude of local (0, 0), degrees.
        remarks: what a reader of the results has to know of it, a line each.
    """

    path: Path
    attitude: Track = field(default_factory=attitude_track)
    position: Track = field(default_factory=position_track)
    position_source: str = ""
    gimbal: Track = field(default_factory=lambda: Track(angles=3))
    battery: Track = field(default_factory=Track)
    armed: tuple[Span, ...] = ()
    says_armed: bool = False
    origin: tuple[float, float] | None = None
    remarks: tuple[str, ...] = ()

    @property
    def start(self) -> float:
        """When both attitude and position begin, s."""
        return max(self.attitude.times[0], self.position.times[0])

    @property
    def end(self) -> float:
        """When one of them ends, s."""
        return min(self.attitude.times[-1], self.position.times[-1])

    @property
    def flown(self) -> tuple[Span, ...]:
        """When it flew: when it was armed, or all of it if that was never or is not said."""
        return self.armed or ((self.start, self.end),)

    def local(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return local north and east of a place, m, on a flat earth about the origin."""
        if self.origin is None:
            raise TelemetryError(f"{self.path}: no global position in it; give the pad in metres")
        return local(self.origin, latitude_deg, longitude_deg)


def read_telemetry(path: Path) -> Telemetry:
    """Read a `.bin` or `.tlog`, as much of it as is good.

    Raises:
        TelemetryError: unreadable, another kind of file, not of a copter, or without attitude or
            position of the same time.
    """
    recorded = _read(path)
    if recorded.other_vehicle is not None and not recorded.is_copter:
        raise TelemetryError(f"{path}: not a copter's: it is of {recorded.other_vehicle}")
    damage = f" ({recorded.damage})" if recorded.damage else ""
    if len(recorded.attitude.times) < 2:
        raise TelemetryError(f"{path}: no attitude (ATT, ATTITUDE) in it{damage}")
    armed = _armed(recorded)
    everything = ((recorded.attitude.times[0], recorded.attitude.times[-1]),)
    source = _best_position(recorded, armed or everything)
    if source is None:
        expected = "XKF1, NKF1, EKF1, POS, GPS, LOCAL_POSITION_NED, GLOBAL_POSITION_INT"
        raise TelemetryError(f"{path}: no position ({expected}) in it{damage}")
    position = recorded.positions[source]
    telemetry = Telemetry(
        path,
        recorded.attitude,
        position,
        source,
        recorded.gimbal,
        recorded.battery,
        armed,
        bool(recorded.arming),
        _origin(position, recorded.places),
        _remarks(recorded, source),
    )
    if telemetry.start >= telemetry.end:
        raise TelemetryError(f"{path}: attitude and position are not of the same time{damage}")
    return telemetry


def is_fast_enough(track: Track, spans: Sequence[Span]) -> bool:
    """Return whether there are enough measurements a second within spans."""
    return round(track.rate_hz(spans), 1) >= LEAST_RATE_HZ


def _remarks(recorded: Recorded, source: str) -> tuple[str, ...]:
    damage = [recorded.damage] if recorded.damage else []
    unknown = [] if recorded.is_copter else ["it does not say what kind of vehicle it is of"]
    guessed = [_GUESSED[source]] if source in _GUESSED else []
    return (*damage, *recorded.remarks, *unknown, *guessed)


def _read(path: Path) -> Recorded:
    try:
        data = path.read_bytes()
    except OSError as e:
        raise TelemetryError(f"{path}: cannot be read: {e.strerror}") from None
    if not data:
        raise TelemetryError(f"{path}: empty, expected an ArduPilot .bin or .tlog")
    if data.startswith(b"FMT,"):
        raise TelemetryError(f"{path}: a log turned into text: give the .bin that it was made from")
    if has_formats(data):
        return read_dataflash(data)
    if data.lstrip(b"\0").startswith(MARKER):
        raise TelemetryError(f"{path}: its formats (FMT records) are lost: no .bin without")
    recorded = read_tlog(data)
    if recorded is None:
        raise TelemetryError(f"{path}: neither an ArduPilot .bin nor a .tlog")
    return recorded


def _armed(recorded: Recorded) -> tuple[Span, ...]:
    """Return when it was armed, s."""
    times = recorded.attitude.times
    spans: list[Span] = []
    since: float | None = None
    for t, armed in recorded.arming:
        if armed and since is None:
            since = max(t, times[0])
        elif not armed and since is not None:
            spans.append((since, t))
            since = None
    if since is not None:
        spans.append((since, times[-1]))
    return tuple(span for span in spans if span[0] < span[1])


def _best_position(recorded: Recorded, spans: Sequence[Span]) -> str | None:
    """Return the best source that is not much shorter than others, and fast enough if any is."""
    usable = {name: track for name, track in recorded.positions.items() if len(track.times) > 1}
    if not usable:
        return None
    longest = max(track.covered_s(spans) for track in usable.values())
    good = [
        name
        for name, track in usable.items()
        if is_fast_enough(track, spans) and track.covered_s(spans) > 0.5 * longest
    ]
    return good[0] if good else max(usable, key=lambda name: usable[name].rate_hz(spans))


def _origin(position: Track, places: Track) -> tuple[float, float] | None:
    """Find where local (0, 0) is from a place and a position of the same time, degrees."""
    for t, (latitude, longitude) in zip(places.times, places.values, strict=True):
        here = position.at(t)
        if here is not None:
            north, east = here[:2]
            lat0 = latitude - math.degrees(north / EARTH_M)
            cos = math.cos(math.radians(lat0))
            return lat0, longitude - math.degrees(east / (EARTH_M * cos))
    return None
