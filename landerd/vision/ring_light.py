"""A shadow's edge across a ring: find it in the white, and undo it."""

import numpy as np
from numpy.typing import NDArray

from landerd.pad import Ring
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_pixels import Pixels, PlaneView, plane_axes
from landerd.vision.ring_pose import F64

Mask = NDArray[np.bool_]

_CLEAR_PX = 0.7  # beyond the blur: pixels that are all white or all black
_MIN_WHITE = 16  # pixels
_LEVEL_PERCENTILES = (4, 96)  # percentiles of the white from which its two levels are looked for
_LEVEL_ROUNDS = 5
_MIN_SHARE = 0.03  # of the white on either side of the edge
_MAX_LIGHT = 0.88  # light in the shadow over light beside it: above, it is no shadow
_MIN_PARTED = 0.9  # share of the white that one straight line parts into bright and dim
_PENUMBRA_PX = 2.5  # from the edge to either side: pixels there are left out
_MIN_COUNT = 30  # pixels that are left: a fit has 12 to 14 parameters


def evenly_lit(pixels: Pixels, fit: RingFit, ring: Ring) -> Pixels | None:
    """Return the pixels as if a straight shadow edge were not there; None if there is none.

    The white inside and around the ring, as a first fit has it, is split into bright and dim; the
    line that parts them is the edge. Pixels beyond it are divided by the loss of light.
    """
    radius = ring.radius_m
    white = _white(pixels, fit, ring)
    if np.count_nonzero(white) < _MIN_WHITE:
        return None
    levels = _two_levels(pixels.grey[white].astype(np.float64))
    if levels is None:
        return None
    low, high, bright = levels
    # In units of the radius, so that the three features are alike in size.
    k = fit.position[2] / radius
    x, y = (k * (pixels.rays[i] - fit.position[i] / fit.position[2]) for i in (0, 1))
    features = np.stack([np.ones_like(x), x, y], axis=1).astype(np.float64)
    line = _parting_line(features[white], bright)
    if ((features[white] @ line > 0.0) == bright).mean() < _MIN_PARTED:
        return None
    side = features @ line
    slope = float(np.hypot(line[1], line[2]))
    if not slope > 0.0 or not low > 0.0:
        return None
    away_px = np.abs(side) / slope * pixels.focal / k
    light = np.where(side > 0.0, 1.0, low / high).astype(np.float32)
    # Noise grows as the grey levels do.
    weight = pixels.weight * light**2 * (away_px > _PENUMBRA_PX)
    if np.count_nonzero(weight) < _MIN_COUNT:
        return None
    return Pixels(pixels.rays, pixels.grey / light, weight, pixels.supersample, pixels.focal)


def _white(pixels: Pixels, fit: RingFit, ring: Ring) -> Mask:
    """Tell which pixels (n,) are all white."""
    g = PlaneView(pixels.rays, pixels.focal, *plane_axes(fit.position[None], fit.normal[None]))
    radii = (ring.radius_m, ring.radius_m * ring.inner_ratio)
    d_o, d_i = ((g.rho[0] - r) / g.scale[0] for r in radii)
    clear = fit.blur_px + _CLEAR_PX
    white: Mask = (d_o > clear) | (d_i < -clear)
    return white


def _two_levels(grey: F64) -> tuple[float, float, Mask] | None:
    """Return the two grey levels about which levels (n,) lie, and which are of the higher one.

    None, if there is but one.
    """
    low, high = np.percentile(grey, _LEVEL_PERCENTILES)
    for _ in range(_LEVEL_ROUNDS):
        bright: Mask = grey > (low + high) / 2.0
        if not _MIN_SHARE < bright.mean() < 1.0 - _MIN_SHARE:
            return None
        low, high = grey[~bright].mean(), grey[bright].mean()
    return None if low > _MAX_LIGHT * high else (low, high, bright)


def _parting_line(features: F64, bright: Mask) -> F64:
    """Return weights (3,) of a logistic regression: positive where it is bright."""
    weights = np.zeros(3)
    for _ in range(6):
        p = 1.0 / (1.0 + np.exp(-np.clip(features @ weights, -30.0, 30.0)))
        H = (features * (p * (1.0 - p) + 1e-3)[:, None]).T @ features + 1e-2 * np.eye(3)
        weights = weights + np.linalg.solve(H, features.T @ (bright - p) - 1e-2 * weights)
    return weights
