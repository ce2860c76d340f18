"""Fits a gimbal's mounting to views of a pad that lies still and level.

The unknowns are the true angle of each axis for the angle that the gimbal reports, and the rotation
of the camera on the last axis; besides, the position of the pad and the distance of the lens from
the axes. The zero of the pitch is determined by the pad being level, that of the yaw by its being
straight ahead; the camera's rotation, by the axes about which the pad seems to turn. The fit is by
weighted least squares (Levenberg-Marquardt).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from landerd.camera_model import F64
from landerd.geometry import (
    R_GIMBAL_CAMERA,
    Mat3,
    Vec3,
    clamp,
    cross,
    dot,
    matmul,
    matmul_transposed,
    norm,
    rot_zxy,
    rot_zyx,
    rotate,
    rotation_vector,
    scale,
    sub,
    transpose,
)
from landerd.messages import PoseSolution

# Assumed standard deviations of how exactly people place things; estimates, not measured.
_LEVEL_SIGMA = math.radians(0.5)  # of pad and airframe
_AHEAD_SIGMA_M = 0.01  # of the pad's middle sideways from straight ahead
_CAMERA_SIGMA = math.radians(3.0)  # of the camera's rotation on the last axis
_NOT_TURNED = 1e-6  # the same, rad, if the rotation cannot be distinguished from an axis's zero
_LEVER_SIGMA_M = 0.03  # of the lens's distance from the axes
# Error of a pose by vision and the camera's calibration, in addition to the stated one.
_BEARING_SIGMA = 1e-3  # rad
_TILT_SIGMA = math.radians(0.5)
_HEADING_SIGMA = math.radians(0.3)
_MOST_STEPS = 30  # most Levenberg-Marquardt steps
_CONVERGED = 1e-4  # a step that reduces the cost by a smaller share is the last

Kind = Literal["shift", "table", "none"]


@dataclass(frozen=True)
class View:
    """The pad in one picture, taken with the gimbal at rest."""

    place: int  # number of the place in which the pad lay
    yaw: float  # as the gimbal reports, rad
    pitch: float
    roll: float
    pad: PoseSolution  # with north
    down: Vec3  # unit vector of gravity in the frame that the gimbal's angles are against


@dataclass(frozen=True)
class Axis:
    """The unknowns of an axis.

    shift: true = sign * reported + zero, one value. table: the true angles at the reported ones
    given, a straight line in between. none: it is as reported.
    """

    kind: Kind
    sign: int = 1
    at: tuple[float, ...] = ()

    @property
    def size(self) -> int:
        """Number of unknown values."""
        return {"shift": 1, "table": len(self.at), "none": 0}[self.kind]

    def true(self, reported: float, values: F64) -> float:
        """Return the true angle, rad."""
        if self.kind == "shift":
            return self.sign * reported + float(values[0])
        if self.kind == "table":
            return float(np.interp(reported, self.at, values))
        return reported


@dataclass(frozen=True)
class GimbalFit:
    """The least-squares solution; angles in rad."""

    yaw: tuple[float, ...]  # values of the axis
    pitch: tuple[float, ...]
    yaw_sigma: float  # of the worst value; 0 without any
    pitch_sigma: float
    camera_roll: float  # the camera on the last axis, to the right
    camera_yaw: float
    error: float  # rms angle between directions in which the pad was seen and should have been


def fit(views: Sequence[View], yaw: Axis, pitch: Axis, aside_m: float, *, turns: bool) -> GimbalFit:
    """Return the least-squares solution for the views.

    Args:
        views: of pads that lie level and straight ahead; each with its north.
        yaw: the unknowns of the yaw axis.
        pitch: those of the pitch axis.
        aside_m: distance of the airframe's centre line, on which pads lie, to the right of the
            gimbal's pivot.
        turns: whether any axis turns; if none does, the camera's rotation cannot be distinguished
            from the zero of its last axis, and is taken to be null.
    """
    problem = _Problem(views, yaw, pitch, aside_m, _CAMERA_SIGMA if turns else _NOT_TURNED)
    x, covariance = _least_squares(problem)
    sigma = np.sqrt(np.diag(covariance))
    cut = yaw.size + pitch.size
    errors = [problem.bearing_error(x, view) for view in views]
    return GimbalFit(
        tuple(float(v) for v in x[: yaw.size]),
        tuple(float(v) for v in x[yaw.size : cut]),
        float(sigma[: yaw.size].max(initial=0.0)),
        float(sigma[yaw.size : cut].max(initial=0.0)),
        float(x[cut]),
        float(x[cut + 1]),
        math.sqrt(sum(e * e for e in errors) / len(errors)),
    )


class _Problem:
    """The unknowns in one vector, and their residuals.

    Unknowns: values of yaw, of pitch; camera roll and yaw; the lens's place behind the axes (m,
    camera frame); for each place of the pad its position (m) and turn (rad) in the base frame.
    """

    def __init__(
        self, views: Sequence[View], yaw: Axis, pitch: Axis, aside_m: float, camera_yaw: float
    ) -> None:
        """Make the problem; camera_yaw: standard deviation of the camera's yaw on its axis, rad."""
        self._views, self._yaw, self._pitch, self._aside_m = views, yaw, pitch, aside_m
        self._camera_sigma = np.array([_CAMERA_SIGMA, camera_yaw])
        self._cut = yaw.size + pitch.size
        self._weights = [_whitening(view.pad) for view in views]
        places = sorted({view.place for view in views})
        self._row = {place: self._cut + 5 + 6 * i for i, place in enumerate(places)}
        self._down = {view.place: view.down for view in views}
        self.start = np.zeros(self._cut + 5 + 6 * len(places))
        self._guess_axes()
        self._pads: dict[int, Mat3] = {}  # R_base_pad before its turn
        for place in places:
            view = next(v for v in views if v.place == place)
            R = self._look(self.start, view)
            row = self._row[place]
            self.start[row : row + 3] = rotate(R, view.pad.position)
            self._pads[place] = matmul(R, R_camera_pad(view.pad))

    def _guess_axes(self) -> None:
        """Level the first view's pad, then bring it straight ahead."""
        view = self._views[0]
        down = rotate(R_GIMBAL_CAMERA, view.pad.normal)  # gimbal frame
        pitch = math.atan2(-down[0], down[2])
        roll = math.asin(clamp(down[1], -1.0, 1.0))
        x, y, _ = rotate(matmul(rot_zxy(0.0, roll, pitch), R_GIMBAL_CAMERA), view.pad.position)
        n = self._yaw.size
        self.start[:n] = self._guess(self._yaw, view.yaw, -math.atan2(y, x))
        self.start[n : self._cut] = self._guess(self._pitch, view.pitch, pitch)

    @staticmethod
    def _guess(axis: Axis, reported: float, true: float) -> F64:
        """Return values of an axis for which one true angle is right."""
        zero = true - axis.sign * reported
        if axis.kind == "table":
            return axis.sign * np.array(axis.at) + zero
        return np.full(axis.size, zero)

    def _look(self, x: F64, view: View) -> Mat3:
        """Return R_base_camera."""
        yaw = self._yaw.true(view.yaw, x[: self._yaw.size])
        pitch = self._pitch.true(view.pitch, x[self._yaw.size : self._cut])
        roll, aside = float(x[self._cut]), float(x[self._cut + 1])
        R_gimbal_camera = matmul(rot_zyx(aside, 0.0, roll), R_GIMBAL_CAMERA)
        return matmul(rot_zxy(yaw, view.roll, pitch), R_gimbal_camera)

    def _seen(self, x: F64, view: View) -> tuple[Vec3, Mat3]:
        """Return the pad's expected position, camera frame, m, and its expected R_camera_pad."""
        R_camera_base = transpose(self._look(x, view))
        row = self._row[view.place]
        position = (float(x[row]), float(x[row + 1]), float(x[row + 2]))
        lever = tuple(x[self._cut + 2 : self._cut + 5])
        in_camera = sub(rotate(R_camera_base, position), lever)
        return in_camera, matmul(R_camera_base, self._lie(x, view.place))

    def _lie(self, x: F64, place: int) -> Mat3:
        """Return R_base_pad."""
        row = self._row[place] + 3
        roll, pitch, yaw = (float(v) for v in x[row : row + 3])
        return matmul(rot_zyx(yaw, pitch, roll), self._pads[place])

    def residuals(self, x: F64) -> F64:
        """Return all residuals, in units of their sigmas."""
        rest: list[float] = []
        for view, W in zip(self._views, self._weights, strict=True):
            position, R = self._seen(x, view)
            rest += list(W @ np.array(sub(view.pad.position, position)))
            normal, north = _column(R, 2), _column(R, 0)
            tilt = math.hypot(view.pad.sigma_tilt, _TILT_SIGMA)
            heading = math.hypot(view.pad.sigma_yaw or 0.0, _HEADING_SIGMA)
            rest += scale(sub(view.pad.normal, normal), 1.0 / tilt)
            # Only the rotation about the normal is new information.
            rest.append(dot(view.pad.north or north, cross(normal, north)) / heading)
        for place, row in self._row.items():
            level = sub(_column(self._lie(x, place), 2), self._down[place])
            rest += scale(level, 1.0 / _LEVEL_SIGMA)
            rest.append((float(x[row + 1]) - self._aside_m) / _AHEAD_SIGMA_M)
        rest += list(x[self._cut : self._cut + 2] / self._camera_sigma)
        rest += list(x[self._cut + 2 : self._cut + 5] / _LEVER_SIGMA_M)
        return np.array(rest)

    def bearing_error(self, x: F64, view: View) -> float:
        """Return the angle between where the pad was seen and where it should be, rad."""
        a, b = view.pad.position, self._seen(x, view)[0]
        return math.atan2(norm(cross(a, b)), dot(a, b))


def _least_squares(problem: _Problem) -> tuple[F64, F64]:
    """Return the least-squares solution and its covariance."""
    x, damping = problem.start, 1e-3
    rest = problem.residuals(x)
    cost = float(rest @ rest)
    for _ in range(_MOST_STEPS):
        J = _jacobian(problem, x, rest)
        A, b = J.T @ J, J.T @ rest
        for _ in range(8):
            step = np.linalg.solve(A + damping * np.diag(np.diag(A) + 1e-9), -b)
            tried = problem.residuals(x + step)
            new = float(tried @ tried)
            if new < cost:
                break
            damping *= 10.0
        else:
            break
        gain, x, rest, cost, damping = cost - new, x + step, tried, new, 0.1 * damping
        if gain < _CONVERGED * cost:
            break
    J = _jacobian(problem, x, rest)
    freedom = max(1, len(rest) - len(x))
    return x, np.asarray(np.linalg.pinv(J.T @ J) * max(1.0, cost / freedom), np.float64)


def _jacobian(problem: _Problem, x: F64, rest: F64) -> F64:
    """Return the derivatives of the residuals by the unknowns, (residuals, unknowns)."""
    J, h = np.empty((len(rest), len(x))), 1e-6
    for i in range(len(x)):
        moved = x.copy()
        moved[i] += h
        J[:, i] = (problem.residuals(moved) - rest) / h
    return J


def _whitening(pad: PoseSolution) -> F64:
    """Return the matrix (3, 3) that turns errors of a pad's position into units of sigma."""
    floor = (_BEARING_SIGMA * norm(pad.position)) ** 2
    covariance = np.array(pad.covariance) + floor * np.eye(3)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def R_camera_pad(pad: PoseSolution) -> Mat3:  # noqa: N802 - the frames' notation
    """Return the rotation from a pad with north to the camera."""
    assert pad.north is not None
    return transpose((pad.north, cross(pad.normal, pad.north), pad.normal))


def turn_between(before: PoseSolution, after: PoseSolution) -> Vec3:
    """Return how the camera turned from one view to the next: axis times angle (rad), its frame."""
    return rotation_vector(matmul_transposed(R_camera_pad(before), R_camera_pad(after)))


def _column(R: Mat3, i: int) -> Vec3:
    return (R[0][i], R[1][i], R[2][i])
