"""Pose of a square marker from its corners, both solutions of the planar ambiguity."""

import cv2
import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.vision.linear import solved
from landerd.vision.pose import Pose

_MAX_STEPS = 8
_BEFORE = np.array([3, 0, 1, 2])  # of four corners, of each the one before


def square_points(size: float) -> F64:
    """Return the corners (4, 2) in the marker's plane (north, east), m: top left, clockwise."""
    h = 0.5 * size
    return np.array([[h, -h], [h, h], [-h, h], [-h, -h]])


def shortest_side(corners: F64) -> float:
    """Return the shortest side of a quadrilateral by its corners (4, 2), in their unit."""
    return float(np.sqrt(((corners - corners[_BEFORE]) ** 2).sum(axis=1)).min())


def poses_from_corners(
    corners: F64, size: float, camera: CameraModel, sigma_px: float
) -> list[Pose]:
    """Return the one or two poses of a square that explain its corners, best first.

    Both solutions of the planar ambiguity, refined by least squares on the corners.

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
    """Return both solutions of the planar ambiguity, better first, without information.

    Collins and Bartoli, "Infinitesimal Plane-Based Pose Estimation", 2014. Beside each stands its
    root-mean-square distance from the corners' rays (4, 2) on z = 1.
    """
    points = square_points(size)
    count, rvecs, tvecs, errors = cv2.solvePnPGeneric(
        np.column_stack([points, np.zeros(4)]),
        rays.reshape(-1, 1, 2),
        np.eye(3),
        None,
        flags=cv2.SOLVEPNP_IPPE,
    )
    poses = []
    for i in range(count):
        R = np.asarray(cv2.Rodrigues(rvecs[i])[0], dtype=np.float64)
        t = np.asarray(tvecs[i], dtype=np.float64).reshape(3)
        if t[2] > 0 and R[:, 2] @ t > 0:
            poses.append((Pose(R, t, np.zeros((6, 6)), 0.0), float(errors[i, 0])))
    return poses


def corner_information(pose: Pose, size: float, sigma: float) -> F64:
    """Return the information (6, 6) that four corners of a square give, sigma of rays each."""
    J = ray_derivative(square_points(size), pose)
    information: F64 = J.T @ J / sigma**2
    return information


def ray_derivative(points: F64, pose: Pose) -> F64:
    """Return the derivative (2n, 6) of points' (n, 2) rays on z = 1 by the pose's (dt, w)."""
    return _residual(np.zeros_like(points), points, pose)[1]


def _refined(rays: F64, points: F64, pose: Pose, sigma: float) -> Pose | None:
    """Refine a pose on corner rays (n, 2) of points (n, 2); None if it does not converge."""
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
    """Return rays less their prediction (2n,) and the derivative of the prediction (2n, 6)."""
    arms = points @ pose.R[:, :2].T
    p = arms + pose.t
    inverse_z = 1.0 / p[:, 2]
    x, y = p[:, 0] * inverse_z, p[:, 1] * inverse_z
    n = len(points)
    J = np.zeros((n, 2, 6))
    J[:, 0, 0] = J[:, 1, 1] = inverse_z
    J[:, 0, 2], J[:, 1, 2] = -x * inverse_z, -y * inverse_z
    # A turn w moves a point by w x arm: its derivative along g is arm x g. Written out: numpy's
    # own cross product takes ten times as long.
    a, b, c = arms.T * inverse_z
    J[:, 0, 3], J[:, 0, 4], J[:, 0, 5] = -b * x, c + a * x, -b
    J[:, 1, 3], J[:, 1, 4], J[:, 1, 5] = -b * y - c, a * y, a
    return (rays - np.column_stack([x, y])).reshape(-1), J.reshape(-1, 6)
