"""What a gimbal's angles are measured against, as rotations."""

import math

from landerd.geometry import Mat3, Vec3, matmul, rot_z, rot_zxy, rot_zyx
from landerd.messages import Reference


def base(reference: Reference, attitude: Vec3) -> Mat3:
    """Return R_local_base: from the frame that a gimbal is aimed in.

    Args:
        reference: of the gimbal.
        attitude: roll, pitch, yaw of the airframe, rad.
    """
    roll, pitch, yaw = attitude
    return rot_zyx(yaw, pitch, roll) if reference is Reference.BODY else rot_z(yaw)


def look(reference: Reference, attitude: Vec3, angles: Vec3) -> Mat3:
    """Return R_local_gimbal.

    Args:
        reference: of the gimbal.
        attitude: roll, pitch, yaw of the airframe, rad.
        angles: yaw, pitch, roll of the gimbal, rad.
    """
    yaw, pitch, roll = angles
    if reference is not Reference.TILT:
        return matmul(base(reference, attitude), rot_zxy(yaw, roll, pitch))
    # The airframe after the yaw axis leans forward by this much of the pitch that is measured.
    R = matmul(base(Reference.BODY, attitude), rot_z(yaw))
    lean = math.atan2(-R[2][0], R[2][2])
    return matmul(R, rot_zxy(0.0, roll, pitch - lean))
