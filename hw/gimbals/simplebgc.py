"""BaseCam SimpleBGC controllers (AlexMos) on a serial port, serial API version 2.

Source: BaseCam Electronics, "SimpleBGC32 Serial API protocol specification" (2.6x): framing and CRC
of protocol version 2, CMD_CONTROL (extended form), CMD_GET_ANGLES_EXT, CMD_MOTORS_ON; direction of
pitch: "SimpleBGC 32-bit software user manual" (2.6x), RC settings: from level to down is 0 to 90.
Firmware 2.68 or newer.

Pitch and roll are measured against the horizon by the camera's IMU, yaw against the frame by the
motor's encoder (or the frame's IMU); pitch is ordered against the horizon, yaw against the frame.
"""

import math
import struct
from typing import Annotated

from pydantic import Field

from hw.gimbals.dialogue import Dialogue
from hw.gimbals.frames import FrameScanner
from hw.gimbals.mounting import Latency, Mounting, MountOptions
from landerd.messages import GimbalCommand, GimbalState
from landerd.ports import ByteLink
from landerd.section import Angle

CMD_CONTROL = 67
CMD_MOTORS_ON = 77
CMD_GET_ANGLES_EXT = 61
MODE_ANGLE, MODE_ANGLE_REL_FRAME = 2, 5
UNIT = math.radians(360.0 / 16384.0)  # unit of angles, rad
SPEED_UNIT = math.radians(0.1220740379)  # unit of speeds, rad/s
CONTROL = struct.Struct("<3B6h")  # modes of roll, pitch, yaw; then speed and angle of each
ANGLES_EXT = struct.Struct("<" + "hhi10x" * 3)  # IMU, target and joint angle of roll, pitch, yaw

_START = b"$"
_HEADER = 4  # bytes: start, command, size, their checksum
_CRC = 2
_POLYNOMIAL = 0x8005


class SimpleBgcOptions(MountOptions):
    """A SimpleBGC controller."""

    url: str = "serial:/dev/ttyUSB0?baud=115200"
    rate_hz: Annotated[float, Field(ge=10, le=100)] = 50.0
    latency_s: Latency = 0.005
    speed_deg_s: Annotated[float, Field(gt=0, le=1000)] = 120.0  # at most
    yaw_limits_deg: tuple[Angle, Angle] = (-170.0, 170.0)
    pitch_limits_deg: tuple[Angle, Angle] = (-100.0, 30.0)


class SimpleBgcGimbal:
    """Orders and requests angles over the serial API."""

    def __init__(self, options: SimpleBgcOptions, link: ByteLink) -> None:
        self._mounting = Mounting(options)
        self.traits = self._mounting.traits
        self._speed = round(math.radians(options.speed_deg_s) / SPEED_UNIT)
        self._dialogue = Dialogue("SimpleBGC", link, frame_scanner(), self._ask, options.rate_hz)

    async def open(self) -> None:
        """Open the port. Raises DeviceLost."""
        await self._dialogue.open()

    async def state(self) -> GimbalState:
        """Wait for the next measured angles. Raises DeviceLost."""
        while True:
            t, frame = await self._dialogue.frame()
            if frame[1] != CMD_GET_ANGLES_EXT or frame[2] != ANGLES_EXT.size:
                continue
            roll, _, _, pitch, _, _, _, _, yaw = ANGLES_EXT.unpack(frame[_HEADER:-_CRC])
            yaw = math.remainder(yaw, 16384.0)  # the encoder counts whole turns, too
            state = self._mounting.state(t, UNIT * yaw, -UNIT * pitch, UNIT * roll)
            if state is not None:
                if self._dialogue.answered(t):
                    self._dialogue.send(encode(CMD_MOTORS_ON))
                return state

    def command(self, command: GimbalCommand) -> None:
        """Order new angles."""
        angles = self._mounting.order(command)
        if angles is None:
            return
        yaw, pitch = angles
        self._dialogue.send(
            encode(
                CMD_CONTROL,
                CONTROL.pack(
                    *(MODE_ANGLE, MODE_ANGLE, MODE_ANGLE_REL_FRAME),
                    *(self._speed, 0),
                    *(self._speed, round(-pitch / UNIT)),
                    *(self._speed, round(yaw / UNIT)),
                ),
            )
        )

    async def close(self) -> None:
        """Release the port; the gimbal holds its angles."""
        await self._dialogue.close()

    def _ask(self) -> None:
        self._dialogue.send(encode(CMD_GET_ANGLES_EXT))


def encode(command: int, payload: bytes = b"") -> bytes:
    """Return the frame of a command, to or from the gimbal."""
    size = len(payload)
    body = bytes((command, size, (command + size) & 0xFF)) + payload
    return _START + body + struct.pack("<H", crc16(body))


def frame_scanner() -> FrameScanner:
    """Return a scanner for frames of protocol version 2, whose header has its own checksum."""

    def size(header: bytes) -> int | None:
        is_header = header[3] == (header[1] + header[2]) & 0xFF
        return _HEADER + header[2] + _CRC if is_header else None

    def is_sound(frame: bytes) -> bool:
        return int.from_bytes(frame[-_CRC:], "little") == crc16(frame[1:-_CRC])

    return FrameScanner(_START, _HEADER, size, is_sound)


def crc16(data: bytes) -> int:
    """Return the CRC of the specification: polynomial 0x8005 from 0, lowest bit of a byte first."""
    crc = 0
    for byte in data:
        for bit in range(8):
            carry = crc >> 15 ^ byte >> bit & 1
            crc = crc << 1 & 0xFFFF ^ (_POLYNOMIAL if carry else 0)
    return crc
