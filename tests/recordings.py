"""ArduPilot logs of a made-up flight, byte for byte as the autopilot writes them."""

import math
import struct
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ORIGIN = (47.0, 8.0)  # degrees
RATE_HZ, LENGTH_S = 10, 20.0


def flown(t: float) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """Position NED (m), roll, pitch and yaw (rad) and yaw rate at a time: down a weaving line."""
    yaw = 0.5 * math.sin(1.3 * t) + 0.3 * math.sin(0.08 * t * t)
    rate = 0.65 * math.cos(1.3 * t) + 0.3 * 0.16 * t * math.cos(0.08 * t * t)
    return (-4.0 + 0.2 * t, 0.1 * t, -6.0 + 0.2 * t), (0.02, -0.03, yaw), rate


def write_tlog(path: Path, *, length_s: float = LENGTH_S, skip: tuple[str, ...] = ()) -> Path:
    """Write a telemetry log; messages of the skipped kinds are left out."""
    encoder = mavlink.MAVLink(None, 1, 1)
    data = b""

    def add(t: float, message: mavlink.MAVLink_message) -> None:
        nonlocal data
        if message.get_type() not in skip:
            data += struct.pack(">Q", int(1e6 * (1.7e9 + t))) + message.pack(encoder)

    for i in range(int(length_s * RATE_HZ)):
        t = i / RATE_HZ
        ms = 5000 + int(1e3 * t)
        position, (roll, pitch, yaw), rate = flown(t)
        if i % RATE_HZ == 0:
            add(t, mavlink.MAVLink_heartbeat_message(2, 3, 0x89, 4, 4, 3))
            lat, lon = (
                ORIGIN[0] + math.degrees(position[0] / 6378137.0),
                ORIGIN[1]
                + math.degrees(position[1] / 6378137.0 / math.cos(math.radians(ORIGIN[0]))),
            )
            fix = (int(1e7 * lat), int(1e7 * lon))
        add(t, mavlink.MAVLink_attitude_message(ms, roll, pitch, yaw, 0.0, 0.0, rate))
        add(t, mavlink.MAVLink_local_position_ned_message(ms, *position, 0.2, 0.1, 0.2))
        if i % RATE_HZ == 0:
            add(t, mavlink.MAVLink_global_position_int_message(ms, *fix, 0, 0, 0, 0, 0, 0))
    path.write_bytes(data)
    return path


_TYPES = {"Q": "Q", "f": "f", "B": "B", "c": "h", "C": "H", "L": "i", "n": "4s", "N": "16s"}
_FORMATS = {  # name: (id, format, columns)
    "ATT": (1, "QccccCCCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
    "XKF1": (2, "QBccCfffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD"),
    "MODE": (3, "QBBB", "TimeUS,Mode,ModeNum,Rsn"),
    "EV": (4, "QB", "TimeUS,Id"),
    "MNT": (5, "QBfff", "TimeUS,I,Roll,Pitch,YawB"),
}


def write_bin(path: Path, *, length_s: float = LENGTH_S, skip: tuple[str, ...] = ()) -> Path:
    """Write a DataFlash log; messages of the skipped kinds are left out."""
    data = b""
    names = [name for name in _FORMATS if name not in skip]
    formats = {"FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns")}
    for name, (number, form, columns) in (formats | {n: _FORMATS[n] for n in names}).items():
        length = 89 if name == "FMT" else 3 + struct.calcsize("<" + _packed(form))
        fields = (number, length, name.encode(), form.encode(), columns.encode())
        data += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *fields)

    def add(name: str, *values: float) -> None:
        nonlocal data
        if name in names:
            number, form, _ = _FORMATS[name]
            scaled = [round(100 * v) if c in "cC" else v for c, v in zip(form, values, strict=True)]
            data += bytes([0xA3, 0x95, number]) + struct.pack("<" + _packed(form), *scaled)

    add("MODE", 7_000_000, 5, 5, 1)
    add("EV", 7_000_000, 10)
    for i in range(int(length_s * RATE_HZ)):
        t = i / RATE_HZ
        us = 8_000_000 + int(1e6 * t)
        (n, e, d), angles, _ = flown(t)
        roll, pitch, yaw = map(math.degrees, angles)
        add("ATT", us, 0, roll, 0, pitch, 0, yaw % 360.0, 0, 0)
        add("XKF1", us, 0, roll, pitch, yaw % 360.0, 0.2, 0.1, 0.2, 0, n, e, d)
        add("XKF1", us, 1, roll, pitch, yaw % 360.0, 9.0, 9.0, 9.0, 0, 99.0, 99.0, 99.0)
        add("MNT", us, 0, 0.0, -60.0, 5.0)
    path.write_bytes(data)
    return path


def _packed(form: str) -> str:
    return "".join(_TYPES[c] for c in form)
