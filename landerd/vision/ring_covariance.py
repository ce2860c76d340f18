"""Covariance of a ring's fit if the residuals of neighbouring pixels are correlated.

Least squares assume independent residuals. But glare, a soft shadow or dirt make a whole side of
the ring brighter or darker, and such errors do not average out. The residuals' effects on the fit
are therefore summed over sectors round the ring, and the sums are taken to be independent: the
clustered ("sandwich") covariance of Liang and Zeger, Biometrika 1986.

`ring_fit` gives its fits this covariance; `frontal_inflation` also serves the fit to edges
(`ring_explained`) and the modelled sight of the simulation.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.vision.arrays import F32
from landerd.vision.linear import eigen, length, outer
from landerd.vision.ring_model import CENTRE, RATIO, TILT
from landerd.vision.ring_pixels import sectors

# Number of sectors: of 24 a spot of glare covers several, and fewer would not determine five
# parameters.
_SECTORS = 12
_FITTED = 5  # degrees of freedom that the fit takes from the sectors: centre and tilt
_POSE = slice(CENTRE.start, TILT.stop)  # centre and tilt in the order of `RingModel`
# Angle between normal and line of sight, in sigmas, from about which on a view is not frontal; with
# this value the stated sigmas of nearly frontal views are as large as their errors.
_DISTINCT_TILT_SIGMAS = 7.0
# Error that motion during the exposure leaves, over the path of the image: no motion is exactly
# straight and even.
_PATH_BIAS = 0.001
# Error from side to side that the shape of the blur leaves where white is clipped, px: no lens
# blurs evenly to all sides, and only the dark side of each edge is seen.
_CLIPPED_BIAS_PX = 0.01


def pose_uncertainty(
    C: F64,
    scale: float,
    plane: tuple[F64, F32],
    derivative: F32,
    weighted: NDArray[np.floating],
    rays: F32,
    shift: Callable[[], F64],
) -> tuple[F64, float]:
    """Return the covariance of a fit's position (3, 3), camera frame, m^2, and sigma of tilt, rad.

    Args:
        C: inverse of the matrix of the normal equations, (rows, rows), in `RingModel`'s order; the
            covariance of all parameters is `scale` times it.
        scale: variance of one residual, grey levels^2.
        plane: centre (3,) of the ring, camera frame, m, and the axes (3, 3) of its plane, one in
            each row.
        derivative: of grey levels by all parameters but the ratio, which the fit held fixed,
            (rows - 1, n).
        weighted: residuals times their weights, (n,).
        rays: of the pixels on z = 1, (2, n).
        shift: returns what to add to the covariance of the position, (3, 3), m^2, for an
            unexplained shift of both edges, for motion and for clipped white.
    """
    t, axes = plane
    gain = C[_POSE, 1:] - outer(C[_POSE, RATIO], C[RATIO, 1:] / C[RATIO, RATIO])
    directions = rays - (t[:2] / t[2])[:, None]
    covariance = clustered_covariance(
        scale * gain[:, :_FITTED], gain, derivative * weighted, directions
    )
    e = axes.astype(np.float64)
    covariance += frontal_inflation(covariance, e @ t / length(t))
    sigma_tilt = math.sqrt(max(0.0, (covariance.item(3, 3) + covariance.item(4, 4)) / 2.0))
    return e.T @ covariance[:3, :3] @ e + shift(), sigma_tilt


def clustered_covariance(
    independent: F64, gain: F64, scores: NDArray[np.floating], directions: NDArray[np.floating]
) -> F64:
    """Return the clustered covariance (5, 5) of centre and tilt, m and rad.

    In no direction is it smaller than for independent residuals.

    Args:
        independent: covariance for independent residuals, (5, 5).
        gain: derivative of centre and tilt by the right-hand side of the normal equations,
            (5, rows).
        scores: contribution of each pixel to that right-hand side, (rows, n).
        directions: from the ring's centre to the pixels in the image, (2, n).
    """
    is_in = sectors(directions[0], directions[1], _SECTORS)[:, None] == np.arange(_SECTORS)
    used = int(is_in.any(axis=0).sum())
    pulls = gain @ (scores @ is_in)
    clustered = (pulls @ pulls.T) * (used / max(used - _FITTED, 1))
    variances = independent.diagonal()
    if not variances.min() > 0.0:
        return independent
    sigmas = np.sqrt(variances)
    unit = sigmas[:, None] * sigmas  # of metres and radians, which differ in size
    values, axes = eigen(independent / unit)
    if not values.min() > 0.0:
        return independent
    # On axes on which independent residuals give unit variances, the clustered variances are raised
    # to 1 where they are smaller.
    scale = np.sqrt(values)
    to_one = (axes / scale).T
    grown, ways = eigen(to_one @ (clustered / unit) @ to_one.T)
    widened = (axes * scale) @ (ways * np.sqrt(np.maximum(grown, 1.0)))
    covariance: F64 = unit * (widened @ widened.T)
    return covariance


def shift_covariance(position: F64, ratio: float, off: float, sigma: float) -> F64:
    """Return what an unexplained shift of both edges adds to a position's covariance (3, 3), m^2.

    A mild tone curve, denoising or another blur than the model's shifts both edges into the black,
    or out of it. Then the ratio of the radii that the pixels show is wrong, and so is the range. If
    the radii R and k R change by d, one inwards and one outwards, a least squares fit to both,
    weighted by their length, has a scale that is wrong by d / R (1 - k^2) / (1 + k^3), and the
    ratio is wrong by d / R (1 + k).

    Args:
        position: of the ring's centre, camera frame, m, (3,).
        ratio: inner over outer radius of the true ring, k.
        off: error of the ratio that the pixels show.
        sigma: of that error if only noise causes it.
    """
    share = (1.0 - ratio) / (1.0 + ratio**3)
    return outer(position, position) * (share * share * max(0.0, off * off - sigma * sigma))


def motion_covariance(position: F64, radius: float, path: float) -> F64:
    """Return what motion during the exposure adds to a position's covariance (3, 3), m^2.

    Args:
        position: of the ring's centre, camera frame, m, (3,).
        radius: of the ring, m.
        path: of the ring's image during the exposure, rad.
    """
    off = _PATH_BIAS * path
    if off == 0.0:
        return np.zeros((3, 3))
    distance = length(position)
    along = outer(position, position) * (off * distance / radius) ** 2
    return along + np.eye(3) * (off * distance) ** 2


def clipped_covariance(position: F64, focal: float) -> F64:
    """Return what clipped white adds to a covariance of the position (3, 3), m^2.

    Args:
        position: of the ring's centre, camera frame, m, (3,).
        focal: focal length, px.
    """
    return np.eye(3) * (_CLIPPED_BIAS_PX / focal * length(position)) ** 2


def frontal_inflation(covariance: F64, sight: F64) -> F64:
    """Return what to add to a covariance (5, 5) of centre and tilt near frontal view.

    There the image changes with the square of the angle between normal and line of sight. If the
    true angle is zero, the error of the angle found is twice what a model linearised at that angle
    says.

    Args:
        covariance: of centre and tilt on the plane's axes, m and rad.
        sight: unit vector (3,) along the line of sight, on the plane's axes.
    """
    angle = math.hypot(sight[0], sight[1])
    way = np.zeros(5)
    way[3:] = sight[:2] / max(angle, 1e-9)
    moved = covariance @ way
    variance = float(way @ moved)
    if not variance > 0.0:
        return np.zeros((5, 5))
    sigmas_4 = (angle * angle / variance / _DISTINCT_TILT_SIGMAS**2) ** 2
    share = 3.0 * math.exp(-min(sigmas_4, 50.0))
    return outer(moved, moved) * (share / variance)
