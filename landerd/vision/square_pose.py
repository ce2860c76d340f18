"""Pose of a square marker from its four corners: both solutions of the planar ambiguity.

`square_fit` starts from these poses. The information that corners hold, and the derivative of rays
by a pose, serve other modules of vision as well.
"""

import math

import cv2
import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.vision.linear import solved
from landerd.vision.pose import Pose, rotation_from
from landerd.vision.ring_pose import CirclePose

_MAX_STEPS = 8  # of Gauss-Newton
_NO_LENS = np.eye(3)
_BEFORE = np.array([3, 0, 1, 2])  # index of the corner before each of the four


def square_points(size: float) -> F64:
    """Return the corners (4, 2) in the marker's plane (north, east), m: top left, clockwise."""
    h = 0.5 * size
    return np.array([[h, -h], [h, h], [-h, h], [-h, -h]])


def shortest_side(corners: F64) -> float:
    """Return the length of a quadrilateral's shortest side, in the unit of its corners (4, 2)."""
    return float(np.sqrt(((corners - corners[_BEFORE]) ** 2).sum(axis=1)).min())


def poses_from_corners(
    corners: F64, size: float, camera: CameraModel, sigma_px: float
) -> list[Pose]:
    """Return the poses of a square, camera frame, that explain its corners, best first.

    These are both solutions of the planar ambiguity, refined by least squares on the corners;
    solutions behind the lens or without convergence are left out.

    Args:
        corners: (4, 2) pixels, top left first, clockwise as printed.
        size: edge of the square, m.
        camera: the lens.
        sigma_px: 1 sigma of each corner coordinate, px.
    """
    rays = camera.rays(corners)
    points = square_points(size)
    sigma = sigma_px / camera.focal
    poses = []
    for start, _ in planar_poses(rays, size):
        pose = _refined(rays, points, start, sigma)
        if pose is not None:
            poses.append(pose)
    return sorted(poses, key=lambda p: p.cost)


def planar_poses(rays: F64, size: float) -> list[tuple[Pose, float]]:
    """Return both solutions of the planar ambiguity with their errors, better first.

    Collins and Bartoli, "Infinitesimal Plane-Based Pose Estimation", 2014. The error is the
    root-mean-square reprojection error on z = 1. The poses have no information; solutions behind
    the lens are left out.

    Args:
        rays: of the corners on z = 1, (4, 2), top left first, clockwise as printed.
        size: edge of the square, m.
    """
    points = np.zeros((4, 3))
    points[:, :2] = square_points(size)
    count, rvecs, tvecs, errors = cv2.solvePnPGeneric(
        points, rays.reshape(-1, 1, 2), _NO_LENS, None, flags=cv2.SOLVEPNP_IPPE
    )
    poses = []
    for i in range(count):
        R = np.asarray(cv2.Rodrigues(rvecs[i])[0], dtype=np.float64)
        t = np.asarray(tvecs[i], dtype=np.float64).reshape(3)
        if t[2] > 0 and R[:, 2] @ t > 0:
            poses.append((Pose(R, t, np.zeros((6, 6)), 0.0), float(errors[i, 0])))
    return poses


def pose_beside(rays: F64, size: float, at: CirclePose, centre: F64) -> Pose | None:
    """Return the pose of a square beside a ring, turned about the ring's centre to fit its corners.

    None: a corner's ray does not meet the ring's plane. The pose has no information.

    Args:
        rays: of the corners on z = 1, (4, 2), top left first, clockwise as printed.
        size: edge of the square, m.
        at: the ring's pose.
        centre: the ring's, on the square's axes (north, east), m, (2,).
    """
    position, normal = at
    along = rays @ normal[:2] + normal[2]
    if along.min() <= 0.0:
        return None
    corners = np.ones((4, 3))
    corners[:, :2] = rays
    corners *= (float(position @ normal) / along)[:, None]
    axes = rotation_from(normal)[:, :2]
    a, b = ((corners - position) @ axes).T
    north, east = (square_points(size) - centre).T
    angle = math.atan2(float(north @ b - east @ a), float(north @ a + east @ b))
    R = rotation_from(normal, axes @ (math.cos(angle), math.sin(angle)))
    return Pose(R, position - R[:, :2] @ centre, np.zeros((6, 6)), 0.0)


def corner_information(pose: Pose, size: float, sigma: float) -> F64:
    """Return the information (6, 6) on a square's pose that its four corners hold.

    Args:
        pose: of the square, camera frame.
        size: edge of the square, m.
        sigma: of each coordinate of a corner's ray on z = 1.
    """
    J = ray_derivative(square_points(size), pose)
    information: F64 = J.T @ J / sigma**2
    return information


def ray_derivative(points: F64, pose: Pose) -> F64:
    """Return the derivative (2n, 6), by the pose's (dt, w), of the points' rays on z = 1.

    The points (n, 2) are given on the marker's axes (north, east; m).
    """
    return _predicted(points, pose)[1]


def _refined(rays: F64, points: F64, pose: Pose, sigma: float) -> Pose | None:
    """Return the pose fitted to rays (n, 2) of points (n, 2), m; None: the fit fails.

    `sigma` is that of each coordinate of a ray on z = 1.
    """
    for _ in range(_MAX_STEPS):
        residual, J = _residual(rays, points, pose)
        information = J.T @ J
        try:
            step = solved(information, J.T @ residual)
        except np.linalg.LinAlgError:
            return None
        pose = pose.moved(step)
        if np.abs(step).max() < 1e-9:
            break
    if not np.isfinite(pose.t).all() or pose.t[2] <= 0 or pose.normal @ pose.t <= 0:
        return None
    residual, J = _residual(rays, points, pose)
    return Pose(pose.R, pose.t, J.T @ J / sigma**2, float(residual @ residual) / sigma**2)


def _residual(rays: F64, points: F64, pose: Pose) -> tuple[F64, F64]:
    """Return the residuals of rays (2n,) and the derivative of their prediction (2n, 6)."""
    predicted, J = _predicted(points, pose)
    return (rays - predicted.T).reshape(-1), J


def _predicted(points: F64, pose: Pose) -> tuple[F64, F64]:
    """Return the rays (2, n) of points (n, 2) on z = 1, and their derivative (2n, 6)."""
    arms = points @ pose.R[:, :2].T
    p = arms + pose.t
    inverse_z = 1.0 / p[:, 2]
    x, y = rays = p[:, :2].T * inverse_z
    n = len(points)
    J = np.zeros((n, 2, 6))
    J[:, 0, 0] = J[:, 1, 1] = inverse_z
    J[:, 0, 2], J[:, 1, 2] = -x * inverse_z, -y * inverse_z
    # A turn w moves a point by w x arm, so that the derivative along a vector g is arm x g. This is
    # written out, as numpy's own cross product takes ten times as long.
    a, b, c = arms.T * inverse_z
    J[:, 0, 3], J[:, 0, 4], J[:, 0, 5] = -b * x, c + a * x, -b
    J[:, 1, 3], J[:, 1, 4], J[:, 1, 5] = -b * y - c, a * y, a
    return rays, J.reshape(-1, 6)
