"""STorM32 controllers on a serial port, with the firmware's "RC commands".

Source: STorM32-BGC wiki, "Serial Communication - RC Commands", and the C library of its author
(github.com/olliw42/storm32bgc, c-library/STorM32_lib.h): framing, X25 checksum, CMD_SETANGLES (17),
CMD_GETDATAFIELDS (6) with LIVEDATA_ATTITUDE_RELATIVE. A frame that starts with 0xF9 is not
acknowledged. The gimbal's axes are x forward, y left, z up: pitch is positive down and yaw positive
left (the author's ArduPilot driver reverses both signs).

Pitch and roll are measured against the horizon, yaw against the airframe.
"""

import math
import struct
from typing import Annotated

from pydantic import Field
from pymavlink.generator.mavcrc import x25crc

from hw.gimbals.dialogue import Dialogue
from hw.gimbals.frames import FrameScanner
from hw.gimbals.mounting import Latency, Mounting, MountOptions
from landerd.messages import GimbalCommand, GimbalState
from landerd.ports import ByteLink
from landerd.section import Angle

CMD_GETDATAFIELDS = 6
CMD_SETANGLES = 17
ATTITUDE_RELATIVE = 0x1000
TO_GIMBAL, TO_GIMBAL_SILENT, FROM_GIMBAL = b"\xfa", b"\xf9", b"\xfb"
SET_ANGLES = struct.Struct("<3fBB")  # pitch, roll, yaw in degrees; flags; type
ATTITUDE = struct.Struct("<HI3f")  # fields; time since boot, ms; pitch, roll, yaw in degrees

_HEADER, _CRC = 3, 2
_LONGEST_PAYLOAD = 77  # bytes in the longest answer


class Storm32Options(MountOptions):
    """A STorM32 controller."""

    url: str = "serial:/dev/ttyACM0?baud=115200"
    rate_hz: Annotated[float, Field(ge=10, le=50)] = 25.0
    latency_s: Latency = 0.008
    yaw_limits_deg: tuple[Angle, Angle] = (-120.0, 120.0)
    pitch_limits_deg: tuple[Angle, Angle] = (-100.0, 25.0)


class Storm32Gimbal:
    """Orders and requests angles by RC commands."""

    def __init__(self, options: Storm32Options, link: ByteLink) -> None:
        self._mounting = Mounting(options)
        self.traits = self._mounting.traits
        self._dialogue = Dialogue(
            "STorM32", link, frame_scanner(FROM_GIMBAL), self._ask, options.rate_hz
        )

    async def open(self) -> None:
        """Open the port. Raises DeviceLost."""
        await self._dialogue.open()

    async def state(self) -> GimbalState:
        """Wait for the next measured angles. Raises DeviceLost."""
        while True:
            t, frame = await self._dialogue.frame()
            if frame[2] != CMD_GETDATAFIELDS or frame[1] != ATTITUDE.size:
                continue
            fields, _, pitch, roll, yaw = ATTITUDE.unpack(frame[_HEADER:-_CRC])
            if fields != ATTITUDE_RELATIVE:
                continue
            state = self._mounting.state(
                t, -math.radians(yaw), -math.radians(pitch), math.radians(roll)
            )
            if state is not None:
                self._dialogue.answered(t)
                return state

    def command(self, command: GimbalCommand) -> None:
        """Order new angles."""
        angles = self._mounting.order(command)
        if angles is None:
            return
        yaw, pitch = angles
        payload = SET_ANGLES.pack(-math.degrees(pitch), 0.0, -math.degrees(yaw), 0, 0)
        self._dialogue.send(encode(TO_GIMBAL_SILENT, CMD_SETANGLES, payload))

    async def close(self) -> None:
        """Release the port; the gimbal holds its angles."""
        await self._dialogue.close()

    def _ask(self) -> None:
        fields = struct.pack("<H", ATTITUDE_RELATIVE)
        self._dialogue.send(encode(TO_GIMBAL, CMD_GETDATAFIELDS, fields))


def encode(start: bytes, command: int, payload: bytes) -> bytes:
    """Return the frame of a command, to or from the gimbal."""
    body = bytes((len(payload), command)) + payload
    return start + body + struct.pack("<H", x25crc(body).crc)


def frame_scanner(starts: bytes) -> FrameScanner:
    """Return a scanner for frames that begin with one of these bytes."""

    def size(header: bytes) -> int | None:
        return _HEADER + header[1] + _CRC if header[1] <= _LONGEST_PAYLOAD else None

    def is_sound(frame: bytes) -> bool:
        crc: int = x25crc(frame[1:-_CRC]).crc
        return int.from_bytes(frame[-_CRC:], "little") == crc

    return FrameScanner(starts, _HEADER, size, is_sound)
