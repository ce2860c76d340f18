"""ArduPilot logs of a made-up flight, byte for byte as the autopilot writes them; its video."""

import math
import struct
from pathlib import Path

import cv2
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.replay.pictures import DrawnPictures
from hw.replay.telemetry import read_telemetry
from hw.replay.vehicle import RecordedVehicle
from hw.sim.options import SimOptions
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.pad import load_pad

ORIGIN = (47.0, 8.0)  # degrees
PAD = (0.0, 2.0, 0.2)  # under the end of the flight, local NED, m
FPS = 12.0  # of its video
RATE_HZ, LENGTH_S = 10, 20.0


def flown(t: float) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """Position NED (m), roll, pitch and yaw (rad) and yaw rate at a time: down a weaving line."""
    yaw = 0.5 * math.sin(1.3 * t) + 0.3 * math.sin(0.08 * t * t)
    rate = 0.65 * math.cos(1.3 * t) + 0.3 * 0.16 * t * math.cos(0.08 * t * t)
    return (-4.0 + 0.2 * t, 0.1 * t, -6.0 + 0.2 * t), (0.02, -0.03, yaw), rate


def place(t: float) -> tuple[float, float]:
    """Latitude and longitude at a time, degrees."""
    north, east, _ = flown(t)[0]
    cos = math.cos(math.radians(ORIGIN[0]))
    return (
        ORIGIN[0] + math.degrees(north / 6378137.0),
        ORIGIN[1] + math.degrees(east / 6378137.0 / cos),
    )


def write_tlog(
    path: Path,
    *,
    length_s: float = LENGTH_S,
    skip: tuple[str, ...] = (),
    system: int = 1,
    vehicle: int = mavlink.MAV_TYPE_QUADROTOR,
    boot_s: float = 5.0,
    at_s: float = 0.0,
    mount_deg: tuple[float, float, float] | None = None,
    look_deg: tuple[float, float] | None = None,
) -> Path:
    """Write a telemetry log.

    Args:
        path: of the file.
        length_s: of the flight.
        skip: messages of these kinds are left out.
        system: the vehicle's MAVLink system.
        vehicle: MAV_TYPE.
        boot_s: time since boot when it begins.
        at_s: Unix time when it begins, after some day in 2023.
        mount_deg: yaw, pitch and roll of the gimbal as ArduPilot has them; None: not recorded.
        look_deg: yaw from the nose and pitch of a gimbal that tells its yaw from north, beside one
            that looks level ahead; None: no such gimbals.
    """
    encoder = mavlink.MAVLink(None, system, 1)
    data = b""

    def add(t: float, message: mavlink.MAVLink_message) -> None:
        nonlocal data
        if message.get_type() not in skip:
            stamp = int(1e6 * (1.7e9 + at_s + t))
            data += struct.pack(">Q", stamp) + message.pack(encoder)

    for i in range(int(length_s * RATE_HZ)):
        t = i / RATE_HZ
        ms = int(1e3 * boot_s + 1e3 * t)
        position, (roll, pitch, yaw), rate = flown(t)
        if i % RATE_HZ == 0:
            add(t, mavlink.MAVLink_heartbeat_message(vehicle, 3, 0x89, 4, 4, 3))
        add(t, mavlink.MAVLink_attitude_message(ms, roll, pitch, yaw, 0.0, 0.0, rate))
        add(t, mavlink.MAVLink_local_position_ned_message(ms, *position, 0.2, 0.1, 0.2))
        latitude, longitude = place(t)
        fix = (round(1e7 * latitude), round(1e7 * longitude), 0, round(-1e3 * position[2]))
        add(t, mavlink.MAVLink_global_position_int_message(ms, *fix, 20, 10, 20, 0))
        if mount_deg is not None:
            pan, tilt, lean = (round(100.0 * angle) for angle in mount_deg)
            add(t, mavlink.MAVLink_mount_status_message(0, 0, tilt, lean, pan))
        if look_deg is not None:
            aside, down = (math.radians(angle) for angle in look_deg)
            yaws = (mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME, yaw + aside, down)
            ahead = (mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME, 0.0, 0.0)
            for device, (flags, *angles) in enumerate((yaws, ahead), 1):
                y, p = (0.5 * angle for angle in angles)
                q = [math.cos(y) * math.cos(p), -math.sin(y) * math.sin(p)]
                q += [math.cos(y) * math.sin(p), math.sin(y) * math.cos(p)]
                report = mavlink.MAVLink_gimbal_device_attitude_status_message(
                    0, 0, ms, flags, q, 0.0, 0.0, 0.0, 0, math.nan, math.nan, device
                )
                add(t + 0.001 * device, report)
    path.write_bytes(data)
    return path


_TYPES = {"Q": "Q", "I": "I", "f": "f", "B": "B", "M": "B", "h": "h", "H": "H", "b": "b"}
_TYPES |= {"c": "h", "C": "H", "L": "i", "n": "4s", "N": "16s", "Z": "64s"}
_SCALES = {"c": 100, "C": 100, "L": 1e7}
Formats = dict[str, tuple[str, str]]  # kind: format, columns
FORMATS_2024: Formats = {
    "VER": ("QBHBBBBIZHB", "TimeUS,BT,BST,Maj,Min,Pat,FWT,GH,FWS,APJ,BU"),
    "MSG": ("QZ", "TimeUS,Message"),
    "PARM": ("QNf", "TimeUS,Name,Value"),
    "ATT": ("QccccCCCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
    "XKF1": ("QBccCfffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD"),
    "NKF1": ("QBccCfffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD"),
    "XKF4": ("QBb", "TimeUS,C,PI"),
    "MODE": ("QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "EV": ("QB", "TimeUS,Id"),
    "MNT": ("QBfff", "TimeUS,I,Roll,Pitch,YawB"),
    "POS": ("QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "GPS": ("QBBIHLLffff", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt,Spd,GCrs,VZ"),
}
FORMATS_2014: Formats = {
    "MSG": ("Z", "Message"),
    "PARM": ("Nf", "Name,Value"),
    "ATT": ("IccccCC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "EKF1": ("IccCffffffccc", "TimeMS,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
    "MODE": ("Mh", "Mode,ThrCrs"),
    "EV": ("B", "Id"),
    "CURR": ("IhIhhhf", "TimeMS,ThrOut,ThrInt,Volt,Curr,Vcc,CurrTot"),
}


class BinWriter:
    """Packs DataFlash records as the autopilot writes them; what is not given of one is zero."""

    def __init__(self, formats: Formats) -> None:
        self._formats = {name: (n, *each) for n, (name, each) in enumerate(formats.items(), 1)}
        self.data = b""
        self._describe(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
        for name, (number, form, columns) in self._formats.items():
            self._describe(number, 3 + struct.calcsize(_packed(form)), name, form, columns)

    def _describe(self, number: int, length: int, *texts: str) -> None:
        fields = (number, length, *(text.encode() for text in texts))
        self.data += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *fields)

    def add(self, name: str, t: float, **values: float | str) -> None:
        """Add a record at a time since boot, s, if its kind is known."""
        if name not in self._formats:
            return
        number, form, columns = self._formats[name]
        values |= {"TimeUS": round(1e6 * t), "TimeMS": round(1e3 * t)}
        packed: list[int | float | bytes] = []
        for column, c in zip(columns.split(","), form, strict=True):
            value = values.get(column, "" if c in "nNZ" else 0)
            if isinstance(value, str):
                packed.append(value.encode())
            else:
                packed.append(round(_SCALES.get(c, 1) * value) if c != "f" else value)
        self.data += bytes([0xA3, 0x95, number]) + struct.pack(_packed(form), *packed)


def write_bin(
    path: Path,
    *,
    length_s: float = LENGTH_S,
    skip: tuple[str, ...] = ("NKF1", "XKF4", "POS", "GPS"),
    formats: Formats = FORMATS_2024,
    firmware: str = "ArduCopter V4.5.7 (2a3dc4b7)",
    estimator: int = 3,
    primary: int = 0,
    disarmed_s: float = 0.0,
    mount_deg: tuple[float, float, float] = (5.0, -60.0, 0.0),
) -> Path:
    """Write a DataFlash log.

    Args:
        path: of the file.
        length_s: of the flight.
        skip: messages of these kinds are left out.
        formats: the firmware's.
        firmware: as it names itself.
        estimator: AHRS_EKF_TYPE; the other one that is recorded is 99 m off.
        primary: of the two cores; the other one is 99 m off.
        disarmed_s: so long it stood disarmed before, its attitude measured once a second.
        mount_deg: yaw, pitch and roll of the gimbal as ArduPilot has them.
    """
    writer = BinWriter({name: form for name, form in formats.items() if name not in skip})
    writer.add("MSG", 7.0, Message=firmware)
    writer.add("PARM", 7.0, Name="AHRS_EKF_TYPE", Value=estimator)

    def add(t: float) -> None:
        boot = 8.0 + t + disarmed_s
        (n, e, d), (roll, pitch, yaw), _ = flown(max(0.0, t))
        shown = {"Roll": math.degrees(roll), "Pitch": math.degrees(pitch)}
        shown["Yaw"] = math.degrees(yaw) % 360.0
        right = {"VN": 0.2, "VE": 0.1, "VD": 0.2, "PN": n, "PE": e, "PD": d}
        wrong = dict.fromkeys(right, 99.0)
        writer.add("ATT", boot, **shown)
        for kind, number in (("XKF1", 3), ("NKF1", 2), ("EKF1", 3)):
            for core in (0, 1) if kind != "EKF1" else (0,):
                is_right = number == estimator and core == primary
                writer.add(kind, boot, C=core, **(right if is_right else wrong))
        writer.add("XKF4", boot, PI=primary)
        yaw_deg, pitch_deg, roll_deg = mount_deg
        writer.add("MNT", boot, Roll=roll_deg, Pitch=pitch_deg, YawB=yaw_deg)
        latitude, longitude = place(max(0.0, t))
        writer.add("POS", boot, Lat=latitude, Lng=longitude, Alt=400.0 - d, RelOriginAlt=-d)
        course = math.degrees(math.atan2(0.1, 0.2))
        fix = {"Lat": latitude, "Lng": longitude, "Alt": -d, "Spd": math.hypot(0.2, 0.1)}
        writer.add("GPS", boot, Status=3, GCrs=course, VZ=0.2, **fix)

    for i in range(int(disarmed_s)):
        add(i - disarmed_s)
    writer.add("MODE", 8.0 + disarmed_s, Mode=5, ModeNum=5)
    writer.add("EV", 8.0 + disarmed_s, Id=10)
    for i in range(int(length_s * RATE_HZ)):
        add(i / RATE_HZ)
    path.write_bytes(writer.data)
    return path


def _packed(form: str) -> str:
    return "<" + "".join(_TYPES[c] for c in form)


def write_video(path: Path, log: Path, gimbal_deg: tuple[float, float]) -> None:
    """Write the video of a flight from 6.3 s to 17 s, whose camera looks at the pad at its end.

    Args:
        path: of the video, its format by its name.
        log: of the flight.
        gimbal_deg: yaw and pitch of the fixed camera.
    """
    telemetry = read_telemetry(log)
    loaded = read_configuration(config_dir() / "default.yaml")
    options = loaded.options["sim"]
    assert isinstance(options, SimOptions)
    vehicle = RecordedVehicle(telemetry, gimbal_deg, pretended=False, start=telemetry.start)
    drawn = DrawnPictures(
        load_pad(loaded.config.pad.layout),
        load_camera(loaded.config.camera.calibration),
        options.render,
        vehicle,
        loaded.config.vehicle,
        PAD,
        start=telemetry.start + 6.3,
        fps=FPS,
    )
    code = cv2.VideoWriter.fourcc(*("MJPG" if path.suffix == ".avi" else "mp4v"))
    writer = cv2.VideoWriter(str(path), code, FPS, (640, 480), False)
    while (frame := drawn.expose(telemetry.start + 17.0)) is not None:
        writer.write(frame.image)
    writer.release()
