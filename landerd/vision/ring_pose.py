"""The two poses of a circle that explain one ellipse in the image.

The outline of a circle of radius R with centre t and unit normal n (camera frame) is seen along the
rays v = (x, y, 1) of a cone, v^T C v = 0. A plane cuts that cone in a circle of radius R in two
ways, mirrored about the line of sight (Chen et al., "Camera calibration with two arbitrary coplanar
circles", ECCV 2004, section 3).

All searches for and fits of rings start from such poses.
"""

import math
from typing import cast

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.geometry import Vec3
from landerd.vision.linear import eigen, length, outer
from landerd.vision.pose import vec3

# Centre (3,), m, and unit normal (3,) that points away from the camera, camera frame.
CirclePose = tuple[F64, F64]


def tangents(normal: F64) -> tuple[F64, F64]:
    """Return two unit vectors (3,) that span the plane of a unit normal (3,)."""
    e1, e2, _ = plane_frame(vec3(normal))
    return np.array(e1), np.array(e2)


def plane_frame(normal: Vec3) -> tuple[Vec3, Vec3, Vec3]:
    """Return two unit vectors that span the plane of a unit normal, and the normal.

    Each is perpendicular to the others.
    """
    x, y, z = normal
    # The first tangent is perpendicular to x or y, whichever is farther from the normal.
    if abs(x) < 0.7:
        k = 1.0 / math.hypot(y, z)
        e1 = (0.0, z * k, -y * k)
    else:
        k = 1.0 / math.hypot(x, z)
        e1 = (-z * k, 0.0, x * k)
    return e1, (y * e1[2] - z * e1[1], z * e1[0] - x * e1[2], x * e1[1] - y * e1[0]), (x, y, z)


def cone_of_pose(position: F64, normal: F64, radius: float) -> F64:
    """Return the cone of rays (3, 3) on which the outline of a circle is seen.

    Args:
        position: of the circle's centre, camera frame, m, (3,).
        normal: unit vector (3,).
        radius: of the circle, m.
    """
    a = float(normal @ position) * np.eye(3) - outer(position, normal)
    cone: F64 = a.T @ a - radius * radius * outer(normal, normal)
    return cone


def poses_of_cone(cone: F64, radius: float) -> tuple[CirclePose, CirclePose] | None:
    """Return both poses of a circle seen on a cone (3, 3) of rays; None: the cone is not elliptic.

    `radius` is that of the circle, m.
    """
    return _poses(*np.linalg.eigh(cone), radius)


def _poses(values: F64, vectors: F64, radius: float) -> tuple[CirclePose, CirclePose] | None:
    """Return `poses_of_cone` from the cone's eigenvalues and eigenvectors.

    Args:
        values: eigenvalues, ascending, (3,).
        vectors: unit eigenvectors as columns, (3, 3).
        radius: of the circle, m.
    """
    if values[1] < 0.0:  # signature (+, -, -): the same cone with the other sign
        values, vectors = -values[::-1], vectors[:, ::-1]
    low, mid, high = values.tolist()
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
        poses.append((position, normal / length(normal)))
    return poses[0], poses[1]


def mirrored(position: F64, normal: F64, radius: float) -> CirclePose | None:
    """Return the other pose of a circle that has the same ellipse; None: there is none.

    Args:
        position: of the circle's centre, camera frame, m, (3,).
        normal: unit vector (3,) away from the camera.
        radius: of the circle, m.
    """
    # OpenCV's arbitrary signs of eigenvectors only exchange the two poses, which matters in
    # `poses_of_cone`, but not here.
    values, vectors = eigen(cone_of_pose(position, normal, radius))
    poses = _poses(values[::-1], vectors[:, ::-1], radius)
    if poses is None:
        return None
    return min(poses, key=lambda pose: float(pose[1] @ normal))


def poses_through(rays: F64, radius: float) -> tuple[CirclePose, CirclePose] | None:
    """Return both poses of a circle whose outline has some rays; None: no circle has them.

    Args:
        rays: on z = 1, (n, 2), n >= 6.
        radius: of the circle, m.
    """
    cone = cone_through(rays)
    return None if cone is None else poses_of_cone(cone, radius)


def cone_through(rays: F64) -> F64 | None:
    """Return the cone (3, 3) fitted to rays (n, 2) on z = 1, n >= 6; None: it is degenerate."""
    centre = rays.mean(axis=0)
    spread = float(np.abs(rays - centre).max())
    if not spread > 0.0:
        return None
    x, y = ((rays - centre) / spread).T
    design = np.array([x * x, x * y, y * y, x, y]).T
    # By QR decomposition: numpy's own least squares take nine times as long.
    is_told, conic_of = cv2.solve(design, np.ones((len(x), 1)), flags=cv2.DECOMP_QR)
    if not is_told:
        return None
    a, b, c, d, e = conic_of[:, 0].tolist()
    conic = np.array([[a, b / 2, d / 2], [b / 2, c, e / 2], [d / 2, e / 2, -1.0]])
    k = 1.0 / spread
    to_local = np.array([[k, 0.0, -centre[0] * k], [0.0, k, -centre[1] * k], [0.0, 0.0, 1.0]])
    return cast(F64, to_local.T @ conic @ to_local)
