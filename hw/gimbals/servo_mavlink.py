"""Servos on the autopilot's outputs, by MAV_CMD_DO_SET_SERVO.

Source: MAVLink common message set, MAV_CMD_DO_SET_SERVO (183). ArduPilot takes it only for outputs
whose SERVOn_FUNCTION is 0 (or pass-through), and moves the servo at once.
"""

import asyncio
import math
from typing import Annotated, Self

from pydantic import Field, model_validator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.gimbals.i2c import KERNELS, I2c
from hw.gimbals.imu import ReadableBus
from hw.gimbals.servo import TILT, ServoAxisOptions, ServoGimbal, ServoOptions

_REPEAT_S = 1.0  # interval at which an order is repeated, as one may have been lost


class ServoMavlinkOptions(ServoOptions):
    """Servos on the autopilot; their channels are its outputs, from 1."""

    pitch: ServoAxisOptions = ServoAxisOptions(channel=9, table=TILT)
    command_hz: Annotated[float, Field(ge=5, le=50)] = 20.0  # at most; each is acknowledged

    @model_validator(mode="after")
    def _outputs(self) -> Self:
        if any(axis.channel == 0 for axis in self.axes):
            raise ValueError("channel: found 0, the autopilot's outputs count from 1")
        return self


class ServoMavlinkGimbal(ServoGimbal):
    """Servos on the autopilot's outputs."""

    def __init__(
        self,
        options: ServoMavlinkOptions,
        autopilot: MavlinkAutopilot,
        imu_i2c: I2c[ReadableBus] = KERNELS,
    ) -> None:
        super().__init__(options, AutopilotOutputs(autopilot, 1.0 / options.command_hz), imu_i2c)


class AutopilotOutputs:
    """The autopilot's servo outputs."""

    def __init__(self, autopilot: MavlinkAutopilot, period_s: float) -> None:
        self._autopilot, self._period_s = autopilot, period_s
        self._sent: dict[int, tuple[float, int]] = {}  # time (s) and last pulse (us) by channel

    async def open(self) -> None:
        """Forget the pulses sent, so that all are sent again."""
        self._sent.clear()

    def write(self, pulses: dict[int, float]) -> None:
        """Order pulse widths, us by output, that have changed or are to be repeated."""
        now = asyncio.get_running_loop().time()
        for channel, pulse in pulses.items():
            pulse_us = round(pulse)
            sent_t, sent_us = self._sent.get(channel, (-math.inf, 0))
            period = self._period_s if pulse_us != sent_us else _REPEAT_S
            if now - sent_t >= period - 1e-6:
                self._sent[channel] = (now, pulse_us)
                self._autopilot.command(
                    mavlink.MAV_CMD_DO_SET_SERVO, float(channel), float(pulse_us)
                )

    async def close(self) -> None:
        """Leave the outputs as they are."""
