"""Pose of the landing point from all markers seen, by one joint least squares.

Each marker gives a pose and its information matrix, twice where the image is ambiguous. A pose of
the pad implies a pose of each marker; the joint solution minimises the sum of their Mahalanobis
distances to what was measured.
"""

import math
from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64
from landerd.geometry import Vec3, cross, rotation_vector
from landerd.messages import PoseSolution
from landerd.vision.pose import Pose, gravity_cost, rotation_from, skew, solution, vec3

_MAX_STEPS = 5
_CONVERGED = 1e-4  # reduction of chi-square by a step: a hundredth of a sigma
_MIN_YAW_INFORMATION = 1e-6  # 1/rad^2, of a heading that nobody knows: keeps matrices regular
_PRIOR_NORTH_SIGMA = math.radians(5.0)
_PLACE_SIGMA_M = 1e-3  # of a marker on its pad, as printed and laid out
_FLATNESS_SIGMA = math.radians(0.1)  # of its tilt and heading against the pad's
_PLACE_VARIANCES = np.array([_PLACE_SIGMA_M**2] * 3 + [_FLATNESS_SIGMA**2] * 3)
_IDENTITY = np.eye(6)
# A solution is dropped whose chi-square is above the best one's by more: of the pad; and of a ring
# by itself, which the other markers cannot make up for.
_MAX_CHI2_ABOVE_BEST, _MAX_RING_CHI2_ABOVE_BEST = 50.0, 200.0


@dataclass(frozen=True)
class Measurement:
    """A marker's place on the pad and the poses its image allows, best first."""

    place: F64  # centre in the pad frame, (3,)
    heading: float | None  # of its north in the pad frame, rad; None: a plain ring
    poses: tuple[Pose, ...]


def ring_measurement(
    place: tuple[float, float], solutions: tuple[PoseSolution, ...]
) -> Measurement:
    """Return what a ring's sighting says: position and normal, no heading."""
    poses = []
    best = min(s.cost for s in solutions)
    for s in solutions:
        if s.cost > best + _MAX_RING_CHI2_ABOVE_BEST:
            continue
        n = np.array(s.normal)
        information = np.zeros((6, 6))
        information[:3, :3] = np.linalg.inv(np.array(s.covariance))
        information[3:, 3:] = (np.eye(3) - np.outer(n, n)) / s.sigma_tilt**2
        R = rotation_from(n, np.array([0.0, -1.0, 0.0]) if abs(n[1]) < 0.9 else np.eye(3)[0])
        poses.append(Pose(R, np.array(s.position), information, s.cost - best))
    return Measurement(np.array([*place, 0.0]), None, tuple(poses))


def pad_poses(
    measured: list[Measurement], north: Vec3 | None, down: Vec3 | None
) -> list[PoseSolution]:
    """Return the poses of the landing point that explain all markers, best first, at most two.

    Args:
        measured: the markers seen.
        north: the pad's north as the estimate has it, camera frame; used only where the markers
            leave the heading open.
        down: unit vector of gravity, camera frame; puts the more level solution first.
    """
    if not measured:
        return []
    prior_north = None if north is None else np.array(north)
    measured = [
        Measurement(m.place, m.heading, tuple(_on_pad(p, m.heading) for p in m.poses))
        for m in measured
    ]
    # Start from the solutions of the marker that knows its tilt best: the others then choose.
    measured = sorted(measured, key=lambda m: -_tilt_information(m.poses[0]))
    joint: list[Pose] = []
    for first in measured[0].poses:
        pose = _joint(measured, first, prior_north)
        if pose is None or any(_same(pose, other) for other in joint):
            continue
        joint.append(with_gravity(pose, down))
    joint.sort(key=lambda p: p.cost)
    has_north = _has_north(measured)
    found = []
    for pose in joint[:2]:
        s = solution(pose, has_north)
        if s is not None and pose.cost < joint[0].cost + _MAX_CHI2_ABOVE_BEST:
            found.append(s)
    return found


def with_gravity(pose: Pose, down: Vec3 | None) -> Pose:
    """Return the pose with the chi-square of its normal's angle to gravity added to its cost."""
    return Pose(pose.R, pose.t, pose.information, pose.cost + gravity_cost(pose.normal, down))


def _on_pad(pose: Pose, heading: float | None) -> Pose:
    """Return a marker's pose turned to the pad's axes, its own place on the pad being uncertain."""
    # (information^-1 + placing)^-1, also where the information is singular.
    information = np.asarray(
        np.linalg.solve(_IDENTITY + pose.information * _PLACE_VARIANCES, pose.information),
        dtype=np.float64,
    )
    R = pose.R
    if heading is not None:
        c, s = math.cos(heading), math.sin(heading)
        R = R @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return Pose(R, pose.t, information, pose.cost)


def _tilt_information(pose: Pose) -> float:
    n = pose.normal
    turn = pose.information[3:, 3:]
    return float(np.trace(turn) - n @ turn @ n)


def _has_north(measured: list[Measurement]) -> bool:
    """Tell whether the markers seen leave no heading open: a square, or two places."""
    if any(m.heading is not None for m in measured):
        return True
    return any(np.abs(m.place - measured[0].place).max() > 1e-6 for m in measured)


def _same(a: Pose, b: Pose) -> bool:
    step = a.R.T @ b.R
    near = np.linalg.norm(a.t - b.t) < 1e-4 * np.linalg.norm(a.t)
    return bool(near and np.trace(step) > 3.0 - 1e-5)


def _joint(measured: list[Measurement], first: Pose, prior_north: F64 | None) -> Pose | None:
    """Minimise the joint cost from one solution of the first marker; None if it fails."""
    R = _start_rotation(measured, first, prior_north)
    pose = Pose(R, first.t - R @ measured[0].place, np.zeros((6, 6)), 0.0)
    yaw_information = _MIN_YAW_INFORMATION
    if prior_north is not None and not _has_north(measured):
        yaw_information = 1.0 / _PRIOR_NORTH_SIGMA**2
    for _ in range(_MAX_STEPS):
        n = pose.normal
        information = np.zeros((6, 6))
        information[3:, 3:] = yaw_information * np.outer(n, n)
        gradient = np.zeros(6)
        cost = 0.0
        for m in measured:
            J = _derivative(m, pose)
            residual, chosen = _nearest(m, pose)
            weighted = J.T @ chosen.information
            information += weighted @ J
            gradient += weighted @ residual
            cost += chosen.cost + float(residual @ chosen.information @ residual)
        try:
            step = np.linalg.solve(information, gradient)
        except np.linalg.LinAlgError:
            return None
        pose = Pose(pose.R, pose.t, information, cost).moved(step)
        if float(gradient @ step) < _CONVERGED:
            break
    return pose if np.isfinite(pose.t).all() else None


def _start_rotation(measured: list[Measurement], first: Pose, prior_north: F64 | None) -> F64:
    """Return a rotation of the pad about the first marker's normal to start from."""
    for m in measured:
        if m.heading is not None:
            return rotation_from(first.normal, m.poses[0].R[:, 0])
    for m in measured[1:]:
        arm = m.place - measured[0].place
        if np.abs(arm).max() > 1e-6:
            # The pad's north is the direction between the two markers turned back by its bearing.
            along = rotation_from(first.normal, m.poses[0].t - first.t)
            bearing = math.atan2(arm[1], arm[0])
            R: F64 = along @ np.array(
                [
                    [math.cos(bearing), math.sin(bearing), 0.0],
                    [-math.sin(bearing), math.cos(bearing), 0.0],
                    [0.0, 0.0, 1.0],
                ]
            )
            return R
    return first.R if prior_north is None else rotation_from(first.normal, prior_north)


def _derivative(m: Measurement, pose: Pose) -> F64:
    """Return the derivative (6, 6) of the marker's error by the pad's."""
    J = np.eye(6)
    J[:3, 3:] = -skew(pose.R @ m.place)
    return J


def _nearest(m: Measurement, pose: Pose) -> tuple[F64, Pose]:
    """Return the marker's solution nearest to a pad pose, and its residual (6,)."""
    best: tuple[float, F64, Pose] | None = None
    for candidate in m.poses:
        residual = np.empty(6)
        residual[:3] = candidate.t - pose.R @ m.place - pose.t
        if m.heading is None:
            residual[3:] = cross(vec3(pose.normal), vec3(candidate.normal))
        else:
            residual[3:] = rotation_vector((candidate.R @ pose.R.T).tolist())
        cost = candidate.cost + float(residual @ candidate.information @ residual)
        if best is None or cost < best[0]:
            best = (cost, residual, candidate)
    assert best is not None
    return best[1], best[2]
