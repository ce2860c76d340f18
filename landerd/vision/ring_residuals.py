"""Whether the residuals of a ring's fit are noise, or have something in common among neighbours.

`ring_checks` limits the common part: tone curves, shadows and texture leave one, noise does not.
"""

import math

import numpy as np

from landerd.pad import Ring
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_pixels import Pixels, PlaneView, pose_axes, sectors

_SECTORS = 12
_BIN_PX, _BINS = 1.0, 8  # width and number of bins across an edge
_GROUPS = 2 * _BINS * _SECTORS


def coherent_residual(pixels: Pixels, fit: RingFit, ring: Ring) -> float:
    """Return the sigma of what residuals of neighbours have in common, over the contrast.

    Neighbours are pixels as far from the same edge, in one sector of the ring. Products of
    different pixels' residuals hold no noise, however loud it is and wherever it grows: tone
    curves, shadows and texture stay.
    """
    view = PlaneView(pixels.rays, pixels.focal, *pose_axes((fit.position, fit.normal)))
    to_outer, to_inner = (
        (view.rho[0] - radius) / view.scale[0]
        for radius in (ring.radius_m, ring.radius_m * ring.inner_ratio)
    )
    is_outer = np.abs(to_outer) < np.abs(to_inner)
    distance = np.where(is_outer, to_outer, to_inner)
    across = np.minimum(np.maximum(np.floor(distance / _BIN_PX) + _BINS // 2, 0), _BINS - 1)
    sector = sectors(view.u[0, 0], view.u[0, 1], _SECTORS)
    group = (is_outer * _BINS + across.astype(np.intp)) * _SECTORS + sector
    residual = fit.residual
    assert residual is not None
    if fit.is_told is not None:
        group, residual = group[fit.is_told], residual[fit.is_told]
    total = np.bincount(group, residual, _GROUPS)
    squares = np.bincount(group, residual * residual, _GROUPS)
    count = np.bincount(group, minlength=_GROUPS)
    pairs = float((count * (count - 1)).sum())
    variance = float((total * total - squares).sum()) / max(pairs, 1.0)
    return math.sqrt(max(variance, 0.0)) / max(fit.contrast, 1.0)
