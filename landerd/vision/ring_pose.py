"""A circle seen by a camera: pose to cone of sight, and cone to its two poses.

A circle of radius R with centre t and unit normal n (camera frame) is seen on the cone
v^T C v = 0 of rays v = (x, y, 1). A plane cuts that cone in a circle of the same radius in two
ways, mirrored about the line of sight: two poses explain one ellipse (Chen et al., "Camera
calibration with two arbitrary coplanar circles", ECCV 2004, section 3).
"""

import math
from typing import cast

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.geometry import Vec3
from landerd.vision.linear import eigen

CirclePose = tuple[F64, F64]  # centre (m) and unit normal away from the camera, camera frame


def tangents(normal: F64) -> tuple[F64, F64]:
    """Return two unit vectors that span the plane of a unit normal."""
    e1, e2, _ = plane_frame(normal)
    return np.array(e1), np.array(e2)


def plane_frame(normal: F64) -> tuple[Vec3, Vec3, Vec3]:
    """Return two unit vectors that span the plane of a unit normal, and that, in plain floats."""
    x, y, z = normal.tolist()
    # Started from the axis that lies farther from the normal.
    if abs(x) < 0.7:
        k = 1.0 / math.hypot(y, z)
        e1 = (0.0, z * k, -y * k)
    else:
        k = 1.0 / math.hypot(x, z)
        e1 = (-z * k, 0.0, x * k)
    return e1, (y * e1[2] - z * e1[1], z * e1[0] - x * e1[2], x * e1[1] - y * e1[0]), (x, y, z)


def cone_of_pose(position: F64, normal: F64, radius: float) -> F64:
    """Return the cone of sight (3, 3) of a circle."""
    a = float(normal @ position) * np.eye(3) - np.outer(position, normal)
    cone: F64 = a.T @ a - radius * radius * np.outer(normal, normal)
    return cone


def poses_of_cone(cone: F64, radius: float) -> tuple[CirclePose, CirclePose] | None:
    """Return both poses of a circle on a cone of sight, or None if it is not an elliptic cone."""
    return _poses(*np.linalg.eigh(cone), radius)


def _poses(values: F64, vectors: F64, radius: float) -> tuple[CirclePose, CirclePose] | None:
    """Return the same by the cone's eigenvalues (3,), rising, and its eigenvectors as columns."""
    if values[1] < 0.0:  # signature (+, -, -): the same cone with the other sign
        values, vectors = -values[::-1], vectors[:, ::-1]
    low, mid, high = (float(v) for v in values)
    if not low < 0.0 < mid:
        return None
    axis = vectors[:, 0] if vectors[2, 0] > 0 else -vectors[:, 0]
    across = vectors[:, 2]
    depth = mid * radius / math.sqrt(-low * high)
    s = math.sqrt(max(0.0, high - mid) / (high - low))
    c = math.sqrt((mid - low) / (high - low))
    poses = []
    for sign in (1.0, -1.0):
        position = depth * (c * high / mid * axis - sign * s * low / mid * across)
        normal = c * axis - sign * s * across
        poses.append((position, normal / np.linalg.norm(normal)))
    return poses[0], poses[1]


def mirrored(position: F64, normal: F64, radius: float) -> CirclePose | None:
    """Return the other pose that shows the same ellipse."""
    # Their signs tell which pose comes first, which matters where none is known.
    values, vectors = eigen(cone_of_pose(position, normal, radius))
    poses = _poses(values[::-1], vectors[:, ::-1], radius)
    if poses is None:
        return None
    return min(poses, key=lambda pose: float(pose[1] @ normal))


def poses_through(rays: F64, radius: float) -> tuple[CirclePose, CirclePose] | None:
    """Return the poses of a circle whose outline has these rays (n, 2), n >= 6; None: none."""
    cone = cone_through(rays)
    return None if cone is None else poses_of_cone(cone, radius)


def cone_through(rays: F64) -> F64 | None:
    """Return the cone (3, 3) fitted to rays (n, 2) on z = 1, n >= 6; None if degenerate."""
    centre = rays.mean(axis=0)
    spread = float(np.abs(rays - centre).max())
    if not spread > 0.0:
        return None
    x, y = ((rays - centre) / spread).T
    design = np.column_stack([x * x, x * y, y * y, x, y])
    # By QR decomposition: numpy's own least squares take nine times as long.
    is_told, conic_of = cv2.solve(design, np.ones((len(x), 1)), flags=cv2.DECOMP_QR)
    if not is_told:
        return None
    a, b, c, d, e = conic_of[:, 0].tolist()
    conic = np.array([[a, b / 2, d / 2], [b / 2, c, e / 2], [d / 2, e / 2, -1.0]])
    k = 1.0 / spread
    to_local = np.array([[k, 0.0, -centre[0] * k], [0.0, k, -centre[1] * k], [0.0, 0.0, 1.0]])
    return cast(F64, to_local.T @ conic @ to_local)
