"""Turns the core's orders into messages to ArduCopter; impossible ones are refused."""

import math
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message
from hw.autopilots.telemetry import FARTHEST_M, FASTEST_MPS, FASTEST_TURN_RADPS, within
from landerd.geometry import norm
from landerd.messages import LandingTarget, PressDown, Setpoint

SetpointFrame = Literal["local_ned", "body_ned"]

_VELOCITY_AND_YAW_RATE = 1479  # type_mask: ignore position, acceleration, yaw
_ATTITUDE_AND_THRUST = 7  # type_mask: ignore the body's rates


class Refused(Exception):
    """An order that is not to be sent; the text says what is wrong with it."""


def velocity_target(
    setpoint: Setpoint, system: int, now: float, frame: SetpointFrame, heading: float | None
) -> Message:
    """Return SET_POSITION_TARGET_LOCAL_NED with a velocity and a yaw rate.

    Args:
        setpoint: the order.
        system: MAVLink system id of the vehicle.
        now: loop time, s.
        frame: frame in which the velocity is sent.
        heading: heading of the vehicle, rad; None: not known.

    Raises:
        Refused: a value is not finite or beyond what any vehicle flies, or the velocity is to be
            sent in the body's frame and the heading is not known.
    """
    north, east, down = setpoint.velocity
    if not (
        within(FASTEST_MPS, north, east, down) and within(FASTEST_TURN_RADPS, setpoint.yaw_rate)
    ):
        raise Refused("set-point refused: not finite or beyond any vehicle")
    if frame == "local_ned":
        mav_frame, x, y = mavlink.MAV_FRAME_LOCAL_NED, north, east
    elif heading is None:
        raise Refused("set-point refused: heading not known")
    else:
        c, s = math.cos(heading), math.sin(heading)
        mav_frame, x, y = mavlink.MAV_FRAME_BODY_NED, c * north + s * east, c * east - s * north
    return mavlink.MAVLink_set_position_target_local_ned_message(
        _milliseconds(now),
        system,
        mavlink.MAV_COMP_ID_AUTOPILOT1,
        mav_frame,
        _VELOCITY_AND_YAW_RATE,
        *(0.0, 0.0, 0.0),
        *(x, y, down),
        *(0.0, 0.0, 0.0),
        0.0,
        setpoint.yaw_rate,
    )


def level_target(order: PressDown, system: int, now: float) -> Message:
    """Return SET_ATTITUDE_TARGET: level, thrust 0, sent at loop time now (s).

    ArduCopter takes thrust 0 for the fastest descent, or with GUID_OPTIONS bit 3 for no thrust;
    either way the vehicle presses on the pad.

    Raises:
        Refused: the heading is not finite.
    """
    if not math.isfinite(order.heading):
        raise Refused("level order refused: heading not finite")
    half = 0.5 * order.heading
    return mavlink.MAVLink_set_attitude_target_message(
        _milliseconds(now),
        system,
        mavlink.MAV_COMP_ID_AUTOPILOT1,
        _ATTITUDE_AND_THRUST,
        (math.cos(half), 0.0, 0.0, math.sin(half)),
        *(0.0, 0.0, 0.0),
        0.0,
    )


def landing_target(target: LandingTarget) -> Message:
    """Return LANDING_TARGET: position in body FRD, stamped with the exposure on landerd's clock.

    ArduPilot itself finds the difference of the clocks from the messages that arrive soonest. What
    its time of a message is late by is thus the shortest time from exposure to arrival: PLND_LAG
    is to be set to that.

    Raises:
        Refused: the position is not finite, or farther than any vehicle flies.
    """
    x, y, z = target.position
    distance = norm(target.position)
    if not within(FARTHEST_M, x, y, z):
        raise Refused("landing target refused: not finite")
    return mavlink.MAVLink_landing_target_message(
        int(target.t * 1e6),
        0,
        mavlink.MAV_FRAME_BODY_FRD,
        *(math.atan2(y, z), math.atan2(-x, z)),  # for receivers that read the angles only
        distance,
        *(0.0, 0.0),
        *(x, y, z),
        (1.0, 0.0, 0.0, 0.0),
        mavlink.LANDING_TARGET_TYPE_VISION_FIDUCIAL,
        1,
    )


def _milliseconds(t: float) -> int:
    return int(t * 1e3) & 0xFFFFFFFF
