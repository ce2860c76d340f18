"""Rotations from a gimbal's angles to local NED, for each reference of those angles."""

import math

from landerd.geometry import Mat3, Vec3, matmul, rot_z, rot_zxy
from landerd.messages import Reference


def rotation_local_base(reference: Reference, R_local_body: Mat3, heading: float) -> Mat3:
    """Return R_local_base; the base is the frame that the gimbal is aimed in.

    That is the body for Reference.BODY, and else `level`: local NED turned by the heading.

    Args:
        reference: of the gimbal's angles.
        R_local_body: of the airframe.
        heading: yaw of the airframe, rad.
    """
    return R_local_body if reference is Reference.BODY else rot_z(heading)


def rotation_local_gimbal(
    reference: Reference, R_local_body: Mat3, heading: float, angles: Vec3
) -> Mat3:
    """Return R_local_gimbal.

    Args:
        reference: of the gimbal's angles.
        R_local_body: of the airframe.
        heading: yaw of the airframe, rad.
        angles: yaw, pitch, roll of the gimbal, rad.
    """
    yaw, pitch, roll = angles
    if reference is not Reference.TILT:
        base = rotation_local_base(reference, R_local_body, heading)
        return matmul(base, rot_zxy(yaw, roll, pitch))
    # The measured pitch is from gravity: it includes the lean of the airframe along the yaw axis.
    R = matmul(R_local_body, rot_z(yaw))
    lean = math.atan2(-R[2][0], R[2][2])
    return matmul(R, rot_zxy(0.0, roll, pitch - lean))
