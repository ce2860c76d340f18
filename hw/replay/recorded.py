"""All sources that the readers of both kinds of log find, before the best are chosen."""

import math
from collections import deque
from dataclasses import dataclass, field

from hw.replay.track import Track
from landerd.geometry import Vec3, angles_zxy, rot_zyx, wrap

EARTH_M = 6378137.0  # radius, WGS 84 equatorial
_MOST_M = 1e6  # and m/s: nothing that a vehicle does
_MOST_RAD = 100.0  # and rad/s
_BASELINE_S = 0.25  # velocities are differences of places so far apart in time


def attitude_track() -> Track:
    """Return a track for roll, pitch, yaw (rad) and body rates (rad/s)."""
    return Track(angles=3, most=_MOST_RAD)


def position_track() -> Track:
    """Return a track for local NED position (m) and velocity (m/s)."""
    return Track(most=_MOST_M)


@dataclass
class Recorded:
    """Everything read from one log, or from one vehicle's part of it."""

    attitude: Track = field(default_factory=attitude_track)
    positions: dict[str, Track] = field(default_factory=dict)  # by source, the best one first
    places: Track = field(default_factory=Track)  # latitude, longitude, degrees
    gimbal: Track = field(default_factory=lambda: Track(angles=3, most=_MOST_RAD))
    battery: Track = field(default_factory=Track)  # V, J (0: not reported)
    arming: list[tuple[float, bool]] = field(default_factory=list)
    other_vehicle: str | None = None  # what it is, if it is known not to be a copter
    is_copter: bool = False  # it is known to be one
    damage: str = ""  # what of the file is left out
    remarks: list[str] = field(default_factory=list)


class FromPlaces:
    """Turns latitudes and longitudes into a local track about the first of them."""

    def __init__(self, track: Track) -> None:
        self._track = track
        self._origin: tuple[float, float] | None = None
        self._last: deque[tuple[float, Vec3]] = deque()

    def add(
        self, t: float, latitude: float, longitude: float, up: float, velocity: Vec3 | None
    ) -> None:
        """Add a place, degrees and m; velocity NED, m/s, None: the difference of the places."""
        if not is_place(latitude, longitude):
            return
        if self._origin is None:
            self._origin = (latitude, longitude)
        position = (*local(self._origin, latitude, longitude), -up)
        self._last.append((t, position))
        while len(self._last) > 2 and t - self._last[1][0] >= _BASELINE_S:
            self._last.popleft()
        self._track.add(t, (*position, *(self._difference() if velocity is None else velocity)))

    def _difference(self) -> Vec3:
        (t0, a), (t1, b) = self._last[0], self._last[-1]
        if not 0.0 < t1 - t0 < 4.0 * _BASELINE_S:
            return (0.0, 0.0, 0.0)
        dt = t1 - t0
        return ((b[0] - a[0]) / dt, (b[1] - a[1]) / dt, (b[2] - a[2]) / dt)


def is_place(latitude: float, longitude: float) -> bool:
    """Return whether it is on earth; zeros are written while there is no fix."""
    return abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and (latitude, longitude) != (0.0, 0.0)


def local(origin: tuple[float, float], latitude: float, longitude: float) -> tuple[float, float]:
    """Return north and east of a place, m, on a flat earth about the origin, all in degrees."""
    north = math.radians(latitude - origin[0]) * EARTH_M
    cos = math.cos(math.radians(origin[0]))
    return north, math.radians(math.remainder(longitude - origin[1], 360.0)) * EARTH_M * cos


def mount_angles(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Vec3:
    """Return yaw, pitch and roll, rad, as a GimbalState has them.

    ArduPilot composes those of a mount as yaw, pitch, roll; see hw.gimbals.mavlink_mount.
    """
    yaw, pitch, roll = map(math.radians, (yaw_deg, pitch_deg, roll_deg))
    return angles_zxy(rot_zyx(yaw, pitch, roll))


class Turning:
    """Body rates from angles, for logs that have none; yaw of a nearly level vehicle."""

    def __init__(self) -> None:
        self._last: tuple[float, Vec3] | None = None

    def rates(self, t: float, angles: Vec3, longest_s: float) -> Vec3:
        """Return the rates since the last angles, rad/s; zeros if these are too old."""
        last, self._last = self._last, (t, angles)
        if last is None or not 0.0 < t - last[0] < longest_s:
            return (0.0, 0.0, 0.0)
        dt, (r, p, y) = t - last[0], last[1]
        return (
            wrap(angles[0] - r) / dt,
            wrap(angles[1] - p) / dt,
            wrap(angles[2] - y) / dt,
        )
