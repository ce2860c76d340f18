"""Fits a marker's pose to the places of its edges by least squares, in place of vision's fits.

A picture shows only an edge's place across itself. With a contrast A, a blur s and noise sigma, the
variance of that place is 2 sqrt(pi) s (sigma / A)^2 for each pixel of the edge's length (the
Cramér-Rao bound, see `bench.vision_ring`).
"""

from dataclasses import dataclass

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.simulation.sight.edges import Edges
from landerd.vision.pose import Pose

_STEPS = 4  # largest number of Gauss-Newton steps
_CONVERGED = 0.5  # reduction of chi-square by the last step: a further one is far smaller
# Sigmas of rotations by which steps are damped, and which are assumed beforehand, as in `ring_fit`.
_TILT_STEP, _TILT_SIGMA = 0.2, 1.0  # rad
# The last three elements of the diagonal of a flattened (6, 6); index arrays take ten times longer.
_TILTS = slice(21, None, 7)
_FREE = 1e-6  # information on rotations that nothing shows, as a ring's about its normal, 1/rad^2


@dataclass(frozen=True, slots=True)
class SeenEdges:
    """The edges of a marker as they are seen in a picture."""

    edges: Edges
    rays: F64  # on which the pieces' middles are seen, on z = 1, (n, 2)
    focal: float  # focal length, px


@dataclass(frozen=True, slots=True)
class Across:
    """Edges in the image under a pose."""

    normal: F64  # unit vectors across the edges, (n, 2)
    length_px: F64  # of the pieces, (n,)
    ray: F64  # of their middles, on z = 1, (n, 2)
    J: F64  # derivatives of their places across the edges, px, by (dt, w), (n, 6)


def across(edges: Edges, pose: Pose, focal: float) -> Across:
    """Return edges in the image under a pose, for a focal length in px."""
    arm = edges.points @ pose.R[:, :2].T
    way = edges.along @ pose.R[:, :2].T
    p = arm + pose.t
    inverse_z = 1.0 / p[:, 2]
    ray = p[:, :2] * inverse_z[:, None]
    d = way[:, :2] - ray * way[:, 2:]
    size = np.sqrt(d[:, 0] ** 2 + d[:, 1] ** 2)
    normal = np.empty_like(d)
    normal[:, 0], normal[:, 1] = -d[:, 1] / size, d[:, 0] / size
    g = np.empty_like(p)
    k = focal * inverse_z
    g[:, :2] = normal * k[:, None]
    g[:, 2] = -_dots(normal, ray) * k
    J = np.empty((len(p), 6))
    J[:, :3] = g
    J[:, 3] = arm[:, 1] * g[:, 2] - arm[:, 2] * g[:, 1]
    J[:, 4] = arm[:, 2] * g[:, 0] - arm[:, 0] * g[:, 2]
    J[:, 5] = arm[:, 0] * g[:, 1] - arm[:, 1] * g[:, 0]
    return Across(normal, edges.length_m * size * k, ray, J)


def fitted(
    seen: SeenEdges, start: Pose, offset_px: F64, weight: F64, lie: Across | None = None
) -> Pose | None:
    """Return the pose near a start that explains the edges; None: it does not converge.

    Args:
        seen: the edges in the picture.
        start: pose to start from.
        offset_px: errors of the edges' places across them, (n,), added to those of `seen`.
        weight: inverse variances of the places, 1/px^2, (n,).
        lie: the edges in the image under the start; None: they are computed.
    """
    pose, cost = start, 0.0
    information = np.zeros((6, 6))
    for i in range(_STEPS):
        lie = lie if lie and i == 0 else across(seen.edges, pose, seen.focal)
        residual = seen.focal * _dots(seen.rays - lie.ray, lie.normal) + offset_px
        weighted = lie.J.T * weight
        information = weighted @ lie.J
        gradient = weighted @ residual
        cost = float(weight @ (residual * residual))
        damped = information.copy()
        damped.reshape(-1)[_TILTS] += _FREE + 1.0 / _TILT_STEP**2 * (i < _STEPS - 1)
        solved = cv2.solve(damped, gradient[:, None], flags=cv2.DECOMP_CHOLESKY)[1]
        step = np.asarray(solved, dtype=np.float64)[:, 0]
        pose = pose.moved(step)
        reduction = float(gradient @ step)
        if not np.isfinite(step).all() or pose.t[2] <= 0.0 or pose.normal @ pose.t <= 0.0:
            return None
        cost -= reduction
        if reduction < _CONVERGED:
            break
    information.reshape(-1)[_TILTS] += _FREE + 1.0 / _TILT_SIGMA**2
    return Pose(pose.R, pose.t, information, max(cost, 0.0))


def _dots(a: F64, b: F64) -> F64:
    """Return the scalar products (n,) of rows (n, 2), in half the time of numpy's sum."""
    products: F64 = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]
    return products
