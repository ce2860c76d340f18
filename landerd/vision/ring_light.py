"""Finds a straight edge of a shadow across a ring, and removes it from the pixels to be fitted.

`ring_fit_stages.hard_fits` tries a fit to such pixels where the plain one is poor.
"""

from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64
from landerd.pad import Ring
from landerd.vision.arrays import Mask
from landerd.vision.edge_profile import SIGMA_PER_MAD
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_pixels import Pixels, PlaneView, blurred_step, pose_axes

_CLEAR_PX = 0.7  # a pixel is all white if it is farther than this plus the blur from an edge, px
_MIN_WHITE = 16  # least number of white pixels
_LEVEL_PERCENTILES = (4, 96)  # percentiles of the white from which its two levels are looked for
_LEVEL_ROUNDS = 5  # rounds of looking for the two levels
_MIN_SHARE = 0.03  # least share of the white on either side of the edge
_MAX_LIGHT = 0.88  # largest light in a shadow over that beside it
_MIN_PARTED = 0.9  # least share of the white that is on the right side of the straight edge
_PROBIT = 1.0 / 1.7  # from the logistic function's argument to that of the normal distribution's
_SOFT_ROUNDS = 6  # Gauss-Newton steps on levels and edge
_LINE_DAMPING = 0.1  # damping of the steps of the edge's line, as information on each parameter
# An edge is sharp if the sigma of its penumbra is below the first times the blur plus the second,
# px. Pixels within the third of a sharp edge, px, are left out.
_SOFT_BLURS, _SOFT_PX = 2.0, 0.7
_PENUMBRA_PX = 2.5
_MAX_MOVED_PX = 0.3  # pixels that must be moved by more, px, are left out: the model is first-order
_MIN_COUNT = 30  # least number of pixels left: a fit has 12 to 14 parameters


@dataclass(frozen=True)
class _Shadow:
    """A shadow with a straight edge, across which light changes like a blurred step.

    Features of a pixel are (1, x, y): the distance of its ray from the centre's, in radii of
    the ring at the centre's depth.
    """

    low: float  # grey level of white in the shadow
    high: float  # grey level of white beside it
    # Weights (3,) of the features. The weighted sum is the distance from the edge, in sigmas of the
    # penumbra, negative in the shadow.
    line: F64

    def light(self, features: F64) -> tuple[F64, F64]:
        """Return light over that beside the shadow, and its derivative by the line's value.

        Both are (n,); features are (n, 3).
        """
        cdf, density = blurred_step((features @ self.line).astype(np.float32))
        fall = 1.0 - self.low / self.high
        return 1.0 - fall * (1.0 - cdf.astype(np.float64)), fall * density.astype(np.float64)


def evenly_lit(pixels: Pixels, fit: RingFit, ring: Ring) -> Pixels | None:
    """Return the pixels as they would be without a shadow's straight edge; None: there is none.

    The white inside and around the ring is split into bright and dim. The straight line between
    them is the edge, which may be soft. Grey levels are divided by the share of light that is left.
    Where light changes within the blur, a pixel also shows the print a little farther towards the
    light, and its ray is moved there: of light L, a print and a Gaussian blur of variance v, the
    image at x is L times the blurred print at x + v grad(log L), to first order in grad L.

    Args:
        pixels: near the ring's edges, with enough white beside them.
        fit: the first fit of the ring to them, which says what is white.
        ring: its true size and ratio.
    """
    radius = ring.radius_m
    white = _white(pixels, fit, ring)
    if np.count_nonzero(white) < _MIN_WHITE:
        return None
    levels = _two_levels(pixels.grey[white].astype(np.float64))
    if levels is None:
        return None
    low, high, bright = levels
    # In units of the radius, so that the three features are of similar size.
    k = fit.position[2] / radius
    x, y = (k * (pixels.rays[i] - fit.position[i] / fit.position[2]) for i in (0, 1))
    features = np.stack([np.ones_like(x), x, y], axis=1).astype(np.float64)
    line = _parting_line(features[white], bright)
    if ((features[white] @ line > 0.0) == bright).mean() < _MIN_PARTED or not low > 0.0:
        return None
    grey = pixels.grey[white].astype(np.float64)
    shadow = _softened(features[white], grey, _Shadow(low, high, _PROBIT * line))
    return None if shadow is None else _undone(pixels, shadow, features, k, fit.blur_px)


def _undone(
    pixels: Pixels, shadow: _Shadow, features: F64, k: float, blur_px: float
) -> Pixels | None:
    """Return the pixels without the shadow; None: too few are left.

    Args:
        pixels: near the ring's edges.
        shadow: across them.
        features: of the pixels, (n, 3), see `_Shadow`.
        k: change of a feature per unit of a ray on z = 1.
        blur_px: sigma of the ring's blur.
    """
    light, slope = shadow.light(features)
    per_px = k / pixels.focal * shadow.line[1:]  # of the line's value
    sharpness = float(np.hypot(*per_px))
    if not (sharpness > 0.0 and np.isfinite(light).all()):
        return None
    moved = blur_px**2 * (slope / light)[:, None] * per_px
    kept = np.hypot(moved[:, 0], moved[:, 1]) < _MAX_MOVED_PX
    if 1.0 / sharpness < _SOFT_BLURS * blur_px + _SOFT_PX:
        kept &= np.abs(features @ shadow.line) / sharpness > _PENUMBRA_PX
    rays = pixels.rays.copy()
    rays[:2] += (moved / pixels.focal).T.astype(np.float32)
    # Dividing by the light also raises the noise.
    light32 = light.astype(np.float32)
    weight = pixels.weight * light32**2 * kept
    if np.count_nonzero(weight) < _MIN_COUNT:
        return None
    grey = pixels.grey / light32
    return Pixels(rays, grey, weight, pixels.supersample, pixels.focal, pixels.is_clipped)


def _softened(features: F64, grey: F64, shadow: _Shadow) -> _Shadow | None:
    """Return a shadow whose levels and edge are fitted to the white pixels; None: it is none.

    Args:
        features: of the white pixels, (n, 3), see `_Shadow`.
        grey: their grey levels, (n,).
        shadow: to start from.
    """
    for _ in range(_SOFT_ROUNDS):
        light, slope = shadow.light(features)
        residual = grey - shadow.high * light
        fall = shadow.high - shadow.low
        share = (light - shadow.low / shadow.high) * shadow.high / fall  # of the way to high
        J = np.column_stack([1.0 - share, share, shadow.high * slope[:, None] * features])
        noise = max(1.0, SIGMA_PER_MAD * float(np.median(np.abs(residual))))
        weight = 1.0 / (1.0 + (residual / (3.0 * noise)) ** 2) ** 2
        H = (J * weight[:, None]).T @ J
        # Pixels do not determine the slope of an edge that is sharper than their spacing.
        H[2:, 2:] += _LINE_DAMPING * noise**2 * np.eye(3)
        H[:2, :2] += 1e-3 * np.eye(2)
        step = np.linalg.solve(H, J.T @ (weight * residual))
        low, high = shadow.low + float(step[0]), shadow.high + float(step[1])
        shadow = _Shadow(low, high, shadow.line + step[2:])
        if not 0.0 < low < _MAX_LIGHT * high:
            return None
    return shadow


def _white(pixels: Pixels, fit: RingFit, ring: Ring) -> Mask:
    """Tell which pixels (n,) are all white if the ring lies as fitted."""
    g = PlaneView(pixels.rays, pixels.focal, *pose_axes((fit.position, fit.normal)))
    radii = (ring.radius_m, ring.radius_m * ring.inner_ratio)
    d_o, d_i = ((g.rho[0] - r) / g.scale[0] for r in radii)
    clear = fit.blur_px + _CLEAR_PX
    white: Mask = (d_o > clear) | (d_i < -clear)
    return white


def _two_levels(grey: F64) -> tuple[float, float, Mask] | None:
    """Return the two values about which grey levels (n,) lie, the lower first, and which are high.

    None: they lie about one value.
    """
    low, high = np.percentile(grey, _LEVEL_PERCENTILES)
    for _ in range(_LEVEL_ROUNDS):
        bright: Mask = grey > (low + high) / 2.0
        if not _MIN_SHARE < bright.mean() < 1.0 - _MIN_SHARE:
            return None
        low, high = grey[~bright].mean(), grey[bright].mean()
    return None if low > _MAX_LIGHT * high else (low, high, bright)


def _parting_line(features: F64, bright: Mask) -> F64:
    """Return the weights (3,) of features (n, 3) whose sum is positive where it is bright (n,).

    They are those of a logistic regression.
    """
    weights = np.zeros(3)
    for _ in range(6):
        p = 1.0 / (1.0 + np.exp(-np.clip(features @ weights, -30.0, 30.0)))
        H = (features * (p * (1.0 - p) + 1e-3)[:, None]).T @ features + 1e-2 * np.eye(3)
        weights = weights + np.linalg.solve(H, features.T @ (bright - p) - 1e-2 * weights)
    return weights
