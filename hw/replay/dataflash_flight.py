"""A flight from a DataFlash log, whatever its firmware of 2014 and later names its fields."""

import math
from collections import Counter
from collections.abc import Callable, Mapping

from hw.replay.dataflash import DataFlash, Record
from hw.replay.recorded import (
    FromPlaces,
    Recorded,
    Turning,
    is_place,
    mount_angles,
    position_track,
)
from hw.replay.track import MAX_GAP_S, Track
from landerd.geometry import Vec3, wrap

_ARMED, _DISARMED = 10, 11  # EV ids
_FIX_3D = 3
_COPTERS = frozenset({2, 13})  # VER.BU, APM_BUILD of AP_Vehicle_Type.h: copter, helicopter
_OTHERS: Mapping[float, str] = {
    1: "a rover",
    3: "a plane",
    4: "an antenna tracker",
    7: "a submarine",
    12: "a blimp",
}
_OTHER_NAMES: Mapping[str, str] = {  # in the MSG that names the firmware
    "plane": "a plane",
    "rover": "a rover",
    "sub": "a submarine",
    "tracker": "an antenna tracker",
    "blimp": "a blimp",
}
# Kinds of the estimators' positions, by AHRS_EKF_TYPE; the newest first.
_ESTIMATORS: Mapping[str, int] = {"XKF1": 3, "NKF1": 2, "EKF1": 1}

_Reader = Callable[[Record], None]


def read_dataflash(data: bytes) -> Recorded:
    """Return the flight in a DataFlash log."""
    flight = _Flight()
    log = DataFlash(data, list(flight.readers))
    for record in log:
        needs, read = flight.readers[record.kind]
        if needs <= record.numbers.keys():
            read(record)
    recorded = flight.finish()
    recorded.damage = log.damage.in_words()
    return recorded


class _Flight:
    """Puts records onto tracks.

    Attributes:
        readers: by kind, the columns that must be there, and what takes the record.
    """

    def __init__(self) -> None:
        self._recorded = Recorded()
        self._rates: Vec3 | None = None  # as last measured, body, rad/s
        self._turning = Turning()
        self._estimates: dict[tuple[str, int], Track] = {}  # by kind and core
        self._primary: Counter[tuple[str, int]] = Counter()  # records in which a core was in use
        self._estimator: float | None = None  # AHRS_EKF_TYPE
        self._pos, self._gps = position_track(), position_track()
        self._from_pos, self._from_gps = FromPlaces(self._pos), FromPlaces(self._gps)
        self._fixes = Track()  # latitude, longitude, degrees, by GPS
        estimate = (frozenset({"PN", "PE", "PD", "VN", "VE", "VD"}), self._estimate)
        self.readers: Mapping[str, tuple[frozenset[str], _Reader]] = {
            "ATT": (frozenset({"Roll", "Pitch", "Yaw"}), self._attitude),
            "RATE": (frozenset({"R", "P", "Y"}), self._body_rates),
            **dict.fromkeys(_ESTIMATORS, estimate),
            "XKF4": (frozenset({"PI"}), self._cores),
            "NKF4": (frozenset({"PI"}), self._cores),
            "EV": (frozenset({"Id"}), self._event),
            "ARM": (frozenset({"ArmState"}), self._arming),
            "MNT": (frozenset({"Roll", "Pitch"}), self._mount),
            "BAT": (frozenset({"Volt"}), self._battery),
            "CURR": (frozenset({"Volt"}), self._battery),
            "POS": (frozenset({"Lat", "Lng", "Alt"}), self._place),
            "GPS": (frozenset({"Lat", "Lng", "Alt", "Status"}), self._fix),
            "MSG": (frozenset(), self._message),
            "VER": (frozenset({"BU"}), self._version),
            "PARM": (frozenset({"Value"}), self._parameter),
        }

    def _body_rates(self, m: Record) -> None:
        self._rates = _radians(m.numbers["R"], m.numbers["P"], m.numbers["Y"])

    def _attitude(self, m: Record) -> None:
        roll, pitch, yaw = _radians(m.numbers["Roll"], m.numbers["Pitch"], m.numbers["Yaw"])
        angles = (roll, pitch, wrap(yaw))
        guessed = self._turning.rates(m.t, angles, MAX_GAP_S)
        rates = guessed if self._rates is None else self._rates
        self._recorded.attitude.add(m.t, (*angles, *rates))

    def _estimate(self, m: Record) -> None:
        core = (m.kind, int(m.numbers.get("C", 0)))
        track = self._estimates.setdefault(core, position_track())
        track.add(m.t, tuple(m.numbers[name] for name in ("PN", "PE", "PD", "VN", "VE", "VD")))

    def _cores(self, m: Record) -> None:
        """Note which of several cores flies."""
        self._primary[f"{m.kind[:3]}1", int(m.numbers["PI"])] += 1

    def _event(self, m: Record) -> None:
        if m.numbers["Id"] in (_ARMED, _DISARMED):
            self._recorded.arming.append((m.t, m.numbers["Id"] == _ARMED))

    def _arming(self, m: Record) -> None:
        self._recorded.arming.append((m.t, bool(m.numbers["ArmState"])))

    def _mount(self, m: Record) -> None:
        """MNT: angles of the camera, degrees."""
        yaw = m.numbers.get("YawB", m.numbers.get("Yaw"))
        if m.numbers.get("I", 0) == 0 and yaw is not None:
            self._recorded.gimbal.add(m.t, mount_angles(yaw, m.numbers["Pitch"], m.numbers["Roll"]))

    def _battery(self, m: Record) -> None:
        if m.numbers.get("Instance", m.numbers.get("Inst", 0)) == 0:
            volts = m.numbers["Volt"] * (0.01 if "Volt" in m.whole else 1.0)  # old: centivolts
            joules = 3600.0 * m.numbers.get("EnrgTot", 0.0)
            self._recorded.battery.add(m.t, (volts, joules))

    def _place(self, m: Record) -> None:
        """POS: the estimator's own place, without velocity."""
        latitude, longitude = m.numbers["Lat"], m.numbers["Lng"]
        up = next(
            (m.numbers[n] for n in ("RelOriginAlt", "RelHomeAlt", "RelAlt") if n in m.numbers),
            m.numbers["Alt"],
        )
        self._from_pos.add(m.t, latitude, longitude, up, None)
        if is_place(latitude, longitude):
            self._recorded.places.add(m.t, (latitude, longitude))

    def _fix(self, m: Record) -> None:
        if m.numbers.get("I", 0) != 0 or m.numbers["Status"] < _FIX_3D:
            return
        velocity: Vec3 | None = None
        if {"Spd", "GCrs", "VZ"} <= m.numbers.keys():
            course, speed = math.radians(m.numbers["GCrs"]), m.numbers["Spd"]
            velocity = (speed * math.cos(course), speed * math.sin(course), m.numbers["VZ"])
        n = m.numbers
        self._from_gps.add(m.t, n["Lat"], n["Lng"], n["Alt"], velocity)
        if is_place(n["Lat"], n["Lng"]):
            self._fixes.add(m.t, (n["Lat"], n["Lng"]))

    def _message(self, m: Record) -> None:
        text = m.texts.get("Message", "").lower()
        if not any(mark in text for mark in ("ardu", "apm:", "frame:")):
            return
        first = text.split(" v", maxsplit=1)[0]
        if "copter" in first or "frame:" in text:
            self._recorded.is_copter = True
        for name, other in _OTHER_NAMES.items():
            if first.endswith(name):
                self._recorded.other_vehicle = other

    def _version(self, m: Record) -> None:
        if m.numbers["BU"] in _COPTERS:
            self._recorded.is_copter = True
        self._recorded.other_vehicle = _OTHERS.get(m.numbers["BU"], self._recorded.other_vehicle)

    def _parameter(self, m: Record) -> None:
        if m.texts.get("Name") == "AHRS_EKF_TYPE":
            self._estimator = m.numbers["Value"]

    # ---- at the end ----------------------------------------------------------------------------

    def finish(self) -> Recorded:
        """Return it with the sources of its position, the best one first."""
        recorded = self._recorded
        recorded.is_copter = recorded.is_copter and recorded.other_vehicle is None
        if recorded.arming and not recorded.arming[0][1]:  # what is logged are changes
            recorded.arming.insert(0, (0.0, True))
        kinds = sorted(_ESTIMATORS, key=lambda kind: _ESTIMATORS[kind] != self._estimator)
        for kind in kinds:
            cores = sorted(core for k, core in self._estimates if k == kind)
            cores.sort(key=lambda core: -self._primary[kind, core])
            for core in cores:
                name = kind if core == 0 else f"{kind} of core {core}"
                recorded.positions[name] = self._estimates[kind, core]
        recorded.positions["POS"] = self._pos
        recorded.positions["GPS"] = self._gps
        if not recorded.places.times:
            recorded.places = self._fixes
        return recorded


def _radians(a: float, b: float, c: float) -> Vec3:
    return (math.radians(a), math.radians(b), math.radians(c))
