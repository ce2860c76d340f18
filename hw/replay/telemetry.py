"""ArduPilot's own recordings: DataFlash `.bin` and telemetry `.tlog`, as one set of tracks.

Times are the autopilot's, in s since its boot. Positions are its local NED.
"""

import contextlib
import math
import os
import struct
import sys
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.arducopter import VEHICLE_TYPES, mode_name
from hw.autopilots.mavlink_codec import Message
from landerd.geometry import Vec3, angles_zxy, rotation, wrap
from landerd.messages import Reference

MAX_GAP_S = 1.5  # measurements farther apart are not interpolated between
LONG_GAP_S = 5.0
EARTH_M = 6378137.0  # radius, WGS 84 equatorial

Reader = Callable[[float, Message], None]  # time, s; pymavlink's message, of either kind of log


class TelemetryError(Exception):
    """A recording cannot be used; the text names the file and what is missing."""


class Track:
    """One kind of measurement over time."""

    def __init__(self, *, angles: int = 0) -> None:
        """The first so many values are angles that wrap, rad."""
        self.times: list[float] = []
        self.values: list[tuple[float, ...]] = []
        self._angles = angles
        self._doubtful: tuple[float, tuple[float, ...]] | None = None

    def add(self, t: float, values: tuple[float, ...]) -> None:
        """Add a measurement; what is no number, or not newer than the last, is left out.

        After a long gap a second one must confirm the time: damage in a log makes any number.
        """
        if not all(map(math.isfinite, (t, *values))) or (self.times and t <= self.times[-1]):
            return
        doubtful, self._doubtful = self._doubtful, None
        if not self.times or t - self.times[-1] > LONG_GAP_S:
            if doubtful is None or not 0.0 < t - doubtful[0] < LONG_GAP_S:
                self._doubtful = (t, values)
                return
            self.times.append(doubtful[0])
            self.values.append(doubtful[1])
        self.times.append(t)
        self.values.append(values)

    def at(self, t: float) -> tuple[float, ...] | None:
        """Return the values at time t, interpolated; None where the track does not reach."""
        i = bisect_right(self.times, t)
        if i == 0 or i == len(self.times):
            exact = i > 0 and self.times[-1] == t
            return self.values[-1] if exact else None
        t0, t1 = self.times[i - 1], self.times[i]
        if t1 - t0 > MAX_GAP_S:
            return None
        k = (t - t0) / (t1 - t0)
        pairs = enumerate(zip(self.values[i - 1], self.values[i], strict=True))
        return tuple(
            wrap(a + k * wrap(b - a)) if n < self._angles else a + k * (b - a)
            for n, (a, b) in pairs
        )

    @property
    def rate_hz(self) -> float:
        """Measurements a second on average."""
        span = self.times[-1] - self.times[0] if len(self.times) > 1 else 0.0
        return (len(self.times) - 1) / span if span > 0.0 else 0.0


@dataclass
class Telemetry:
    """A flight as the autopilot recorded it."""

    path: Path
    attitude: Track = field(default_factory=lambda: Track(angles=3))  # roll pitch yaw, rates
    position: Track = field(default_factory=Track)  # NED m, m/s
    gimbal: Track = field(default_factory=lambda: Track(angles=3))  # yaw pitch roll, as Reference
    gimbal_reference: Reference = Reference.HORIZON
    battery: Track = field(default_factory=Track)  # V, J (nan: not reported)
    modes: list[tuple[float, str]] = field(default_factory=list)
    arming: list[tuple[float, bool]] = field(default_factory=list)
    origin: tuple[float, float] | None = None  # latitude, longitude of local (0, 0), degrees

    @property
    def start(self) -> float:
        """When both attitude and position begin, s."""
        return max(self.attitude.times[0], self.position.times[0])

    @property
    def end(self) -> float:
        """When one of them ends, s."""
        return min(self.attitude.times[-1], self.position.times[-1])

    def local(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return local north and east of a place, m, on a flat earth about the origin."""
        if self.origin is None:
            raise TelemetryError(f"{self.path}: no global position in it; give the pad in metres")
        lat0, lon0 = self.origin
        north = math.radians(latitude_deg - lat0) * EARTH_M
        east = math.radians(longitude_deg - lon0) * EARTH_M * math.cos(math.radians(lat0))
        return north, east


def read_telemetry(path: Path) -> Telemetry:
    """Read a `.bin` or `.tlog`, as much of it as is good.

    Raises:
        TelemetryError: unreadable, another kind of file, or attitude or position are missing.
    """
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as e:
        raise TelemetryError(f"{path}: cannot be read: {e.strerror}") from None
    if not head:
        raise TelemetryError(f"{path}: empty, expected an ArduPilot .bin or .tlog")
    telemetry = Telemetry(path)
    if head[:2] == b"\xa3\x95":
        _read_bin(path, telemetry)
    elif len(head) > 8 and head[8] in (0xFD, 0xFE):
        _read_tlog(path, telemetry)
    else:
        raise TelemetryError(f"{path}: neither an ArduPilot .bin nor a .tlog")
    for track, names in (
        (telemetry.attitude, "attitude (ATT, ATTITUDE)"),
        (telemetry.position, "local position (XKF1, NKF1, EKF1, LOCAL_POSITION_NED)"),
    ):
        if len(track.times) < 2:
            raise TelemetryError(f"{path}: no {names} in it")
    if telemetry.start >= telemetry.end:
        raise TelemetryError(f"{path}: attitude and position are not of the same time")
    return telemetry


# ---- DataFlash ---------------------------------------------------------------------------------

_ARMED, _DISARMED = 10, 11  # EV ids


def _read_bin(path: Path, telemetry: Telemetry) -> None:
    log = _DataFlash(telemetry)
    for m in _dataflash(path, list(log.readers)):
        t = 1e-6 * m.TimeUS if hasattr(m, "TimeUS") else 1e-3 * getattr(m, "TimeMS", 0)
        log.readers[m.get_type()](t, m)


class _DataFlash:
    """Puts the messages of a DataFlash log onto the tracks.

    Attributes:
        readers: what takes a message, by kind, with its time in s.
    """

    def __init__(self, telemetry: Telemetry) -> None:
        self._telemetry = telemetry
        self._rates: Vec3 | None = None  # as last measured, body, rad/s
        self._turning = _Turning()
        self.readers: Mapping[str, Reader] = {
            "ATT": self._attitude,
            "RATE": self._body_rates,
            "XKF1": self._position,
            "NKF1": self._position,
            "EKF1": self._position,
            "MODE": self._mode,
            "EV": self._event,
            "ARM": self._arming,
            "MNT": self._mount,
            "BAT": self._battery,
            "CURR": self._battery,
            "POS": self._global_position,
        }

    def _body_rates(self, t: float, m: Message) -> None:
        self._rates = (math.radians(m.R), math.radians(m.P), math.radians(m.Y))

    def _attitude(self, t: float, m: Message) -> None:
        angles = (math.radians(m.Roll), math.radians(m.Pitch), wrap(math.radians(m.Yaw)))
        guessed = self._turning.rates(t, angles)
        rates = guessed if self._rates is None else self._rates
        self._telemetry.attitude.add(t, (*angles, *rates))

    def _position(self, t: float, m: Message) -> None:
        if getattr(m, "C", 0) == 0:  # of the first of several estimators
            self._telemetry.position.add(t, (m.PN, m.PE, m.PD, m.VN, m.VE, m.VD))

    def _mode(self, t: float, m: Message) -> None:
        self._telemetry.modes.append((t, mode_name(int(m.ModeNum))))

    def _event(self, t: float, m: Message) -> None:
        if m.Id in (_ARMED, _DISARMED):
            self._telemetry.arming.append((t, m.Id == _ARMED))

    def _arming(self, t: float, m: Message) -> None:
        self._telemetry.arming.append((t, bool(m.ArmState)))

    def _mount(self, t: float, m: Message) -> None:
        """MNT: angles of the camera, degrees; pitch, roll by the horizon, yaw by the airframe."""
        yaw = getattr(m, "YawB", getattr(m, "Yaw", None))
        if getattr(m, "I", 0) == 0 and yaw is not None and hasattr(m, "Pitch"):
            angles = (math.radians(yaw), math.radians(m.Pitch), math.radians(m.Roll))
            self._telemetry.gimbal.add(t, angles)

    def _battery(self, t: float, m: Message) -> None:
        if getattr(m, "Instance", 0) == 0:
            volt = m.Volt if isinstance(m.Volt, float) else 0.01 * m.Volt  # old logs: centivolts
            self._telemetry.battery.add(t, (volt, 3600.0 * getattr(m, "EnrgTot", 0.0)))

    def _global_position(self, t: float, m: Message) -> None:
        _note_origin(self._telemetry, t, m.Lat, m.Lng)


def _dataflash(path: Path, kinds: list[str]) -> list[Message]:
    """Return a log's messages of some kinds; the library's remarks on bad bytes are not shown."""
    messages: list[Message] = []
    with _library_silenced():
        try:
            reader = DFReader.DFReader_binary(str(path))
        except Exception as e:  # the library lets anything through on damaged files
            raise TelemetryError(f"{path}: damaged: {e}") from None
        with contextlib.closing(reader), contextlib.suppress(Exception):  # what is good is used
            while (m := reader.recv_match(type=kinds)) is not None:
                messages.append(m)
    return messages


@contextlib.contextmanager
def _library_silenced() -> Iterator[None]:
    """Send what the library prints nowhere; part of it is C and writes past Python."""
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, "w") as null:
        try:
            os.dup2(null.fileno(), 2)
            with contextlib.redirect_stdout(null), contextlib.redirect_stderr(null):
                yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


class _Turning:
    """Body rates from angles, for logs that have none; yaw of a nearly level vehicle."""

    def __init__(self) -> None:
        self._last: tuple[float, Vec3] | None = None

    def rates(self, t: float, angles: Vec3) -> Vec3:
        last, self._last = self._last, (t, angles)
        if last is None or not 0.0 < t - last[0] < MAX_GAP_S:
            return (0.0, 0.0, 0.0)
        dt, (r, p, y) = t - last[0], last[1]
        return (
            wrap(angles[0] - r) / dt,
            wrap(angles[1] - p) / dt,
            wrap(angles[2] - y) / dt,
        )


# ---- telemetry log -----------------------------------------------------------------------------


def _read_tlog(path: Path, telemetry: Telemetry) -> None:
    log = _Tlog(telemetry)
    for stamp, m in _frames(path.read_bytes()):
        kind = m.get_type()
        if m.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1 or kind.startswith("GIMBAL"):
            log.take(stamp, kind, m)


class _Tlog:
    """Puts the messages of a telemetry log onto the tracks.

    A gimbal's own report is preferred: MOUNT_STATUS is not read any more once there was one.
    """

    def __init__(self, telemetry: Telemetry) -> None:
        self._telemetry = telemetry
        self._boot_minus_log_s: float | None = None  # of the message that was least late
        self._has_device_attitude = False
        self._stamped: Mapping[str, Reader] = {  # with time_boot_ms
            "ATTITUDE": self._attitude,
            "LOCAL_POSITION_NED": self._position,
            "GLOBAL_POSITION_INT": self._global_position,
        }
        self._unstamped: Mapping[str, Reader] = {  # dated by the log, as others show its lateness
            "HEARTBEAT": self._heartbeat,
            "BATTERY_STATUS": self._battery,
            "MOUNT_STATUS": self._mount,
            "GIMBAL_DEVICE_ATTITUDE_STATUS": self._device_attitude,
        }

    def take(self, stamp: float, kind: str, m: Message) -> None:
        """Take the next message, logged at a Unix time (s)."""
        if hasattr(m, "time_boot_ms"):
            t = 1e-3 * m.time_boot_ms
            if self._boot_minus_log_s is None or t - stamp > self._boot_minus_log_s:
                self._boot_minus_log_s = t - stamp
            if kind in self._stamped:
                self._stamped[kind](t, m)
        if kind in self._unstamped and self._boot_minus_log_s is not None:
            self._unstamped[kind](stamp + self._boot_minus_log_s, m)

    def _attitude(self, t: float, m: Message) -> None:
        self._telemetry.attitude.add(
            t, (m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed)
        )

    def _position(self, t: float, m: Message) -> None:
        self._telemetry.position.add(t, (m.x, m.y, m.z, m.vx, m.vy, m.vz))

    def _global_position(self, t: float, m: Message) -> None:
        if m.lat:
            _note_origin(self._telemetry, t, 1e-7 * m.lat, 1e-7 * m.lon)

    def _heartbeat(self, t: float, m: Message) -> None:
        if m.type in VEHICLE_TYPES:
            self._telemetry.modes.append((t, mode_name(m.custom_mode)))
            armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self._telemetry.arming.append((t, armed))

    def _battery(self, t: float, m: Message) -> None:
        if m.id == 0:
            cells = [mv for mv in m.voltages if mv != 0xFFFF]
            energy = 100.0 * m.energy_consumed if m.energy_consumed >= 0 else 0.0
            self._telemetry.battery.add(t, (1e-3 * sum(cells), energy))

    def _mount(self, t: float, m: Message) -> None:
        """MOUNT_STATUS: hundredths of a degree."""
        if not self._has_device_attitude:
            yaw, pitch, roll = (
                math.radians(0.01 * v) for v in (m.pointing_c, m.pointing_a, m.pointing_b)
            )
            self._telemetry.gimbal.add(t, (yaw, pitch, roll))

    def _device_attitude(self, t: float, m: Message) -> None:
        self._has_device_attitude = True
        R = rotation(m.q)
        if R is not None:
            self._telemetry.gimbal.add(t, angles_zxy(R))


def _frames(data: bytes) -> Iterator[tuple[float, Message]]:
    """Yield (Unix time, message) of a .tlog; after damage it goes on at the next good frame."""
    parser = mavlink.MAVLink(None)
    at = 0
    while at + 16 < len(data):
        marker = data[at + 8]
        length = data[at + 9]
        size = 0
        if marker == 0xFE:
            size = 8 + length
        elif marker == 0xFD:
            size = 12 + length + (13 if data[at + 10] & 1 else 0)
        frame = data[at + 8 : at + 8 + size]
        message = None
        if size and len(frame) == size:
            with contextlib.suppress(mavlink.MAVError, struct.error, ValueError):
                message = parser.decode(bytearray(frame))
        if message is None and size and _starts_frame(data, at + 8 + size):
            at += 8 + size  # of a kind not known here
        elif message is None:
            at += 1
        else:
            yield 1e-6 * struct.unpack(">Q", data[at : at + 8])[0], message
            at += 8 + size


def _starts_frame(data: bytes, at: int) -> bool:
    return at + 8 == len(data) or (at + 8 < len(data) and data[at + 8] in (0xFD, 0xFE))


def _note_origin(telemetry: Telemetry, t: float, latitude: float, longitude: float) -> None:
    """Find where local (0, 0) is from a global and a local position of the same time."""
    track = telemetry.position
    if telemetry.origin is not None or not track.times or abs(t - track.times[-1]) > 0.2:
        return
    north, east = track.values[-1][:2]
    lat0 = latitude - math.degrees(north / EARTH_M)
    lon0 = longitude - math.degrees(east / (EARTH_M * math.cos(math.radians(lat0))))
    telemetry.origin = (lat0, lon0)
