"""A modelled STorM32 controller on a serial port."""

import math
import struct

from hw.gimbals.storm32 import (
    ATTITUDE,
    ATTITUDE_RELATIVE,
    CMD_GETDATAFIELDS,
    CMD_SETANGLES,
    FROM_GIMBAL,
    SET_ANGLES,
    TO_GIMBAL,
    TO_GIMBAL_SILENT,
    Storm32Gimbal,
    Storm32Options,
    encode,
    frame_scanner,
)
from hw.sim.gimbals.bench import Bench, Connected
from hw.sim.gimbals.byte_model import ByteModel
from hw.sim.gimbals.mount import SimMount
from landerd.messages import Reference
from landerd.ports import ByteLink

_CMD_ACK = 150  # command byte of an acknowledgement
_OK = b"\x00"  # its payload if all is well


class Storm32Model(ByteModel):
    """The controller, which answers all requests except those whose first byte asks for none."""

    def __init__(self, mount: SimMount, link: ByteLink) -> None:
        super().__init__(mount, link, frame_scanner(TO_GIMBAL + TO_GIMBAL_SILENT))
        mount.plant.reference = Reference.HORIZON

    def _booted(self) -> None:
        self.mount.aim(0.0, 0.0)  # it levels the camera

    def _take(self, frame: bytes) -> None:
        command, payload = frame[2], frame[3:-2]
        if command == CMD_SETANGLES and len(payload) == SET_ANGLES.size:
            pitch, _, yaw, _, _ = SET_ANGLES.unpack(payload)
            self.mount.aim(-math.radians(yaw), -math.radians(pitch))
            if frame[:1] == TO_GIMBAL:
                self._answer(encode(FROM_GIMBAL, _CMD_ACK, _OK))
        elif command == CMD_GETDATAFIELDS and payload == struct.pack("<H", ATTITUDE_RELATIVE):
            yaw, pitch = (math.degrees(angle) for angle in self.mount.measure())
            answer = ATTITUDE.pack(ATTITUDE_RELATIVE, 0, -pitch, 0.0, -yaw)
            self._answer(encode(FROM_GIMBAL, CMD_GETDATAFIELDS, answer))


def connect(options: Storm32Options, bench: Bench) -> Connected:
    """Return driver and model, joined by a link."""
    near, far = bench.join(options.url)
    return Storm32Gimbal(options, near), Storm32Model(bench.mount, far)
