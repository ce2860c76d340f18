"""Pose of the landing point from all markers seen, by one joint least squares.

Each marker gives a pose and its information matrix, twice where the image is ambiguous. A pose of
the pad, and the errors of its markers, imply a pose of each marker; the joint solution minimises
the sum of their Mahalanobis distances to what was measured, and that of the errors to what is known
of them (`MarkerErrors`). So a marker beside the landing point, whose arm may be bent, counts the
less the farther off it is, and the joint covariance knows of it.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.geometry import Vec3, cross, rotation_vector
from landerd.messages import PoseSolution, SystematicError
from landerd.vision.linear import inverse, solved
from landerd.vision.marker_errors import ERRORS, LEARNED_SHARE, SCALE, TILT, MarkerErrors
from landerd.vision.pose import (
    Pose,
    gravity_cost,
    mat3,
    rotation_from,
    skew,
    solution_of,
    turned_about_normal,
    vec3,
)

_MAX_STEPS = 5
_CONVERGED = 1e-4  # reduction of chi-square by a step: a hundredth of a sigma
# 1/rad^2, of a heading that nobody knows: a ring 0.2 m beside the landing point tells nothing of
# that. Less would put a ring metres off that is known to lie 2 mm beside its place.
_MIN_YAW_INFORMATION = 1.0 / 5.0**2
_PRIOR_NORTH_SIGMA = math.radians(5.0)
# A solution is dropped whose chi-square is above the best one's by more: of the pad; and of a ring
# by itself, which the other markers cannot make up for.
_MAX_CHI2_ABOVE_BEST, MAX_RING_CHI2_ABOVE_BEST = 50.0, 200.0


@dataclass(frozen=True, slots=True)
class Measurement:
    """A marker's place on the pad and the poses its image allows, best first."""

    marker: int  # its place among the pad's markers
    place: F64  # centre in the pad frame, (3,)
    heading: float | None  # of its north in the pad frame, rad; None: a plain ring
    poses: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class Joint:
    """A pose of the pad with the errors of the k markers seen: small errors are (dt, w, 7 k)."""

    pose: Pose  # its information is not that of the joint
    errors: F64  # (7 k,)
    information: F64  # (6 + 7 k, 6 + 7 k), of the picture and of what was known
    seen: F64  # that of the picture alone
    # Of each marker what the errors that all share pull the joint pose by: over P, (6 + 7 k, n).
    pulls: tuple[F64, ...]


def ring_measurement(
    marker: int,
    place: tuple[float, float],
    solutions: tuple[PoseSolution, ...],
    shared: tuple[F64, ...] = (),
) -> Measurement:
    """Return what a ring's sighting says: position and normal, no heading.

    `shared` are the solutions' errors that other markers share, none if empty; see `Pose`.
    """
    poses = []
    best = min(s.cost for s in solutions)
    none = (np.zeros((6, 0)),) * len(solutions)
    for s, errors in zip(solutions, shared or none, strict=True):
        if s.cost > best + MAX_RING_CHI2_ABOVE_BEST:
            continue
        n = np.array(s.normal)
        information = np.zeros((6, 6))
        information[:3, :3] = inverse(np.array(s.covariance))
        information[3:, 3:] = (np.eye(3) - np.outer(n, n)) / s.sigma_tilt**2
        R = rotation_from(n, np.array([0.0, -1.0, 0.0]) if abs(n[1]) < 0.9 else np.eye(3)[0])
        poses.append(Pose(R, np.array(s.position), information, s.cost - best, errors))
    return Measurement(marker, np.array([*place, 0.0]), None, tuple(poses))


def with_north(ring: Measurement, north: F64, sigma: float) -> Measurement:
    """Return what a ring's sighting says together with where the pad's north is.

    Args:
        ring: position and normal.
        north: unit vector (3,), camera frame, with
        sigma: rad.
    """
    poses = []
    for p in ring.poses:
        n = p.normal
        information = p.information.copy()
        information[3:, 3:] += np.outer(n, n) / sigma**2
        poses.append(replace(p, R=rotation_from(n, north), information=information))
    return replace(ring, heading=0.0, poses=tuple(poses))


def pad_poses(
    measured: list[Measurement], errors: MarkerErrors, north: Vec3 | None, down: Vec3 | None
) -> list[PoseSolution]:
    """Return the poses of the landing point that explain all markers, best first, at most two.

    Args:
        measured: the markers seen.
        errors: how they may differ from the pad file.
        north: the pad's north as the estimate has it, camera frame; used only where the markers
            leave the heading open.
        down: unit vector of gravity, camera frame; puts the more level solution first.
    """
    if not measured:
        return []
    measured = in_order(measured)
    mean, known = errors.of([m.marker for m in measured])
    joint = joint_poses(measured, mean, known, None if north is None else np.array(north))
    joint = [replace(j, pose=with_gravity(j.pose, down)) for j in joint]
    joint.sort(key=lambda j: j.pose.cost)
    has_north = _has_north(measured)
    poses = []
    for j in joint[:2]:
        s = _solution(j, errors, has_north)
        if s is not None and j.pose.cost < joint[0].pose.cost + _MAX_CHI2_ABOVE_BEST:
            poses.append(s)
    return poses


def in_order(measured: list[Measurement]) -> list[Measurement]:
    """Return the markers with their poses in the pad's axes, that which knows its tilt best first.

    A joint pose is sought from its solutions: the others then choose.
    """
    turned = [_to_pad_axes(m) for m in measured]
    return sorted(turned, key=lambda m: -_tilt_information(m.poses[0]))


def joint_poses(
    measured: list[Measurement], mean: F64, known: F64, north: F64 | None
) -> list[Joint]:
    """Return the poses of the pad that explain all markers.

    Args:
        measured: k markers, `in_order`.
        mean: of their errors, (7 k,), and
        known: its information, (7 k, 7 k).
        north: the pad's as the estimate has it, camera frame.
    """
    joint: list[Joint] = []
    for first in measured[0].poses:
        found = _joint(measured, first, north, mean, known)
        if found is not None and not any(_same(found.pose, other.pose) for other in joint):
            joint.append(found)
    return joint


def learn(measured: list[Measurement], errors: MarkerErrors, t: float, pad: PoseSolution) -> None:
    """Remember what a frame says of how its markers lie to one another.

    Args:
        measured: the markers seen that belong to the pad.
        errors: what is known of them; changed.
        t: of the exposure, s.
        pad: its pose in the frame.
    """
    if len(measured) < 2 or pad.north is None or not errors.is_due(t):
        return
    measured = [_to_pad_axes(m) for m in measured]
    markers = [m.marker for m in measured]
    mean, before = errors.of(markers)
    R = rotation_from(np.array(pad.normal), np.array(pad.north))
    pose = Pose(R, np.array(pad.position), np.zeros((6, 6)), 0.0)
    seen, gradient, *_ = _normal_equations(measured, pose, mean)
    known = np.zeros_like(seen)
    known[6:, 6:] = before
    n = pose.normal
    known[3:6, 3:6] = _MIN_YAW_INFORMATION * np.outer(n, n)
    joint = inverse(known + LEARNED_SHARE * seen)
    errors.learn(t, markers, mean + LEARNED_SHARE * (joint @ gradient)[6:], joint[6:, 6:])


def _solution(joint: Joint, errors: MarkerErrors, has_north: bool) -> PoseSolution | None:
    """Return a pose as vision reports it, with what is systematic of its uncertainty.

    The joint covariance is P (H + L) P, H the information of the picture and L that of what was
    known before: P L P is alike in all frames. Besides, all markers may be too large together,
    which moves the pad along the sight, and the lens too long, which moves it along the lens's
    axis.
    """
    pose = joint.pose
    try:
        P = inverse(joint.information)
    except np.linalg.LinAlgError:
        return None
    # Errors that the markers share count once, not as independent ones of each.
    alike = np.zeros((6, 6))
    if joint.pulls[0].size:
        parts = [P[:6] @ pull for pull in joint.pulls]
        together = np.sum(parts, axis=0)
        alike = together @ together.T - np.sum([part @ part.T for part in parts], axis=0)
    noise = (P @ joint.seen @ P)[:6, :6] + alike
    total = P[:6, :6] + alike
    total[:3, :3] += errors.scale_sigma**2 * np.outer(pose.t, pose.t)
    total[2, 2] += (errors.focal_sigma * pose.t[2]) ** 2
    found = solution_of(pose, total, has_north=has_north)
    if found is None:
        return None
    systematic = total - noise
    turn = systematic[3:, 3:]
    yaw = max(0.0, float(pose.normal @ turn @ pose.normal))
    tilt = max(0.0, 0.5 * (float(np.trace(turn)) - yaw))
    return replace(found, systematic=SystematicError(mat3(systematic[:3, :3]), yaw**0.5, tilt**0.5))


def with_gravity(pose: Pose, down: Vec3 | None) -> Pose:
    """Return the pose with the chi-square of its normal's angle to gravity added to its cost."""
    return Pose(pose.R, pose.t, pose.information, pose.cost + gravity_cost(pose.normal, down))


def _to_pad_axes(m: Measurement) -> Measurement:
    """Return a measurement whose poses are turned from the marker's axes to the pad's."""
    if m.heading is None:
        return m
    heading = m.heading
    poses = tuple(replace(p, R=turned_about_normal(p.R, -heading)) for p in m.poses)
    return replace(m, poses=poses)


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


def _joint(
    measured: list[Measurement], first: Pose, prior_north: F64 | None, mean: F64, known: F64
) -> Joint | None:
    """Minimise the joint cost from one solution of the first marker; None if it fails.

    Args:
        measured: k markers.
        first: a solution of the first one.
        prior_north: the pad's, camera frame.
        mean: of the markers' errors as known before, (7 k,), and
        known: its information, (7 k, 7 k).
    """
    errors = mean
    # Of the first marker no other solution: with its errors as they are known it starts where that
    # shows it. From elsewhere a mirrored one seemed nearer, of a bent pad low under the camera.
    measured = [replace(measured[0], poses=(first,)), *measured[1:]]
    R = _start_rotation(measured, first, prior_north) @ cv2.Rodrigues(errors[TILT])[0].T
    t = first.t * (1.0 + errors[SCALE]) - R @ (measured[0].place + errors[:3])
    pose = Pose(R, t, np.zeros((6, 6)), 0.0)
    yaw_information = _MIN_YAW_INFORMATION
    if prior_north is not None and not _has_north(measured):
        yaw_information = 1.0 / _PRIOR_NORTH_SIGMA**2
    for _ in range(_MAX_STEPS):
        seen, gradient, cost, pulls = _normal_equations(measured, pose, errors)
        n = pose.normal
        seen[3:6, 3:6] += yaw_information * (n[:, None] * n)
        information = seen.copy()
        information[6:, 6:] += known
        pull = known @ (errors - mean)
        gradient[6:] -= pull
        cost += float((errors - mean) @ pull)
        try:
            step = solved(information, gradient)
        except np.linalg.LinAlgError:
            return None
        pose = Pose(pose.R, pose.t, pose.information, cost).moved(step[:6])
        errors = errors + step[6:]
        if float(gradient @ step) < _CONVERGED:
            break
    return Joint(pose, errors, information, seen, pulls) if np.isfinite(pose.t).all() else None


def _normal_equations(
    measured: list[Measurement], pose: Pose, errors: F64
) -> tuple[F64, F64, float, tuple[F64, ...]]:
    """Return information, gradient and cost of k markers at a pose of the pad and their errors.

    And by what the errors that all share pull at each; see `Joint`.
    """
    pulls = []
    size = 6 + ERRORS * len(measured)
    information, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
    for i, m in enumerate(measured):
        own = slice(6 + ERRORS * i, 6 + ERRORS * (i + 1))
        residual, chosen, J = _nearest(m, pose, errors[ERRORS * i : ERRORS * (i + 1)])
        weighted = J.T @ chosen.information
        both, pull = weighted @ J, weighted @ residual
        information[:6, :6] += both[:6, :6]
        information[:6, own] = both[:6, 6:]
        information[own, :6] = both[6:, :6]
        information[own, own] = both[6:, 6:]
        gradient[:6] += pull[:6]
        gradient[own] = pull[6:]
        pulls.append(np.zeros((size, chosen.shared.shape[1])))
        if chosen.shared.size:
            of_shared = weighted @ chosen.shared
            pulls[-1][:6], pulls[-1][own] = of_shared[:6], of_shared[6:]
        cost += chosen.cost + float(residual @ chosen.information @ residual)
    return information, gradient, cost, tuple(pulls)


def _start_rotation(measured: list[Measurement], first: Pose, prior_north: F64 | None) -> F64:
    """Return a rotation of the pad about the first marker's normal to start from."""
    for m in measured:
        if m.heading is not None:
            # A mirrored one's north may be tens of degrees off: no step leads back from there.
            alike = max(m.poses, key=lambda pose: float(pose.normal @ first.normal))
            return rotation_from(first.normal, alike.R[:, 0])
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


def _nearest(m: Measurement, pose: Pose, e: F64) -> tuple[F64, Pose, F64]:
    """Return the marker's solution nearest to a pad's pose and its errors (7,).

    A marker that is larger than its file says looks so much nearer.

    Returns:
        the residual (6,), the solution, and the derivative of the marker's pose by that of the pad
        and by the marker's errors (6, 6 + 7).
    """
    size = 1.0 + float(e[SCALE])
    arm = pose.R @ (m.place + e[:3])
    t = (pose.t + arm) / size
    R: F64 = pose.R @ cv2.Rodrigues(e[TILT])[0]
    normal = vec3(R[:, 2])
    best: tuple[float, F64, Pose] | None = None
    for candidate in m.poses:
        residual = np.empty(6)
        residual[:3] = candidate.t - t
        if m.heading is None:
            residual[3:] = cross(normal, vec3(candidate.normal))
        else:
            residual[3:] = rotation_vector((candidate.R @ R.T).tolist())
        cost = candidate.cost + float(residual @ candidate.information @ residual)
        if best is None or cost < best[0]:
            best = (cost, residual, candidate)
    assert best is not None
    J = np.zeros((6, 6 + ERRORS))
    J[0, 0] = J[1, 1] = J[2, 2] = 1.0 / size
    J[3, 3] = J[4, 4] = J[5, 5] = 1.0
    J[:3, 3:6] = skew(arm) / -size
    J[:3, 6:9] = pose.R / size
    J[3:, 9:12] = pose.R
    J[:3, 6 + SCALE] = t / -size
    return best[1], best[2], J
