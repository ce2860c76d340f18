"""A modelled SimpleBGC controller on a serial port."""

import math

from hw.gimbals.simplebgc import (
    ANGLES_EXT,
    CMD_CONTROL,
    CMD_GET_ANGLES_EXT,
    CMD_MOTORS_ON,
    CONTROL,
    MODE_ANGLE,
    MODE_ANGLE_REL_FRAME,
    UNIT,
    SimpleBgcGimbal,
    SimpleBgcOptions,
    encode,
    frame_scanner,
)
from hw.sim.gimbals.bench import Bench, Connected
from hw.sim.gimbals.byte_model import ByteModel
from hw.sim.gimbals.mount import SimMount
from landerd.geometry import clamp
from landerd.messages import Reference
from landerd.ports import ByteLink

_PITCH_LIMITS = (math.radians(-30.0), math.radians(100.0))  # soft limits, rad; positive is down


class SimpleBgcModel(ByteModel):
    """The controller: it moves only with its motors on, and only in the driver's modes."""

    def __init__(self, mount: SimMount, link: ByteLink) -> None:
        super().__init__(mount, link, frame_scanner())
        mount.plant.reference = Reference.HORIZON
        self._motors = False

    def _booted(self) -> None:
        self._motors = False

    def _take(self, frame: bytes) -> None:
        command, payload = frame[1], frame[4:-2]
        if command == CMD_MOTORS_ON:
            self._motors = True
        elif command == CMD_CONTROL and len(payload) == CONTROL.size and self._motors:
            _, pitch_mode, yaw_mode, _, _, _, pitch, _, yaw = CONTROL.unpack(payload)
            if (pitch_mode, yaw_mode) == (MODE_ANGLE, MODE_ANGLE_REL_FRAME):
                self.mount.aim(UNIT * yaw, -clamp(UNIT * pitch, *_PITCH_LIMITS))
        elif command == CMD_GET_ANGLES_EXT:
            yaw, pitch = (round(angle / UNIT) for angle in self.mount.measure())
            heading = 1000  # of the IMU, from an arbitrary direction at power-on
            answer = ANGLES_EXT.pack(0, 0, 0, -pitch, 0, -pitch, heading, 0, yaw)
            self._answer(encode(CMD_GET_ANGLES_EXT, answer))


def connect(options: SimpleBgcOptions, bench: Bench) -> Connected:
    """Return driver and model, joined by a link."""
    near, far = bench.join(options.url)
    return SimpleBgcGimbal(options, near), SimpleBgcModel(bench.mount, far)
