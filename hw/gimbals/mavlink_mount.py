"""A gimbal behind an older autopilot firmware, by MAVLink's mount messages.

Source: MAVLink common message set: MAV_CMD_DO_MOUNT_CONTROL (205; degrees, pitch up, yaw right),
MAV_MOUNT_MODE_MAVLINK_TARGETING, MOUNT_ORIENTATION (265), and MOUNT_STATUS (158) of ArduPilot's
own set, in hundredths of a degree. ArduPilot up to 4.2 has MOUNT_STATUS only; for newer versions
use the driver `mavlink`. With servo gimbals ArduPilot 4.1 confuses the units of the order and of
the report: use 4.3 or newer for these.

Pitch and roll are against the horizon, yaw against the airframe. ArduPilot composes them as yaw,
pitch, roll (Quaternion::from_euler and to_euler: Rz Ry Rx), landerd as yaw, roll, pitch: they are
converted, or straight down a roll of 3 degrees would be 3 degrees of lens direction.
"""

import math
from typing import Annotated, Literal

from pydantic import Field
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import Message
from hw.gimbals.behind_autopilot import BehindAutopilotGimbal, BehindAutopilotOptions
from landerd.geometry import angles_zxy, rot_zyx

_REPORTS = {
    "mount_orientation": mavlink.MAVLINK_MSG_ID_MOUNT_ORIENTATION,
    "mount_status": mavlink.MAVLINK_MSG_ID_MOUNT_STATUS,
}


class MavlinkMountOptions(BehindAutopilotOptions):
    """A gimbal that an older autopilot drives; each order is acknowledged."""

    report: Literal["mount_orientation", "mount_status"] = "mount_orientation"
    rate_hz: Annotated[float, Field(ge=10, le=50)] = 25.0


class MavlinkMountGimbal(BehindAutopilotGimbal):
    """DO_MOUNT_CONTROL, and the mount's reports."""

    _options: MavlinkMountOptions

    def __init__(self, options: MavlinkMountOptions, autopilot: MavlinkAutopilot) -> None:
        super().__init__(options, autopilot, _REPORTS[options.report])

    def _order(self, yaw: float, pitch: float) -> None:
        self._autopilot.command(
            mavlink.MAV_CMD_DO_MOUNT_CONTROL,
            math.degrees(pitch),
            0.0,
            math.degrees(yaw),
            *(0.0, 0.0, 0.0),
            float(mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING),
        )

    def _angles(self, m: Message) -> tuple[float, float, float] | None:
        if self._options.report == "mount_orientation":
            yaw, pitch, roll = m.yaw, m.pitch, m.roll
        else:
            yaw, pitch, roll = 0.01 * m.pointing_c, 0.01 * m.pointing_a, 0.01 * m.pointing_b
        return angles_zxy(rot_zyx(math.radians(yaw), math.radians(pitch), math.radians(roll)))
