"""Rotations from a gimbal's angles to local NED, for each reference of those angles."""

import math

from landerd.geometry import Mat3, Vec3, matmul, rot_z, rot_zxy, rot_zyx
from landerd.messages import Reference


def rotation_local_base(reference: Reference, attitude: Vec3) -> Mat3:
    """Return R_local_base; the base is the frame that the gimbal is aimed in.

    That is the body for Reference.BODY, and else `level`: local NED turned by the heading.

    Args:
        reference: of the gimbal's angles.
        attitude: roll, pitch, yaw of the airframe, rad.
    """
    roll, pitch, yaw = attitude
    return rot_zyx(yaw, pitch, roll) if reference is Reference.BODY else rot_z(yaw)


def rotation_local_gimbal(reference: Reference, attitude: Vec3, angles: Vec3) -> Mat3:
    """Return R_local_gimbal.

    Args:
        reference: of the gimbal's angles.
        attitude: roll, pitch, yaw of the airframe, rad.
        angles: yaw, pitch, roll of the gimbal, rad.
    """
    yaw, pitch, roll = angles
    if reference is not Reference.TILT:
        return matmul(rotation_local_base(reference, attitude), rot_zxy(yaw, roll, pitch))
    # The measured pitch is from gravity: it includes the lean of the airframe along the yaw axis.
    R = matmul(rotation_local_base(Reference.BODY, attitude), rot_z(yaw))
    lean = math.atan2(-R[2][0], R[2][2])
    return matmul(R, rot_zxy(0.0, roll, pitch - lean))
