"""A flight from a telemetry log: MAVLink frames, each behind its Unix time in us, big-endian."""

import contextlib
import math
import re
import struct
from collections.abc import Callable, Iterator, Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.arducopter import VEHICLE_TYPES
from hw.autopilots.mavlink_codec import Message
from hw.autopilots.telemetry import gimbal_yaw_is_from_north
from hw.replay.damage import Damage
from hw.replay.recorded import FromPlaces, Recorded, is_place, mount_angles, position_track
from landerd.geometry import angles_zxy, rotation, wrap

_MARKER = re.compile(rb"[\xfd\xfe]")
_STAMP = 8  # bytes
_RESTART_S = 5.0  # boot time falls back by more than this
_CONFIRM = 5  # and so many messages in a row say so
_NO_VEHICLE = frozenset({mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ONBOARD_CONTROLLER})

_Reader = Callable[[float, Message], None]  # time, s since boot; the message


def read_tlog(data: bytes) -> Recorded | None:
    """Return the flight of the vehicle that a telemetry log has most of; None: not such a log."""
    damage = Damage(len(data))
    systems: dict[int, _System] = {}
    heard = False
    for stamp, m in frames(data, damage):
        heard = True
        kind = m.get_type()
        if m.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1 or kind.startswith("GIMBAL"):
            systems.setdefault(m.get_srcSystem(), _System()).take(stamp, kind, m)
    return _chosen(systems, damage) if heard else None


def _chosen(systems: "Mapping[int, _System]", damage: Damage) -> Recorded:
    """Return the longest boot of the vehicle with most messages, and note what else there is."""
    vehicles = {number: system for number, system in systems.items() if system.is_vehicle}
    if not vehicles:
        return Recorded(damage=damage.in_words())
    number = max(vehicles, key=lambda each: vehicles[each].attitudes)
    boots = vehicles[number].boots
    flight = max(boots, key=lambda boot: len(boot.recorded.attitude.times)).finish()
    flight.damage = damage.in_words()
    if others := ", ".join(str(each) for each in sorted(vehicles) if each != number):
        flight.remarks.append(f"of several vehicles system {number} is shown, not {others}")
    if len(boots) > 1:
        flight.remarks.append(
            f"the autopilot was started {len(boots)} times in it: the longest part is shown"
        )
    return flight


class _System:
    """One system's messages, separated by starts of its autopilot.

    Attributes:
        boots: of each start.
    """

    def __init__(self) -> None:
        self.boots = [_Boot()]
        self._latest = -math.inf  # boot time, s
        self._earlier = 0  # messages in a row whose boot time is before it

    @property
    def is_vehicle(self) -> bool:
        """Whether it is anything that moves."""
        return self.attitudes > 0 or any(boot.is_vehicle for boot in self.boots)

    @property
    def attitudes(self) -> int:
        """How often its attitude was measured."""
        return sum(len(boot.recorded.attitude.times) for boot in self.boots)

    def take(self, stamp: float, kind: str, m: Message) -> None:
        """Take the next message, logged at a Unix time (s)."""
        if hasattr(m, "time_boot_ms") and self._restarted(1e-3 * m.time_boot_ms):
            self.boots.append(_Boot())
        self.boots[-1].take(stamp, kind, m)

    def _restarted(self, t: float) -> bool:
        if t >= self._latest - _RESTART_S:
            self._latest, self._earlier = max(t, self._latest), 0
            return False
        self._earlier += 1
        if self._earlier < _CONFIRM:
            return False
        self._latest, self._earlier = t, 0
        return True


class _Boot:
    """Puts one vehicle's messages, from one start of its autopilot on, onto tracks.

    A gimbal's own report is preferred: MOUNT_STATUS is not read any more once there was one.

    Attributes:
        recorded: what they say.
        is_vehicle: a heartbeat has said so.
    """

    def __init__(self) -> None:
        self.recorded = Recorded()
        self.is_vehicle = False
        self._local, self._global = position_track(), position_track()
        self._from_global = FromPlaces(self._global)
        self._boot_minus_log_s: float | None = None  # of the message that was least late
        self._gimbal: tuple[int, int] | None = None  # component and device whose report is read
        self._has_other_gimbals = False
        self._is_other_autopilot = False
        self._stamped: Mapping[str, _Reader] = {  # with time_boot_ms
            "ATTITUDE": self._attitude,
            "LOCAL_POSITION_NED": self._position,
            "GLOBAL_POSITION_INT": self._global_position,
        }
        self._unstamped: Mapping[str, _Reader] = {  # dated by the log, as others show its lateness
            "BATTERY_STATUS": self._battery,
            "MOUNT_STATUS": self._mount,
            "GIMBAL_DEVICE_ATTITUDE_STATUS": self._device_attitude,
        }

    def take(self, stamp: float, kind: str, m: Message) -> None:
        """Take the next message, logged at a Unix time (s)."""
        if kind == "HEARTBEAT":
            self._heartbeat(stamp, m)
        if hasattr(m, "time_boot_ms"):
            t = 1e-3 * m.time_boot_ms
            if self._boot_minus_log_s is None or t - stamp > self._boot_minus_log_s:
                self._boot_minus_log_s = t - stamp
            if kind in self._stamped:
                self._stamped[kind](t, m)
        if kind in self._unstamped and self._boot_minus_log_s is not None:
            self._unstamped[kind](stamp + self._boot_minus_log_s, m)

    def finish(self) -> Recorded:
        """Return it with the sources of its position, the best one first."""
        if self._is_other_autopilot:
            self.recorded.remarks.append("its autopilot is not ArduPilot")
        if self._has_other_gimbals:
            self.recorded.remarks.append("of several gimbals the one that reports first is shown")
        self.recorded.positions["LOCAL_POSITION_NED"] = self._local
        self.recorded.positions["GLOBAL_POSITION_INT"] = self._global
        return self.recorded

    def _attitude(self, t: float, m: Message) -> None:
        self.recorded.attitude.add(
            t, (m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed)
        )

    def _position(self, t: float, m: Message) -> None:
        self._local.add(t, (m.x, m.y, m.z, m.vx, m.vy, m.vz))

    def _global_position(self, t: float, m: Message) -> None:
        """GLOBAL_POSITION_INT: 1e-7 degrees, mm above home, cm/s NED."""
        latitude, longitude = 1e-7 * m.lat, 1e-7 * m.lon
        velocity = (0.01 * m.vx, 0.01 * m.vy, 0.01 * m.vz)
        self._from_global.add(t, latitude, longitude, 1e-3 * m.relative_alt, velocity)
        if is_place(latitude, longitude):
            self.recorded.places.add(t, (latitude, longitude))

    def _heartbeat(self, stamp: float, m: Message) -> None:
        if m.type in _NO_VEHICLE or m.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
            return
        self.is_vehicle = True
        if m.type in VEHICLE_TYPES:
            self.recorded.is_copter = True
        elif m.type != mavlink.MAV_TYPE_GENERIC:  # a copter's without a known frame
            self.recorded.other_vehicle = _type_name(m.type)
        if m.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
            self._is_other_autopilot = True
        if self._boot_minus_log_s is not None:
            armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.recorded.arming.append((stamp + self._boot_minus_log_s, armed))

    def _battery(self, t: float, m: Message) -> None:
        if m.id == 0:
            cells = [mv for mv in m.voltages if mv != 0xFFFF]
            energy = 100.0 * m.energy_consumed if m.energy_consumed >= 0 else 0.0
            self.recorded.battery.add(t, (1e-3 * sum(cells), energy))

    def _mount(self, t: float, m: Message) -> None:
        """MOUNT_STATUS: hundredths of a degree."""
        if self._gimbal is None:
            yaw, pitch, roll = (0.01 * v for v in (m.pointing_c, m.pointing_a, m.pointing_b))
            self.recorded.gimbal.add(t, mount_angles(yaw, pitch, roll))

    def _device_attitude(self, t: float, m: Message) -> None:
        device = m.get_srcComponent(), m.gimbal_device_id
        self._gimbal = self._gimbal or device
        self._has_other_gimbals = self._has_other_gimbals or device != self._gimbal
        R = rotation(m.q)
        if R is None or device != self._gimbal:
            return
        yaw, pitch, roll = angles_zxy(R)
        if gimbal_yaw_is_from_north(m):
            attitude = self.recorded.attitude
            if not attitude.times:
                return
            _, _, vehicles, _, _, rate = attitude.values[-1]
            yaw = wrap(yaw - vehicles - (t - attitude.times[-1]) * rate)
        self.recorded.gimbal.add(t, (yaw, pitch, roll))


def _type_name(number: int) -> str:
    """Return as what a vehicle names itself, as "fixed wing"."""
    known = mavlink.enums["MAV_TYPE"].get(number)
    name = known.name.removeprefix("MAV_TYPE_").lower().replace("_", " ") if known else "unknown"
    return f"{name} (MAV_TYPE {number})"


def frames(data: bytes, damage: Damage) -> Iterator[tuple[float, Message]]:
    """Yield (Unix time, message) of a .tlog; after damage it goes on at the next good frame."""
    parser = mavlink.MAVLink(None)
    at = 0
    while at < len(data):
        size = _frame_size(data, at + _STAMP)
        message = _decoded(parser, data[at + _STAMP : at + _STAMP + size]) if size else None
        if message is None and not (size and _starts_frame(data, at + _STAMP + size)):
            found = _MARKER.search(data, at + _STAMP + 1)
            resumed = len(data) if found is None else found.start() - _STAMP
            damage.skip(at, resumed)
            at = resumed
            continue
        if message is not None:
            yield 1e-6 * struct.unpack_from(">Q", data, at)[0], message
        at += _STAMP + size  # also past a message of a kind not known here


def _frame_size(data: bytes, at: int) -> int:
    """Return the length of the frame that begins at a place; 0: none does, or it is cut."""
    size = 0
    if at + 3 <= len(data):
        if data[at] == 0xFE:
            size = 8 + data[at + 1]
        elif data[at] == 0xFD:
            size = 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
    return size if at + size <= len(data) else 0


def _decoded(parser: mavlink.MAVLink, frame: bytes) -> Message | None:
    with contextlib.suppress(mavlink.MAVError, struct.error, ValueError):
        message = parser.decode(bytearray(frame))
        return None if message.get_msgId() < 0 else message
    return None


def _starts_frame(data: bytes, at: int) -> bool:
    return at == len(data) or (at + _STAMP < len(data) and data[at + _STAMP] in (0xFD, 0xFE))
