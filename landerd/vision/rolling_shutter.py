"""Errors of markers' poses by a rolling shutter, added to their covariances.

Rows are exposed one after another, so that what moves in the image is sheared or stretched by its
motion during the readout, and what grows in it looks tilted. A single picture cannot distinguish
that from a tilt and another distance. The rates at which the pad moves and grows in the image are
estimated from the frames before, and the error that they may cause is added to the covariance of
each marker's pose. The same motion distorts all markers of a picture, and shifts those above the
landing point in the opposite direction to those below: `pad_pose` takes these errors as shared
(`Pose.shared`).
"""

import math
from dataclasses import replace

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting, PoseSolution
from landerd.pad import Ring
from landerd.vision.linear import inverse, solved
from landerd.vision.pose import MIN_DEPTH_M, Pose, circle, mat3, rotation_from
from landerd.vision.square_pose import ray_derivative

_KNOWN_FOR_S = 0.5  # a rate between two sightings that are at most so far apart holds so long
# Sigma of an unknown rate along x and along y, rad/s, and of growth, 1/s: a gimbal that searches, a
# drone in wind, a descent.
_UNKNOWN_RATE = 0.3
# By trial on sheared pictures from 2 to 15 m, like `_REST`. Information on a tilt for its
# second-order effect near frontal view, over the shear and the sum of squares of the rays.
_FRONTAL = 0.1
_REST = 0.2  # error that the linear model leaves in a shift of position, over the shift's length
_ALONG = 1e-3  # step along a circle for a difference quotient, rad
# Sigma of rates that were measured: rad/s, for vibration, and a share of them, for their change.
_RATE_SIGMA, _RATE_SHARE = 0.02, 0.3


class RollingShutter:
    """The rolling shutter of one camera, and the motion of the pad in its image."""

    def __init__(self, camera: CameraModel, readout_s: float) -> None:
        """Prepare for one camera.

        Args:
            camera: the lens.
            readout_s: time from the exposure of the first row to that of the last; 0: all rows are
                exposed at once, nothing is added.
        """
        self._readout_s = readout_s
        self._per_ray = camera.fy / camera.height  # image heights per unit of a ray's y
        self._last: tuple[float, F64] | None = None
        self._rate: F64 | None = None  # of the pad's image: rad/s along x and y, and growth, 1/s

    def saw(self, t: float, position: F64) -> None:
        """Learn the position of the pad's landing point, camera frame, m, (3,), at a time t, s."""
        if position[2] < MIN_DEPTH_M:
            self._last = self._rate = None
            return
        at: F64 = np.array([*(position[:2] / position[2]), -math.log(position[2])])
        before, self._last = self._last, (t, at)
        past = math.inf if before is None else t - before[0]
        known = before is not None and 0.0 < past < _KNOWN_FOR_S
        self._rate = (at - before[1]) / past if known and before is not None else None

    def of_pose(self, t: float, pose: Pose, outline: F64, origin: F64) -> Pose:
        """Return a marker's pose with the errors by the shutter in `information` and `shared`.

        Args:
            t: of the picture, s.
            pose: of the marker.
            outline: points of the marker on its own axes (north, east), m, (n, 2).
            origin: of the pad, camera frame, m, (3,). Poses are those at the time its row is
                exposed; where it has none, abreast of the lens, those of the marker's own row.
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
        """Return a ring with the errors of its poses by the shutter, and the shared ones of each.

        Args:
            t: of the picture, s.
            ring: its true size.
            sighting: of the ring.

        Returns:
            the sighting with larger covariances; `Pose.shared` (6, k) for each of its solutions.
        """
        moved = self._moved(t)
        if moved is None:
            return sighting, (np.zeros((6, 0)),) * len(sighting.solutions)
        changed = [self._of_solution(s, ring, moved) for s in sighting.solutions]
        solutions, shared = tuple(s for s, _ in changed), tuple(c for _, c in changed)
        return replace(sighting, solutions=solutions), shared

    def _of_solution(self, s: PoseSolution, ring: Ring, moved: F64) -> tuple[PoseSolution, F64]:
        """Return a solution with larger covariances, and its `Pose.shared`, for motions (3, k)."""
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
        """Return how the image may have moved during the readout, in units of rays on z = 1.

        A matrix (3, k) whose columns are independent motions of one sigma each: along x and y, and
        growth about the landing point, as a share. None: it has not moved, as the shutter is no
        rolling one.
        """
        if self._readout_s == 0.0:
            return None
        if self._rate is None or self._last is None or not 0.0 < t - self._last[0] < _KNOWN_FOR_S:
            return np.eye(3, 4) * (_UNKNOWN_RATE * self._readout_s)
        across, growth = float(np.linalg.norm(self._rate[:2])), abs(float(self._rate[2]))
        sigmas = _RATE_SIGMA + _RATE_SHARE * np.array([across, across, growth])
        return self._readout_s * np.column_stack([self._rate, np.diag(sigmas)])

    def _change(self, pose: Pose, outline: F64, moved: F64, origin: F64, *, is_round: bool) -> F64:
        """Return the changes of a pose's (dt, w) by motions (3, k), (6, k + 3).

        A least squares fit of the pose to the shifted outline gives the first k columns. The last
        three are position errors for what that linear model leaves out.

        Args:
            pose: of the marker.
            outline: points on its own axes (north, east), m, (n, 2).
            moved: motions of one sigma each, see `_moved`.
            origin: of the pad, camera frame, m, (3,).
            is_round: whether the outline is made of circles.
        """
        J = ray_derivative(outline, pose)
        rays = pose.rays(outline)
        fixed = origin if origin[2] > MIN_DEPTH_M else pose.t
        about = rays - fixed[:2] / fixed[2]
        below = about[:, 1] * self._per_ray
        shift = below[:, None, None] * (moved[:2] + about[..., None] * moved[2])  # (n, 2, k)
        if is_round:
            # A circle shows only shifts across its outline.
            onwards = outline + _ALONG * outline[:, ::-1] * (-1.0, 1.0)
            along = pose.rays(onwards) - rays
            across = np.column_stack([-along[:, 1], along[:, 0]])
            across /= np.linalg.norm(across, axis=1)[:, None]
            J = (across[:, :, None] * J.reshape(-1, 2, 6)).sum(axis=1)
            shift = (across[:, :, None] * shift).sum(axis=1)
        H = J.T @ J
        # Near frontal view the image changes with the square of a tilt, so that a small shear does
        # not need the large tilt of the linear model. A circle's turn about its axis changes
        # nothing, and would leave the equations singular.
        size = float(np.square(rays - rays.mean(axis=0)).sum())
        shear = float(np.linalg.norm(moved[:2])) * self._per_ray
        H[3:, 3:] += size * max(_FRONTAL * shear, 1e-6) * np.eye(3)
        change = solved(H, J.T @ shift.reshape(len(J), -1))
        # Second-order errors may have any direction.
        rest = np.zeros((6, 3))
        rest[:3] = _REST * float(np.linalg.norm(change[:3])) * np.eye(3)
        return np.hstack([change, rest])
