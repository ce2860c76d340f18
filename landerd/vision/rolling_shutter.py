"""How far a rolling shutter may have bent what a picture shows of a marker.

Rows are exposed one after another. What moves in the image meanwhile is sheared or stretched by its
motion during the readout, which no single picture can tell from a tilt and another distance. How
fast the pad moves in the image is told by the frames before; the error that this may mean is added
to the covariance of each marker's pose. It is one motion that bends all markers of a picture, and
shifts those above the landing point the other way than those below.
"""

import math
from dataclasses import replace

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting, PoseSolution
from landerd.pad import Ring
from landerd.vision.linear import inverse, solved
from landerd.vision.pose import Pose, circle, mat3, rotation_from
from landerd.vision.square_pose import ray_derivative

_KNOWN_FOR_S = 0.5  # so long after two sightings the motion is about what it was between them
_UNKNOWN_RATE = 0.3  # rad/s, 1 sigma, along x and y: a gimbal that searches, a drone in wind
# By trial on sheared pictures from 2 to 15 m: of the shear, how much it is as a tilt squared; and
# of the error's length, what a linear model leaves.
_FRONTAL, _REST = 0.1, 0.2
_ALONG = 1e-3  # rad: a step along a circle
_RATE_SIGMA, _RATE_SHARE = 0.02, 0.3  # of a rate that was seen: vibration, and how it changes


class RollingShutter:
    """The shutter of one camera and the motion of the pad in its image."""

    def __init__(self, camera: CameraModel, readout_s: float) -> None:
        """Prepare.

        Args:
            camera: the lens.
            readout_s: from the exposure of the first row to that of the last; 0: all at once.
        """
        self._readout_s = readout_s
        self._per_ray = camera.fy / camera.height  # rows, as a share of all, along y on z = 1
        self._last: tuple[float, F64] | None = None
        self._rate: F64 | None = None  # of the pad's image, rad/s, (2,)

    def saw(self, t: float, position: F64) -> None:
        """Take where the pad's landing point (3,) was at a time t, s."""
        at: F64 = position[:2] / position[2]
        before, self._last = self._last, (t, at)
        past = math.inf if before is None else t - before[0]
        known = before is not None and 0.0 < past < _KNOWN_FOR_S
        self._rate = (at - before[1]) / past if known and before is not None else None

    def of_pose(self, t: float, pose: Pose, outline: F64, origin: F64) -> Pose:
        """Return a pose seen at a time t, s, with what the shutter may have done to it.

        Args:
            t: of the picture, s.
            pose: of the marker.
            outline: points (n, 2) of the marker, m.
            origin: (3,), camera frame, m; the pose is that as its row is exposed.
        """
        moved = self._moved(t)
        if moved is None:
            return pose
        change = self._change(pose, outline, moved, origin, is_round=False)
        shared = change[:, : moved.shape[1]]
        try:
            covariance = inverse(pose.information) + change @ change.T
            information = inverse(covariance)
        except np.linalg.LinAlgError:
            return replace(pose, shared=np.zeros_like(shared))
        return replace(pose, information=information, shared=shared)

    def of_ring(
        self, t: float, ring: Ring, sighting: MarkerSighting
    ) -> tuple[MarkerSighting, tuple[F64, ...]]:
        """Return a ring seen at a time t, s, with what the shutter may have done to its poses.

        And for each of them, in their order, what all markers share of that; see `Pose`.
        """
        moved = self._moved(t)
        if moved is None:
            return sighting, (np.zeros((6, 0)),) * len(sighting.solutions)
        changed = [self._of_solution(s, ring, moved) for s in sighting.solutions]
        solutions, shared = tuple(s for s, _ in changed), tuple(c for _, c in changed)
        return replace(sighting, solutions=solutions), shared

    def _of_solution(self, s: PoseSolution, ring: Ring, moved: F64) -> tuple[PoseSolution, F64]:
        normal = np.array(s.normal)
        pose = Pose(rotation_from(normal), np.array(s.position), np.zeros((6, 6)), 0.0)
        inner = circle(ring.inner_ratio * ring.radius_m)
        outline = np.vstack([circle(ring.radius_m), inner])
        change = self._change(pose, outline, moved, pose.t, is_round=True)
        covariance = np.array(s.covariance) + change[:3] @ change[:3].T
        tilt = math.hypot(s.sigma_tilt, math.sqrt(0.5) * float(np.linalg.norm(change[3:])))
        changed = replace(s, covariance=mat3(covariance), sigma_tilt=tilt)
        return changed, change[:, : moved.shape[1]]

    def _moved(self, t: float) -> F64 | None:
        """Return by what the image may have moved during the readout, rad.

        A matrix (2, 3) whose columns are independent errors of one sigma each; None: by nothing.
        """
        if self._readout_s == 0.0:
            return None
        if self._rate is None or self._last is None or not 0.0 < t - self._last[0] < _KNOWN_FOR_S:
            return np.eye(2, 3) * (_UNKNOWN_RATE * self._readout_s)
        sigma = _RATE_SIGMA + _RATE_SHARE * float(np.linalg.norm(self._rate))
        return self._readout_s * np.column_stack([self._rate, sigma * np.eye(2)])

    def _change(self, pose: Pose, outline: F64, moved: F64, origin: F64, *, is_round: bool) -> F64:
        """Return what motions (2, k) do to a pose's (dt, w) by least squares, (6, k + 3)."""
        J = ray_derivative(outline, pose)
        rays = pose.rays(outline)
        below = (rays[:, 1] - origin[1] / origin[2]) * self._per_ray
        shift = below[:, None, None] * moved  # (n, 2, k)
        if is_round:
            # Of a circle only what is across its outline is seen.
            onwards = outline + _ALONG * outline[:, ::-1] * (-1.0, 1.0)
            along = pose.rays(onwards) - rays
            across = np.column_stack([-along[:, 1], along[:, 0]])
            across /= np.linalg.norm(across, axis=1)[:, None]
            J = (across[:, :, None] * J.reshape(-1, 2, 6)).sum(axis=1)
            shift = (across[:, :, None] * shift).sum(axis=1)
        H = J.T @ J
        # Near frontal view a tilt changes the image with its square: a small shear needs no large
        # one. And a circle's turn about its axis changes nothing.
        size = float(np.square(rays - rays.mean(axis=0)).sum())
        shear = float(np.linalg.norm(moved)) * self._per_ray
        H[3:, 3:] += size * max(_FRONTAL * shear, 1e-6) * np.eye(3)
        change = solved(H, J.T @ shift.reshape(len(J), -1))
        # What is of second order goes any way.
        rest = np.zeros((6, 3))
        rest[:3] = _REST * float(np.linalg.norm(change[:3])) * np.eye(3)
        return np.hstack([change, rest])
