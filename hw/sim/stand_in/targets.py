"""Position and attitude targets as ArduCopter 4.5 takes them in GUIDED."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message
from hw.sim.stand_in.copter import Copter
from hw.sim.stand_in.ekf import Estimate
from landerd.geometry import Vec3, add, clamp, is_finite, rot_z, rotate

# Targets beyond these are malformed.
_FARTHEST_M = 1e6
_FASTEST_MPS = 1e3
_LEVEL = 1e-3  # an attitude is level if its quaternion's x and y are smaller than this

# type_mask of SET_POSITION_TARGET_LOCAL_NED: any bit of a group makes it ignore the whole group
_IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_ACCELERATION = 0x007, 0x038, 0x1C0
_IGNORE_YAW_RATE = 0x800
_IGNORE_ATTITUDE_OR_THRUST: int = (
    mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
    | mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
)

_NED_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED)
_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)


def take_attitude_target(copter: Copter, m: Message, t: float) -> None:
    """Fly a SET_ATTITUDE_TARGET that came at t (s), or ignore it.

    Only level attitudes are modelled, with the thrust as a climb rate (GUID_OPTIONS 0).
    """
    is_level = is_finite((m.q[1], m.q[2], m.thrust)) and math.hypot(m.q[1], m.q[2]) <= _LEVEL
    if is_level and not m.type_mask & _IGNORE_ATTITUDE_OR_THRUST:
        copter.fly_level(2.0 * clamp(m.thrust, 0.0, 1.0) - 1.0, t)


def take_position_target(copter: Copter, m: Message, estimate: Estimate, t: float) -> None:
    """Fly a SET_POSITION_TARGET_LOCAL_NED that came at t (s); a malformed one is an order to stop.

    A target in a body frame, or relative to the vehicle's position, is converted by the estimate.
    """
    if m.coordinate_frame == mavlink.MAV_FRAME_BODY_FRD:
        return
    if not _is_sound(m):
        copter.stop()
        return
    position, velocity = (m.x, m.y, m.z), (m.vx, m.vy, m.vz)
    yaw_rate = None if m.type_mask & _IGNORE_YAW_RATE else m.yaw_rate
    if m.coordinate_frame in _BODY_FRAMES:
        R_local_level = rot_z(estimate.yaw)
        position, velocity = rotate(R_local_level, position), rotate(R_local_level, velocity)
    if m.type_mask & _IGNORE_POSITION:
        copter.fly_velocity(velocity, yaw_rate, t)
        return
    if m.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        position = add(position, estimate.position)
    copter.fly_to(position, yaw_rate)


def _is_sound(m: Message) -> bool:
    has_position = not m.type_mask & _IGNORE_POSITION
    has_velocity = not m.type_mask & _IGNORE_VELOCITY
    wants_force = m.type_mask & mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET
    return (
        m.coordinate_frame in _NED_FRAMES + _BODY_FRAMES
        and (has_position or has_velocity)
        and not (has_position and not _within(_FARTHEST_M, (m.x, m.y, m.z)))
        and not (has_velocity and not _within(_FASTEST_MPS, (m.vx, m.vy, m.vz)))
        and bool(m.type_mask & _IGNORE_YAW_RATE or math.isfinite(m.yaw_rate))
        and not (wants_force and not m.type_mask & _IGNORE_ACCELERATION)
    )


def _within(limit: float, v: Vec3) -> bool:
    return is_finite(v) and max(abs(v[0]), abs(v[1]), abs(v[2])) <= limit
