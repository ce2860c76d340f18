"""A gimbal that the autopilot drives, as ArduCopter presents it: version 2 and mount protocol."""

import math
from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message
from hw.gimbals.mavlink_mount import MavlinkMountGimbal, MavlinkMountOptions
from hw.gimbals.mavlink_v2 import MavlinkGimbal, MavlinkOptions
from hw.sim.gimbals.bench import Bench, Connected
from hw.sim.gimbals.mount import SimMount
from landerd.geometry import clamp, is_finite
from landerd.messages import Reference

_PITCH_LIMITS = (math.radians(-90.0), math.radians(20.0))  # MNT1_PITCH_MIN, MNT1_PITCH_MAX
_LOCKS = mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
_NONE = float("nan")  # value of a field that is not given

Streams = Mapping[int, Callable[[float, int], Message]]


class GimbalManager:
    """ArduCopter 4.3 and newer: gimbal protocol version 2 and DO_MOUNT_CONTROL; no mount reports.

    Attributes:
        claims: number of requests for control of the gimbal.
    """

    def __init__(self, mount: SimMount) -> None:
        """Take the gimbal, which levels its pitch to the horizon."""
        self.claims = 0
        self._mount = mount
        mount.plant.reference = Reference.HORIZON

    @property
    def streams(self) -> Streams:
        """Makers of the gimbal's attitude messages, by message id."""
        return {mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self._attitude}

    def command(self, command: Message, t: float) -> int | None:
        """Obey DO_MOUNT_CONTROL and requests for control; return a MAV_RESULT, None: not for it."""
        if command.command == mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE:
            self.claims += 1
            return int(mavlink.MAV_RESULT_ACCEPTED)
        return mount_control(self._mount, command)

    def message(self, message: Message, t: float) -> None:
        """Obey GIMBAL_MANAGER_SET_PITCHYAW with angles, no rates, and yaw from the airframe."""
        if message.get_msgId() != mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_PITCHYAW:
            return
        has_rates = math.isfinite(message.pitch_rate) or math.isfinite(message.yaw_rate)
        locks_yaw = message.flags & mavlink.GIMBAL_MANAGER_FLAGS_YAW_LOCK
        if is_finite((message.pitch, message.yaw, 0.0)) and not has_rates and not locks_yaw:
            aim(self._mount, message.yaw, message.pitch)

    def _attitude(self, t: float, boot_ms: int) -> Message:
        yaw, pitch = self._mount.measure()
        cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
        return mavlink.MAVLink_gimbal_device_attitude_status_message(
            *(0, 0, boot_ms),
            _LOCKS | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME,
            [cy * cp, -sy * sp, cy * sp, sy * cp],  # yaw, then pitch
            *(_NONE, _NONE, _NONE),
            0,
        )


class OldMount:
    """Older firmware, which reports the angles of the mount instead."""

    def __init__(self, mount: SimMount) -> None:
        """Take the gimbal, which levels its pitch to the horizon."""
        self._mount = mount
        mount.plant.reference = Reference.HORIZON

    @property
    def streams(self) -> Streams:
        """Makers of both mount reports, by message id; a real firmware sends only one of them."""
        return {
            mavlink.MAVLINK_MSG_ID_MOUNT_ORIENTATION: self._orientation,
            mavlink.MAVLINK_MSG_ID_MOUNT_STATUS: self._status,
        }

    def command(self, command: Message, t: float) -> int | None:
        """Obey DO_MOUNT_CONTROL; return a MAV_RESULT, None: the command is not for it."""
        return mount_control(self._mount, command)

    def message(self, message: Message, t: float) -> None:
        """Ignore all messages."""

    def _orientation(self, t: float, boot_ms: int) -> Message:
        yaw, pitch = (math.degrees(angle) for angle in self._mount.measure())
        return mavlink.MAVLink_mount_orientation_message(boot_ms, 0.0, pitch, yaw, 0.0)

    def _status(self, t: float, boot_ms: int) -> Message:
        yaw, pitch = (round(1e2 * math.degrees(angle)) for angle in self._mount.measure())
        return mavlink.MAVLink_mount_status_message(0, 0, pitch, 0, yaw)


def mount_control(mount: SimMount, command: Message) -> int | None:
    """Obey DO_MOUNT_CONTROL in the mode MAVLINK_TARGETING.

    Returns:
        a MAV_RESULT; None: it is another command.
    """
    if command.command != mavlink.MAV_CMD_DO_MOUNT_CONTROL:
        return None
    if command.param7 != mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING:
        return int(mavlink.MAV_RESULT_FAILED)
    aim(mount, math.radians(command.param3), math.radians(command.param1))
    return int(mavlink.MAV_RESULT_ACCEPTED)


def aim(mount: SimMount, yaw: float, pitch: float) -> None:
    """Order angles, rad, with the pitch clamped to the limits."""
    mount.aim(yaw, clamp(pitch, *_PITCH_LIMITS))


def connect_v2(options: MavlinkOptions, bench: Bench) -> Connected:
    """Return the driver of version 2; the simulated autopilot drives the gimbal."""
    assert bench.autopilot is not None
    bench.autopilot.attach(GimbalManager(bench.mount))
    return MavlinkGimbal(options, bench.driver), None


def connect_mount(options: MavlinkMountOptions, bench: Bench) -> Connected:
    """Return the driver of the mount protocol; the simulated autopilot drives the gimbal."""
    assert bench.autopilot is not None
    bench.autopilot.attach(OldMount(bench.mount))
    return MavlinkMountGimbal(options, bench.driver), None
