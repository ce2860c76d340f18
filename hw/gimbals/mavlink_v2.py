"""A gimbal behind the autopilot, by MAVLink's gimbal protocol version 2.

Source: MAVLink, "Gimbal Protocol v2": GIMBAL_MANAGER_SET_PITCHYAW (287),
GIMBAL_DEVICE_ATTITUDE_STATUS (285), MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE (1001). ArduPilot 4.3 and
newer is the manager of whatever its MNT1_TYPE names, and tells the attitude of all of them; of a
gimbal of servos that is what was ordered (`feedback: false`). It takes a pitch-and-yaw order only
if both are numbers and the rates are not.

Pitch and roll are against the horizon, yaw against the airframe.
"""

import asyncio
import math
from collections import Counter
from typing import Annotated

from pydantic import Field
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import COMPONENT, MavlinkAutopilot
from hw.autopilots.mavlink_codec import Message
from hw.gimbals.mounting import Angle, Feedback, Mounting, MountOptions, gimbal_order
from hw.gimbals.reports import Reports
from landerd.geometry import Mat3, wrap
from landerd.messages import GimbalCommand, GimbalState, Reference

_LOCKS = mavlink.GIMBAL_MANAGER_FLAGS_ROLL_LOCK | mavlink.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
_VEHICLE_YAW = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
_EARTH_YAW = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME
_YAW_LOCK = mavlink.GIMBAL_DEVICE_FLAGS_YAW_LOCK
_UNCHANGED = -1.0  # of MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE


class MavlinkOptions(MountOptions):
    """A gimbal that the autopilot drives."""

    device_id: Annotated[int, Field(ge=0, le=255)] = 0  # 0: all there are
    rate_hz: Annotated[float, Field(ge=10, le=50)] = 50.0  # angles are asked for
    command_hz: Annotated[float, Field(ge=5, le=50)] = 20.0
    latency_s: Annotated[float, Field(ge=0, le=0.2)] = 0.02  # from measurement to its time stamp
    feedback: bool = True  # false: servos, whose angles nobody measures
    yaw_limits_deg: tuple[Angle, Angle] = (-90.0, 90.0)
    pitch_limits_deg: tuple[Angle, Angle] = (-90.0, 20.0)


class MavlinkGimbal:
    """Orders and reports pass through the autopilot's link.

    Attributes:
        counters: reports that could not be used, by kind.
    """

    def __init__(self, options: MavlinkOptions, autopilot: MavlinkAutopilot) -> None:
        self.counters: Counter[str] = Counter()
        self._options, self._autopilot = options, autopilot
        feedback = Feedback.MEASURED if options.feedback else Feedback.ORDERED
        self._mounting = Mounting(options, Reference.HORIZON, options.rate_hz, feedback)
        self.traits = self._mounting.traits
        self._reports = Reports()
        self._sent_t = -math.inf
        self._boot_ms: int | None = None  # of the last report
        autopilot.subscribe(
            mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS, options.rate_hz, self._take
        )

    async def open(self) -> None:
        """Begin anew."""
        self._reports.clear()
        self._boot_ms = None

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

    async def close(self) -> None:
        """Nothing to release: the link is the autopilot's."""

    def _claim(self) -> None:
        """Ask for control of the gimbal."""
        self._autopilot.command(
            mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
            *(float(self._autopilot.system_id), float(COMPONENT)),
            *(_UNCHANGED, _UNCHANGED, 0.0, 0.0),
            float(self._options.device_id),
        )

    def _take(self, m: Message, t: float) -> None:
        if self._boot_ms is None or m.time_boot_ms < self._boot_ms:  # the autopilot has restarted
            self._claim()
        self._boot_ms = m.time_boot_ms
        R = _matrix(m.q)
        if R is None:
            self.counters["bad quaternion"] += 1
            return
        yaw, pitch, roll = gimbal_order(R)
        if m.flags & _EARTH_YAW or (m.flags & _YAW_LOCK and not m.flags & _VEHICLE_YAW):
            if not (math.isfinite(m.delta_yaw) and m.delta_yaw != 0.0):
                self.counters["yaw from north"] += 1
                return
            yaw = wrap(yaw - m.delta_yaw)
        state = self._mounting.state(t - self._options.latency_s, yaw, pitch, roll)
        if state is not None:
            self._reports.put(state)


def _matrix(q: list[float]) -> Mat3 | None:
    """Return the rotation of a quaternion (w, x, y, z); None if it is none."""
    w, x, y, z = q
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 < length < 1.1:
        return None
    w, x, y, z = w / length, x / length, y / length, z / length
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
