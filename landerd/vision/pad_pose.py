"""Pose of the landing point from all markers seen, by joint least squares.

Each marker gives a pose and its information matrix, two of them where the image is ambiguous. A
pose of the pad together with the errors of its markers (displaced, tilted, too large) implies a
pose of each marker. The joint solution minimises the squared Mahalanobis distances of these poses
to the measured ones, plus that of the errors to what is known of them (`MarkerErrors`). A marker
beside the landing point, on a plate that may be bent, therefore counts less the farther away it is,
and the joint covariance includes that.

`choice` asks this module whether candidates agree; `vision` reports the resulting poses.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.geometry import Vec3, cross, rotation_vector
from landerd.messages import PoseSolution, SystematicError
from landerd.vision.linear import inverse, outer, solved, trace
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

_UNIT = np.eye(3)
_UP, _RIGHT = np.array([0.0, -1.0, 0.0]), _UNIT[0]  # in the picture
_MAX_STEPS = 5
# Iteration ends when a step reduces chi-square by less than this: a hundredth of a sigma.
_CONVERGED = 1e-4
# Information of the heading that is always added, 1/rad^2: a single ring 0.2 m beside the landing
# point, say, tells nothing of the heading. With less, a ring that is known to lie within 2 mm of
# its place would be put metres off it.
_MIN_YAW_INFORMATION = 1.0 / 5.0**2
_PRIOR_NORTH_SIGMA = math.radians(5.0)  # of the estimator's heading, where it stands in
# A solution is dropped if its chi-square exceeds the best one's by more than this: one of the pad;
# and one of a single ring, which the other markers could not make up for.
_MAX_CHI2_ABOVE_BEST, MAX_RING_CHI2_ABOVE_BEST = 50.0, 200.0


@dataclass(frozen=True, slots=True)
class Measurement:
    """A marker's place on the pad, and the poses that its image allows, best first."""

    marker: int  # its index in the pad's list of markers
    place: F64  # its centre in the pad frame, m, (3,)
    heading: float | None  # of its north in the pad frame, rad; None: a plain ring has none
    poses: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class Joint:
    """A pose of the pad together with the errors of the k markers seen.

    The unknowns are the 6 + 7 k numbers (dt, w, errors): the pose's small error, then each
    marker's errors.
    """

    pose: Pose  # its own information is not used
    errors: F64  # of the markers, (7 k,)
    information: F64  # (6 + 7 k, 6 + 7 k), from the picture and from what was known before
    seen: F64  # that from the picture alone
    # For each marker the gradients (6 + 7 k, n) of n independent errors that all markers share (a
    # rolling shutter's motion): times the joint covariance they are shifts of the solution.
    pulls: tuple[F64, ...]


def ring_measurement(
    marker: int,
    place: tuple[float, float],
    solutions: tuple[PoseSolution, ...],
    shared: tuple[F64, ...] = (),
) -> Measurement:
    """Return the measurement of a plain ring: position and normal, no heading.

    Args:
        marker: index of the ring among the pad's markers.
        place: its centre in the pad frame, m.
        solutions: of its sighting.
        shared: for each solution, the errors that it shares with other markers (`Pose.shared`);
            empty: there are none.
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
        information[3:, 3:] = (_UNIT - outer(n, n)) / s.sigma_tilt**2
        R = rotation_from(n, _UP if abs(n[1]) < 0.9 else _RIGHT)
        poses.append(Pose(R, np.array(s.position), information, s.cost - best, errors))
    return Measurement(marker, np.array([*place, 0.0]), None, tuple(poses))


def with_north(ring: Measurement, north: F64, sigma: float) -> Measurement:
    """Return a ring's measurement with the pad's north added, as its plate shows it.

    Args:
        ring: position and normal.
        north: unit vector (3,), camera frame.
        sigma: of north, rad.
    """
    poses = []
    for p in ring.poses:
        n = p.normal
        information = p.information.copy()
        information[3:, 3:] += outer(n, n) / sigma**2
        poses.append(replace(p, R=rotation_from(n, north), information=information))
    return replace(ring, heading=0.0, poses=tuple(poses))


def pad_poses(
    measured: list[Measurement], errors: MarkerErrors, north: Vec3 | None, down: Vec3 | None
) -> list[PoseSolution]:
    """Return the poses of the landing point that explain all markers, best first, at most two.

    Args:
        measured: the markers seen.
        errors: how they may differ from the pad file.
        north: the pad's north according to the estimator, camera frame; used only where the
            markers leave the heading open.
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
    """Return the markers with poses in the pad's axes, the one with the most certain tilt first.

    Each of its solutions is a start for the joint pose; of the others the nearest one is used.
    """
    turned = [_to_pad_axes(m) for m in measured]
    if len(turned) == 1:
        return turned
    return sorted(
        turned, key=lambda m: -tilt_information(m.poses[0].information, m.poses[0].normal)
    )


def joint_poses(
    measured: list[Measurement], mean: F64, known: F64, north: F64 | None
) -> list[Joint]:
    """Return the poses of the pad that explain all markers.

    Args:
        measured: k markers, `in_order`.
        mean: of their errors as known before, (7 k,).
        known: information of that mean, (7 k, 7 k).
        north: the pad's north according to the estimator, camera frame.
    """
    joint: list[Joint] = []
    for first in measured[0].poses:
        found = _joint(measured, first, north, mean, known)
        if found is not None and not any(_same(found.pose, other.pose) for other in joint):
            joint.append(found)
    return joint


def learn(measured: list[Measurement], errors: MarkerErrors, t: float, pad: PoseSolution) -> None:
    """Learn from a frame how its markers lie relative to one another.

    Args:
        measured: the markers seen that belong to the pad.
        errors: what is known of their errors; updated.
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
    known[3:6, 3:6] = _MIN_YAW_INFORMATION * outer(n, n)
    joint = inverse(known + LEARNED_SHARE * seen)
    errors.learn(t, markers, mean + LEARNED_SHARE * (joint @ gradient)[6:], joint[6:, 6:])


def _solution(joint: Joint, errors: MarkerErrors, has_north: bool) -> PoseSolution | None:
    """Return a pose as vision reports it, with the systematic part of its covariance.

    The joint covariance P is P (H + L) P, with H the information from the picture and L that from
    what was known before. P L P is the same error in every frame: systematic. Two more such errors
    are added: all markers may be too large, which moves the pad along the line of sight, and the
    focal length too long, which moves it along the optical axis.
    """
    pose = joint.pose
    try:
        P = inverse(joint.information)
    except np.linalg.LinAlgError:
        return None
    # Each marker's information contains the errors that all share as if they were independent:
    # replaced here by their common effect.
    alike = np.zeros((6, 6))
    if joint.pulls[0].size:
        parts = [P[:6] @ pull for pull in joint.pulls]
        together = np.sum(parts, axis=0)
        alike = together @ together.T - np.sum([part @ part.T for part in parts], axis=0)
    noise = (P @ joint.seen @ P)[:6, :6] + alike
    total = P[:6, :6] + alike
    total[:3, :3] += errors.scale_sigma**2 * outer(pose.t, pose.t)
    total[2, 2] += (errors.focal_sigma * pose.t[2]) ** 2
    systematic = total - noise
    turn = systematic[3:, 3:]
    yaw = max(0.0, float(pose.normal @ turn @ pose.normal))
    tilt = max(0.0, 0.5 * (trace(turn) - yaw))
    error = SystematicError(mat3(systematic[:3, :3]), yaw**0.5, tilt**0.5)
    return solution_of(pose, total, has_north=has_north, systematic=error)


def with_gravity(pose: Pose, down: Vec3 | None) -> Pose:
    """Return the pose with its cost increased by the chi-square of its normal against gravity."""
    return Pose(pose.R, pose.t, pose.information, pose.cost + gravity_cost(pose.normal, down))


def _to_pad_axes(m: Measurement) -> Measurement:
    """Return a measurement with poses in the pad's axes instead of the marker's."""
    if m.heading is None:
        return m
    heading = m.heading
    poses = tuple(
        Pose(turned_about_normal(p.R, -heading), p.t, p.information, p.cost, p.shared)
        for p in m.poses
    )
    return Measurement(m.marker, m.place, heading, poses)


def tilt_information(information: F64, normal: F64) -> float:
    """Return that about the two directions of a pose's normal, summed, 1/rad^2."""
    turn = information[3:, 3:]
    return trace(turn) - float(normal @ turn @ normal)


def _has_north(measured: list[Measurement]) -> bool:
    """Tell whether the markers tell the heading: one has its own, or they lie at two places."""
    if any(m.heading is not None for m in measured):
        return True
    return any(np.abs(m.place - measured[0].place).max() > 1e-6 for m in measured[1:])


def _same(a: Pose, b: Pose) -> bool:
    """Tell whether two poses are the same minimum."""
    step = a.R.T @ b.R
    near = np.linalg.norm(a.t - b.t) < 1e-4 * np.linalg.norm(a.t)
    return bool(near and trace(step) > 3.0 - 1e-5)


def _joint(
    measured: list[Measurement], first: Pose, prior_north: F64 | None, mean: F64, known: F64
) -> Joint | None:
    """Return the minimum of the joint cost near one solution of the first marker; None: it fails.

    Args:
        measured: k markers.
        first: a solution of the first one.
        prior_north: the pad's north according to the estimator, camera frame.
        mean: of the markers' errors as known before, (7 k,).
        known: information of that mean, (7 k, 7 k).
    """
    errors = mean
    # The first marker keeps this one solution, and the pad starts where this solution and the
    # marker's known errors put it. From another start, of a bent pad low under the camera, the
    # mirrored solution seemed nearer.
    m = measured[0]
    measured = [Measurement(m.marker, m.place, m.heading, (first,)), *measured[1:]]
    R = _start_rotation(measured, first, prior_north) @ cv2.Rodrigues(errors[TILT])[0].T
    t = first.t * (1.0 + errors[SCALE]) - R @ (measured[0].place + errors[:3])
    pose = Pose(R, t, np.zeros((6, 6)), 0.0)
    yaw_information = _MIN_YAW_INFORMATION
    if prior_north is not None and not _has_north(measured):
        yaw_information = 1.0 / _PRIOR_NORTH_SIGMA**2
    for _ in range(_MAX_STEPS):
        seen, gradient, cost, pulls = _normal_equations(measured, pose, errors)
        n = pose.normal
        seen[3:6, 3:6] += yaw_information * outer(n, n)
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
    """Return the Gauss-Newton terms at a pose of the pad and errors (7 k,) of its k markers.

    Returns:
        information (6 + 7 k, 6 + 7 k), gradient (6 + 7 k,), cost, and `Joint.pulls`.
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
    """Return the rotation (3, 3) to start from: the first marker's normal, and a heading about it.

    The heading is a decoded marker's, else that of the line between two markers, else the
    estimator's, else arbitrary.
    """
    for m in measured:
        if m.heading is not None:
            # Of its solutions the one with the most similar normal: the north of the mirrored one
            # may be tens of degrees off, too far for the steps to converge.
            alike = max(m.poses, key=lambda pose: float(pose.normal @ first.normal))
            return rotation_from(first.normal, alike.R[:, 0])
    for m in measured[1:]:
        arm = m.place - measured[0].place
        if np.abs(arm).max() > 1e-6:
            # The pad's north is the direction from one marker to the other turned back by the
            # bearing that it has on the pad.
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
    """Return a marker's solution nearest to what a pose of the pad and the marker's errors imply.

    A marker that is larger than the pad file says looks nearer by the same factor.

    Args:
        m: the marker.
        pose: of the pad.
        e: the marker's errors, (7,).

    Returns:
        the residual (6,), the solution, and the derivative (6, 6 + 7) of the marker's pose by that
        of the pad and by the marker's errors.
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
