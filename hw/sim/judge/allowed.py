"""What landerd may send; all else breaks a rule."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.sim.judge.bounds import RuleBounds

_VELOCITY_AND_YAW_RATE = 1479  # type_mask: position, acceleration and yaw are ignored
_ATTITUDE_AND_THRUST = 7  # type_mask of SET_ATTITUDE_TARGET: the body's rates are ignored
_LEVEL = 1e-3
_FRAMES = (
    mavlink.MAV_FRAME_LOCAL_NED,
    mavlink.MAV_FRAME_BODY_NED,
    mavlink.MAV_FRAME_BODY_OFFSET_NED,
)

# To everybody, and orders to fly, which have rules of their own.
MESSAGES = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_TIMESYNC,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    mavlink.MAVLINK_MSG_ID_LANDING_TARGET,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_PITCHYAW,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
}
COMMANDS = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,  # to disarm only: hw.sim.judge.rules
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
    mavlink.MAV_CMD_REQUEST_MESSAGE,
    mavlink.MAV_CMD_DO_MOUNT_CONTROL,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
}


def message_name(kind: int) -> str:
    """Return the name of a message for the pilot's eyes."""
    known = mavlink.mavlink_map.get(kind)
    return str(known.msgname) if known is not None else "bytes that are no known message"


def command_is_allowed(message: mavlink.MAVLink_message, bounds: RuleBounds) -> bool:
    """Tell whether landerd may send this COMMAND_LONG."""
    if message.command == mavlink.MAV_CMD_DO_SET_SERVO:
        return message.param1 in bounds.servo_outputs
    return message.command in COMMANDS


def is_velocity_target(message: mavlink.MAVLink_message) -> bool:
    """Tell whether a SET_POSITION_TARGET_LOCAL_NED has velocity and yaw rate, and no more."""
    mask_is_right = message.type_mask == _VELOCITY_AND_YAW_RATE
    return mask_is_right and message.coordinate_frame in _FRAMES


def is_level_target(message: mavlink.MAVLink_message) -> bool:
    """Tell whether a SET_ATTITUDE_TARGET is level and without thrust."""
    level = math.hypot(message.q[1], message.q[2]) < _LEVEL
    return bool(level and message.thrust == 0.0 and message.type_mask == _ATTITUDE_AND_THRUST)
