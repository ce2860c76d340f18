"""A modelled SIYI gimbal on UDP or a serial port."""

import math

from hw.gimbals.siyi import (
    ANSWER,
    ATTITUDE,
    CMD_ATTITUDE,
    CMD_MODE,
    CMD_ROTATE,
    FOLLOW,
    HEADER,
    ROTATE,
    UNIT,
    SiyiGimbal,
    SiyiOptions,
    encode,
    frame_scanner,
)
from hw.sim.gimbals.bench import Bench, Connected
from hw.sim.gimbals.byte_model import ByteModel
from hw.sim.gimbals.mount import SimMount
from landerd.geometry import clamp
from landerd.messages import Reference
from landerd.ports import ByteLink

_FULL_SPEED = math.radians(90.0)  # turn rate for an order of 100, rad/s


class SiyiModel(ByteModel):
    """The gimbal, which turns at the ordered rates until the next order."""

    def __init__(self, mount: SimMount, link: ByteLink) -> None:
        super().__init__(mount, link, frame_scanner())
        mount.plant.reference = Reference.HORIZON
        self._mode = 0

    def _booted(self) -> None:
        self._mode = 0
        self._turn(0, 0)

    def _take(self, frame: bytes) -> None:
        _, _, _, number, command = HEADER.unpack(frame[: HEADER.size])
        data = frame[HEADER.size : -2]
        if command == CMD_MODE and len(data) == 1:
            self._mode = data[0]
        elif command == CMD_ROTATE and len(data) == ROTATE.size:
            if self._mode == FOLLOW:
                self._turn(*ROTATE.unpack(data))
            self._answer(encode(ANSWER, number, CMD_ROTATE, b"\x01"))
        elif command == CMD_ATTITUDE:
            yaw, pitch = (round(angle / UNIT) for angle in self.mount.measure())
            yaw_rate, pitch_rate = (round(rate / UNIT) for rate in self.mount.rates)
            answer = ATTITUDE.pack(-yaw, pitch, 0, -yaw_rate, pitch_rate, 0)
            self._answer(encode(ANSWER, number, CMD_ATTITUDE, answer))

    def _turn(self, yaw: int, pitch: int) -> None:
        """Order turn rates from -100 to 100."""
        share = _FULL_SPEED / 100.0
        self.mount.turn(share * clamp(yaw, -100, 100), share * clamp(pitch, -100, 100))


def connect(options: SiyiOptions, bench: Bench) -> Connected:
    """Return driver and model, joined by a link."""
    near, far = bench.join(options.url)
    return SiyiGimbal(options, near), SiyiModel(bench.mount, far)
