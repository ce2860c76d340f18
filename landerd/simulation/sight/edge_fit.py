"""A marker's pose by least squares on the places of its edges, as vision has them.

Of an edge a picture tells only where it lies across: with contrast A between levels, blur s and
noise sigma, each pixel length of it to a variance of 2 sqrt(pi) s (sigma / A)^2 (the Cramér-Rao
bound, see `bench.vision_ring`).
"""

from dataclasses import dataclass

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.simulation.sight.edges import Edges
from landerd.vision.pose import Pose

_STEPS = 4
_CONVERGED = 0.5  # reduction of chi-square by a step: the next one is far smaller
_TILT_STEP, _TILT_SIGMA = 0.2, 1.0  # rad: as `ring_fit` damps steps, and knows tilts
_TILTS = slice(
    21, None, 7
)  # the last three of a diagonal (6, 6); by indices it takes ten times as long
_FREE = 1e-6  # 1/rad^2: what nothing tells (a ring's turn) is held by so much


@dataclass(frozen=True, slots=True)
class SeenEdges:
    """The pieces of a print that a picture shows."""

    edges: Edges
    rays: F64  # (n, 2) where their middles are seen, on z = 1
    focal: float  # px


@dataclass(frozen=True, slots=True)
class Across:
    """Edges under a pose: how they lie in the image."""

    normal: F64  # (n, 2) unit, across the edge
    length_px: F64  # (n,)
    ray: F64  # (n, 2) of their middles
    J: F64  # (n, 6) px across the edge by (dt, w)


def across(edges: Edges, pose: Pose, focal: float) -> Across:
    """Return how edges lie in the image under a pose."""
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
        seen: what the picture shows.
        start: where to begin.
        offset_px: (n,) how far beside their place edges are seen, across.
        weight: (n,) inverse variances, 1/px^2.
        lie: how they lie from the start, if that is known.
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
    """Return the scalar products (n,) of rows (n, 2); numpy's sum over two takes twice as long."""
    products: F64 = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]
    return products
