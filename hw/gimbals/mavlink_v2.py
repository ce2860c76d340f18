"""A gimbal behind the autopilot, by MAVLink's gimbal protocol version 2.

Source: MAVLink, "Gimbal Protocol v2": GIMBAL_MANAGER_SET_PITCHYAW (287),
GIMBAL_DEVICE_ATTITUDE_STATUS (285), MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE (1001). ArduPilot 4.3 and
newer is the manager of every gimbal type that MNT1_TYPE may name, and reports its attitude; for a
servo gimbal that is the ordered one (`feedback: false`). It accepts an order of pitch and yaw only
if both angles are numbers and both rates are NaN.

The attitude is that of the reported quaternion. Where ArduPilot computes this from a gimbal's own
angles, it composes them as yaw, pitch, roll. For a gimbal whose roll axis is below its yaw axis the
result is wrong by the roll while the camera looks straight down; landerd cannot detect that, so
keep the roll at 0.

Pitch and roll are against the horizon, yaw against the airframe.
"""

import logging
import math
from typing import Annotated

from pydantic import Field
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import COMPONENT, MavlinkAutopilot
from hw.autopilots.mavlink_codec import Message
from hw.autopilots.telemetry import gimbal_yaw_is_from_north
from hw.gimbals.behind_autopilot import BehindAutopilotGimbal, BehindAutopilotOptions
from landerd.geometry import angles_zxy, rotation, wrap

log = logging.getLogger(__name__)

_LOCKS = mavlink.GIMBAL_MANAGER_FLAGS_ROLL_LOCK | mavlink.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
_UNCHANGED = -1.0  # of MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE


class MavlinkOptions(BehindAutopilotOptions):
    """A gimbal that the autopilot drives."""

    # 0: all there are are ordered, and the one that is heard first is believed
    device_id: Annotated[int, Field(ge=0, le=255)] = 0


class MavlinkGimbal(BehindAutopilotGimbal):
    """Orders by GIMBAL_MANAGER_SET_PITCHYAW; the pilot is told once of unusable reports."""

    _options: MavlinkOptions

    def __init__(self, options: MavlinkOptions, autopilot: MavlinkAutopilot) -> None:
        self._told: set[str] = set()
        self._boot_ms: int | None = None  # of the last report
        self._device_id = options.device_id  # device whose reports are used; 0: not known yet
        report = mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS
        super().__init__(options, autopilot, report)

    async def open(self) -> None:
        """Discard old reports, and claim control again."""
        await super().open()
        self._boot_ms = None
        self._device_id = self._options.device_id

    def _order(self, yaw: float, pitch: float) -> None:
        self._autopilot.send(
            mavlink.MAVLink_gimbal_manager_set_pitchyaw_message(
                self._autopilot.system_id,
                mavlink.MAV_COMP_ID_AUTOPILOT1,
                _LOCKS,
                self._options.device_id,
                pitch,
                yaw,
                math.nan,
                math.nan,
            )
        )

    def _claim(self) -> None:
        """Ask for control of the gimbal."""
        self._autopilot.command(
            mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
            *(float(self._autopilot.system_id), float(COMPONENT)),
            *(_UNCHANGED, _UNCHANGED, 0.0, 0.0),
            float(self._options.device_id),
        )

    def _counts(self, m: Message) -> bool:
        # ArduPilot reports all its mounts in turn; older versions do so without their numbers.
        device = m.gimbal_device_id
        self._device_id = self._device_id or device
        if device in (0, self._device_id):
            return True
        if not self._options.device_id:
            self._tell(
                f"there are gimbals {self._device_id} and {device}: {self._device_id} is believed, "
                "both are ordered; set gimbal.mavlink.device_id"
            )
        return False

    def _angles(self, m: Message) -> tuple[float, float, float] | None:
        if self._boot_ms is None or m.time_boot_ms < self._boot_ms:  # the autopilot has restarted
            self._claim()
        self._boot_ms = m.time_boot_ms
        R = rotation(m.q)
        if R is None:
            self._tell_useless("is no rotation")
            return None
        yaw, pitch, roll = angles_zxy(R)
        if gimbal_yaw_is_from_north(m):
            if not (math.isfinite(m.delta_yaw) and m.delta_yaw != 0.0):
                self._tell_useless("has its yaw from north, without delta_yaw")
                return None
            yaw = wrap(yaw - m.delta_yaw)
        return yaw, pitch, roll

    def _tell_useless(self, why: str) -> None:
        self._tell(f"what the gimbal reports {why}: it cannot be used")

    def _tell(self, what: str) -> None:
        if what not in self._told:
            self._told.add(what)
            log.warning("%s", what)
