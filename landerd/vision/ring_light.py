"""A shadow's edge across a ring: find it in the white, and undo it."""

import numpy as np

from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_pixels import Pixels, PlaneView, plane_axes
from landerd.vision.ring_pose import F64

_CLEAR_PX = 0.7  # beyond the blur: pixels that are all white or all black
_LEAST_STEP = 0.88  # light in the shadow over light beside it: above, it is no shadow
_PENUMBRA_PX = 2.5


def evenly_lit(pixels: Pixels, fit: RingFit, radius: float, ratio: float) -> Pixels | None:
    """Return the pixels as if a straight shadow edge were not there; None if there is none.

    The white inside and around the ring, as a first fit has it, is split into bright and dim; the
    line that parts them is the edge. Pixels beyond it are divided by the loss of light.
    """
    g = PlaneView(pixels.rays, pixels.focal, *plane_axes(fit.position[None], fit.normal[None]))
    d_o, d_i = ((g.rho[0] - r) / g.scale[0] for r in (radius, radius * ratio))
    clear = fit.blur_px + _CLEAR_PX
    white = (d_o > clear) | (d_i < -clear)
    if np.count_nonzero(white) < 16:
        return None
    grey = pixels.grey[white].astype(np.float64)
    low, high = np.percentile(grey, (4, 96))
    for _ in range(5):
        bright = grey > (low + high) / 2.0
        if not 0.03 < bright.mean() < 0.97:
            return None
        low, high = grey[~bright].mean(), grey[bright].mean()
    if low > _LEAST_STEP * high:
        return None
    # In units of the radius, so that the three features are alike in size.
    k = fit.position[2] / radius
    x, y = (k * (pixels.rays[i] - fit.position[i] / fit.position[2]) for i in (0, 1))
    features = np.stack([np.ones_like(x), x, y], axis=1).astype(np.float64)
    line = _parting_line(features[white], bright)
    if ((features[white] @ line > 0.0) == bright).mean() < 0.9:
        return None
    side = features @ line
    away_px = np.abs(side) / np.hypot(line[1], line[2]) * pixels.focal / k
    light = np.where(side > 0.0, 1.0, low / high).astype(np.float32)
    # Noise grows as the grey levels do.
    weight = pixels.weight * light**2 * (away_px > _PENUMBRA_PX)
    if np.count_nonzero(weight) < 30:
        return None
    return Pixels(pixels.rays, pixels.grey / light, weight, pixels.supersample, pixels.focal)


def _parting_line(features: F64, bright: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> F64:
    """Return weights (3,) of a logistic regression: positive where it is bright."""
    weights = np.zeros(3)
    for _ in range(6):
        p = 1.0 / (1.0 + np.exp(-np.clip(features @ weights, -30.0, 30.0)))
        H = (features * (p * (1.0 - p) + 1e-3)[:, None]).T @ features + 1e-2 * np.eye(3)
        weights = weights + np.linalg.solve(H, features.T @ (bright - p) - 1e-2 * weights)
    return weights
