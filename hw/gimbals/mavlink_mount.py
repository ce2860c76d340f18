"""A gimbal behind an older autopilot firmware, by MAVLink's mount messages.

Source: MAVLink common message set: MAV_CMD_DO_MOUNT_CONTROL (205; degrees, pitch up, yaw right),
MAV_MOUNT_MODE_MAVLINK_TARGETING, MOUNT_ORIENTATION (265), and MOUNT_STATUS (158) of ArduPilot's
own set, in hundredths of a degree. ArduPilot up to 4.2 knows MOUNT_STATUS only; newer ones want the
driver `mavlink`. ArduPilot 4.1 mistakes the units of the order and of the report for gimbals of
servos: use 4.3 or newer with those.

Pitch and roll are against the horizon, yaw against the airframe.
"""

import asyncio
import math
from typing import Annotated, Literal

from pydantic import Field
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import Message
from hw.gimbals.mounting import Angle, Feedback, Mounting, MountOptions
from hw.gimbals.reports import Reports
from landerd.messages import GimbalCommand, GimbalState, Reference

_REPORTS = {
    "mount_orientation": mavlink.MAVLINK_MSG_ID_MOUNT_ORIENTATION,
    "mount_status": mavlink.MAVLINK_MSG_ID_MOUNT_STATUS,
}


class MavlinkMountOptions(MountOptions):
    """A gimbal that the autopilot drives."""

    report: Literal["mount_orientation", "mount_status"] = "mount_orientation"
    rate_hz: Annotated[float, Field(ge=10, le=50)] = 25.0  # angles are asked for
    command_hz: Annotated[float, Field(ge=5, le=50)] = 20.0  # at most; each is acknowledged
    latency_s: Annotated[float, Field(ge=0, le=0.2)] = 0.02  # from measurement to time stamp
    feedback: bool = True  # false: servos, whose angles nobody measures
    yaw_limits_deg: tuple[Angle, Angle] = (-90.0, 90.0)
    pitch_limits_deg: tuple[Angle, Angle] = (-90.0, 20.0)


class MavlinkMountGimbal:
    """Orders and reports pass through the autopilot's link."""

    def __init__(self, options: MavlinkMountOptions, autopilot: MavlinkAutopilot) -> None:
        self._options, self._autopilot = options, autopilot
        feedback = Feedback.MEASURED if options.feedback else Feedback.ORDERED
        self._mounting = Mounting(options, Reference.HORIZON, options.rate_hz, feedback)
        self.traits = self._mounting.traits
        self._reports = Reports()
        self._sent_t = -math.inf
        autopilot.subscribe(_REPORTS[options.report], options.rate_hz, self._take)

    async def open(self) -> None:
        """Begin anew."""
        self._reports.clear()

    async def state(self) -> GimbalState:
        """Wait for the next report."""
        return await self._reports.next()

    def command(self, command: GimbalCommand) -> None:
        """Order new angles, at most `command_hz` times a second."""
        now = asyncio.get_running_loop().time()
        angles = self._mounting.order(command)
        if angles is None or now - self._sent_t < 1.0 / self._options.command_hz - 1e-6:
            return
        self._sent_t = now
        yaw, pitch = angles
        self._autopilot.command(
            mavlink.MAV_CMD_DO_MOUNT_CONTROL,
            math.degrees(pitch),
            0.0,
            math.degrees(yaw),
            *(0.0, 0.0, 0.0),
            float(mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING),
        )

    async def close(self) -> None:
        """Nothing to release: the link is the autopilot's."""

    def _take(self, m: Message, t: float) -> None:
        if self._options.report == "mount_orientation":
            yaw, pitch, roll = m.yaw, m.pitch, m.roll
        else:
            yaw, pitch, roll = 0.01 * m.pointing_c, 0.01 * m.pointing_a, 0.01 * m.pointing_b
        state = self._mounting.state(
            t - self._options.latency_s, math.radians(yaw), math.radians(pitch), math.radians(roll)
        )
        if state is not None:
            self._reports.put(state)
