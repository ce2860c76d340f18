"""SIYI gimbal cameras (A8 mini, ZR10, ZR30, ZT6, ZT30) over UDP or a serial port.

Source: SIYI, "Gimbal Camera External SDK Protocol": framing, CRC16 (polynomial 0x1021 from 0, low
byte first), commands 0x07 (speed), 0x0C (mode), 0x0D (attitude). Yaw is reported positive left and
ordered positive right (as ArduPilot's AP_Mount_Siyi reads it).

The angle command (0x0E) stops the yaw motor at each new order (ArduPilot issue 23149), so this
driver orders speeds, in hundredths of the largest, and closes the position loop itself. In the mode
"follow" pitch and roll are against the horizon, yaw against the airframe.
"""

import asyncio
import binascii
import math
import struct
from typing import Annotated

from pydantic import Field

from hw.gimbals.dialogue import Dialogue
from hw.gimbals.frames import FrameScanner
from hw.gimbals.mounting import Latency, Mounting, MountOptions
from hw.gimbals.rate_loop import RateLoop, RateLoopOptions
from landerd.messages import GimbalCommand, GimbalState
from landerd.ports import ByteLink
from landerd.section import Angle

CMD_ROTATE = 0x07
CMD_MODE = 0x0C
CMD_ATTITUDE = 0x0D
FOLLOW = 4  # value of CMD_MODE
ASK, ANSWER = 1, 2  # bits of the control byte: an answer is requested; this is an answer
ATTITUDE = struct.Struct("<6h")  # yaw, pitch, roll in 0.1 degrees; their speeds in 0.1 degrees/s
ROTATE = struct.Struct("<2b")  # speeds of yaw and pitch, -100 to 100
HEADER = struct.Struct("<2sBHHB")  # start, control, size of the data, number, command
UNIT = math.radians(0.1)

_START = b"\x55\x66"
_CRC = 2
_LONGEST_DATA = 64  # bytes; no frame that is used here has more data
_STALE_S = 0.2  # without angles for this long the motors are stopped


class SiyiOptions(MountOptions):
    """A SIYI gimbal."""

    url: str = "udpout:192.168.144.25:37260"  # or serial:/dev/ttyUSB0?baud=115200
    rate_hz: Annotated[float, Field(ge=10, le=100)] = 50.0
    latency_s: Latency = 0.005
    full_speed_deg_s: Annotated[float, Field(gt=0, le=360)] = 90.0  # that an order of 100 gives
    loop: RateLoopOptions = RateLoopOptions()
    yaw_limits_deg: tuple[Angle, Angle] = (-130.0, 130.0)
    pitch_limits_deg: tuple[Angle, Angle] = (-90.0, 25.0)


class SiyiGimbal:
    """Requests angles, and orders speeds at every answer to reach the target angles."""

    def __init__(self, options: SiyiOptions, link: ByteLink) -> None:
        self._mounting = Mounting(options)
        self.traits = self._mounting.traits
        self._full_speed = math.radians(options.full_speed_deg_s)
        integral_limit = math.radians(options.loop.integral_limit_deg_s)
        self._yaw, self._pitch = (
            RateLoop(options.loop, self._full_speed, integral_limit) for _ in range(2)
        )
        self._dialogue = Dialogue("SIYI", link, frame_scanner(), self._ask, options.rate_hz)
        self._number = 0
        self._target: tuple[float, float] | None = None  # yaw and pitch as the device counts them
        self._answered: float | None = None

    async def open(self) -> None:
        """Open the link. Raises DeviceLost."""
        await self._dialogue.open()
        self._yaw.reset()
        self._pitch.reset()
        self._answered = None

    async def state(self) -> GimbalState:
        """Wait for the next measured angles, and turn towards the target. Raises DeviceLost."""
        while True:
            t, frame = await self._dialogue.frame()
            _, control, size, _, command = HEADER.unpack(frame[: HEADER.size])
            if command != CMD_ATTITUDE or size != ATTITUDE.size or not control & ANSWER:
                continue
            values = [UNIT * v for v in ATTITUDE.unpack(frame[HEADER.size : -_CRC])]
            yaw, pitch, roll, yaw_rate, pitch_rate, _ = values
            yaw, yaw_rate = -yaw, -yaw_rate
            state = self._mounting.state(t, yaw, pitch, roll)
            if state is None:
                continue
            if self._dialogue.answered(t):
                self._send(CMD_MODE, bytes((FOLLOW,)))
            dt = t - self._answered if self._answered is not None else 0.0
            self._answered = t
            if self._target is not None:
                self._rotate(
                    self._yaw.step(self._target[0], yaw, yaw_rate, dt),
                    self._pitch.step(self._target[1], pitch, pitch_rate, dt),
                )
            return state

    def command(self, command: GimbalCommand) -> None:
        """Set new target angles."""
        angles = self._mounting.order(command)
        if angles is not None:
            self._target = angles

    async def close(self) -> None:
        """Stop the motors and release the link."""
        self._rotate(0.0, 0.0)
        await self._dialogue.close()

    def _ask(self) -> None:
        now = asyncio.get_running_loop().time()
        if self._answered is not None and now - self._answered > _STALE_S:
            self._answered = None
            self._yaw.reset()
            self._pitch.reset()
            self._rotate(0.0, 0.0)
        self._send(CMD_ATTITUDE, b"")

    def _rotate(self, yaw_rate: float, pitch_rate: float) -> None:
        full = 100.0 / self._full_speed
        self._send(CMD_ROTATE, ROTATE.pack(round(full * yaw_rate), round(full * pitch_rate)))

    def _send(self, command: int, data: bytes) -> None:
        self._dialogue.send(encode(ASK, self._number, command, data))
        self._number = (self._number + 1) & 0xFFFF


def encode(control: int, number: int, command: int, data: bytes) -> bytes:
    """Return a frame, to or from the gimbal."""
    body = HEADER.pack(_START, control, len(data), number, command) + data
    return body + struct.pack("<H", binascii.crc_hqx(body, 0))


def frame_scanner() -> FrameScanner:
    """Return a scanner for the frames."""

    def size(header: bytes) -> int | None:
        start, _, length, _, _ = HEADER.unpack(header)
        is_header = start == _START and length <= _LONGEST_DATA
        return HEADER.size + length + _CRC if is_header else None

    def is_sound(frame: bytes) -> bool:
        return int.from_bytes(frame[-_CRC:], "little") == binascii.crc_hqx(frame[:-_CRC], 0)

    return FrameScanner(_START[:1], HEADER.size, size, is_sound)
