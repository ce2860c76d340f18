"""Pose of a planar marker or of the pad, with its information matrix; and small geometry for it.

Frame of a marker or pad: origin at its centre or landing point, x to its north, y to its east, z
into the plane. A small error of a pose is the 6-vector (dt, w) in the camera frame: the origin is
moved by dt, m, and the axes are turned by the rotation vector w, rad.

All of vision works with `Pose`; `solution` turns one into the message that vision reports.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Mat3, Vec3, angle_between, cross, dot
from landerd.messages import PoseSolution, SystematicError
from landerd.vision.linear import inverse, length, trace

# Normals in consecutive frames belong to the same solution of the planar ambiguity if the cosine of
# the angle between them is larger: a gimbal turns the camera by less between frames.
SAME_SOLUTION_COS = math.cos(math.radians(5.0))
# The same for the normals of two fits to one picture.
EQUAL_NORMALS_COS = math.cos(math.radians(1.0))
# Sigma of the angle between a pad's normal and gravity, rad: decks heave and roll (5 degrees), and
# gravity is as uncertain as attitude, gimbal and mounting (2 degrees).
LEVEL_SIGMA = math.radians(math.hypot(5.0, 2.0))
_MAX_GRAVITY_CHI2 = 30.0  # a pad may lean more after all: a clear picture overrules gravity
MIN_DEPTH_M = 0.05  # points nearer to the lens than this are not projected into the image
_NONE_SHARED: F64 = np.zeros((6, 0))


@dataclass(frozen=True, slots=True)
class Pose:
    """One pose of a marker or pad that explains the image, camera frame."""

    R: F64  # rotation from the marker or pad frame, (3, 3)
    t: F64  # origin of that frame, m, (3,)
    information: F64  # inverse covariance of (dt, w), (6, 6); singular: part of it is unknown
    cost: float  # chi-square of the fit
    # Changes of (dt, w), (6, k), by one sigma of each of k independent errors that all markers of
    # the picture share: the motion during a rolling shutter's readout. The information includes
    # them, too.
    shared: F64 = field(default_factory=lambda: _NONE_SHARED)

    @property
    def normal(self) -> F64:
        """Unit vector into the plane, (3,)."""
        return self.R[:, 2]

    def points(self, flat: F64) -> F64:
        """Return points (n, 2) of the plane (north, east; m) in the camera frame, m, (n, 3)."""
        points: F64 = self.t + flat @ self.R[:, :2].T
        return points

    def rays(self, flat: F64) -> F64:
        """Return the rays (n, 2) on z = 1 of points (n, 2) of the plane (north, east; m)."""
        p = self.points(flat)
        rays: F64 = p[:, :2] / p[:, 2:]
        return rays

    def moved(self, step: NDArray[np.floating]) -> "Pose":
        """Return the pose moved by a step (dt, w), camera frame, with its information and cost."""
        return Pose(
            cv2.Rodrigues(step[3:])[0] @ self.R, self.t + step[:3], self.information, self.cost
        )


def solution(pose: Pose) -> PoseSolution | None:
    """Return the message of a pose whose north is known; None: its information is singular."""
    try:
        covariance = inverse(pose.information)
    except np.linalg.LinAlgError:
        return None
    return solution_of(pose, covariance, has_north=True)


def solution_of(
    pose: Pose, covariance: F64, *, has_north: bool, systematic: SystematicError | None = None
) -> PoseSolution | None:
    """Return the message of a pose; None: its covariance is not finite or not positive.

    Args:
        pose: its information is not read.
        covariance: of (dt, w), (6, 6), m and rad.
        has_north: whether the heading is known; else the message has no north and no sigma of yaw.
        systematic: the part of the covariance that is the same in every frame.
    """
    turn = covariance[3:, 3:]
    variance_yaw = float(pose.normal @ turn @ pose.normal)
    variance_tilt = 0.5 * (trace(turn) - variance_yaw)
    if not np.isfinite(covariance).all() or variance_yaw <= 0 or variance_tilt <= 0:
        return None
    return PoseSolution(
        position=vec3(pose.t),
        normal=vec3(pose.normal),
        north=vec3(pose.R[:, 0]) if has_north else None,
        covariance=mat3(covariance[:3, :3]),
        sigma_yaw=variance_yaw**0.5 if has_north else None,
        sigma_tilt=variance_tilt**0.5,
        cost=pose.cost,
        systematic=systematic,
    )


def rotation_2d(angle: float) -> F64:
    """Return the matrix (2, 2) that turns (north, east) by an angle, rad, from north to east.

    Its columns are the turned axes.
    """
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def turned_about_normal(R: F64, angle: float) -> F64:
    """Return a marker's or pad's rotation (3, 3) after a turn about its normal by an angle, rad.

    Positive angles turn north to east: clockwise as seen from above.
    """
    about = np.eye(3)
    about[:2, :2] = rotation_2d(angle)
    turned: F64 = R @ about
    return turned


def wrapped(angles: NDArray[np.floating]) -> F64:
    """Return angles (n,), rad, wrapped to -pi to pi."""
    turned: F64 = np.mod(angles + math.pi, 2.0 * math.pi) - math.pi
    return turned


def rotation_from(normal: F64, north: F64 | None = None) -> F64:
    """Return the rotation (3, 3) of a plane: its columns are north, east and normal.

    Args:
        normal: unit vector (3,) into the plane.
        north: vector (3,) whose part in the plane is the north; it must not be along the normal.
            None: any north will do.
    """
    if north is None:
        north = np.eye(3)[int(np.argmin(np.abs(normal)))]
    # In plain floats: numpy takes several times as long on single vectors.
    n, along = vec3(normal), vec3(north)
    off = dot(along, n)
    x, y, z = along[0] - off * n[0], along[1] - off * n[1], along[2] - off * n[2]
    size = math.sqrt(x * x + y * y + z * z)
    east = cross(n, first := (x / size, y / size, z / size))
    return np.array([first, east, n]).T


def normal_of(axes: F64) -> F64:
    """Return the unit normal (3,) of a plane with axes (3, 2), north and east.

    numpy's own vector product takes twenty times as long.
    """
    return np.array(cross(*map(vec3, axes.T)))


def gravity_cost(normal: F64, down: Vec3 | None) -> float:
    """Return the chi-square, bounded, of the angle between a pad's normal and gravity.

    Args:
        normal: unit vector (3,) into the pad.
        down: unit vector of gravity in the same frame; None: unknown, the chi-square is 0.
    """
    if down is None:
        return 0.0
    angle = angle_between(vec3(normal), down)
    return min((angle / LEVEL_SIGMA) ** 2, _MAX_GRAVITY_CHI2)


def px_per_m(camera: CameraModel, t: F64, normal: F64) -> float:
    """Return the pixels per metre of a plane in the direction in which it is foreshortened most.

    Args:
        camera: the lens.
        t: point (3,) of the plane, camera frame, m.
        normal: unit vector (3,) into the plane.
    """
    slant = float(normal @ t) / length(t)
    return camera.focal * slant / max(float(t[2]), MIN_DEPTH_M)


def box(outline: Sequence[tuple[float, float]]) -> tuple[float, float, float, float]:
    """Return the middle, x and y, the width and the height of the upright box round an outline."""
    x, y = [x for x, _ in outline], [y for _, y in outline]
    left, right, top, bottom = min(x), max(x), min(y), max(y)
    return 0.5 * (left + right), 0.5 * (top + bottom), right - left, bottom - top


def circle(radius: float, count: int = 16) -> F64:
    """Return evenly spaced points (count, 2) on a circle about the origin, in its radius' unit."""
    return radius * _unit_circle(count)


@lru_cache
def _unit_circle(count: int) -> F64:
    angles = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    return np.column_stack([np.cos(angles), np.sin(angles)])


def skew(v: F64) -> F64:
    """Return the matrix (3, 3) of the vector product: skew(a) @ b = a x b."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def vec3(v: F64) -> Vec3:
    """Return a vector (3,) as plain floats."""
    x, y, z = v.tolist()
    return x, y, z


def mat3(m: F64) -> Mat3:
    """Return a matrix (3, 3) as plain floats."""
    return (vec3(m[0]), vec3(m[1]), vec3(m[2]))
