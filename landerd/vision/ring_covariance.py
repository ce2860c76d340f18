"""How sure a ring's fit is where what the model leaves out is alike from pixel to pixel.

Least squares take residuals for independent. Glare, a soft shadow or dirt lift or lower the grey of
a whole side, and such errors do not average out. Summed over sectors round the ring, what each
would move the fit by is independent again from sector to sector: the clustered ("sandwich")
covariance of Liang and Zeger, Biometrika 1986.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.vision.arrays import F32
from landerd.vision.linear import eigen
from landerd.vision.ring_model import CENTRE, RATIO, TILT
from landerd.vision.ring_pixels import sectors

_SECTORS = 12  # with 24 a glare spot covers several, with fewer five numbers could not be told
_FITTED = 5  # numbers that the sectors' own pulls were used for
_POSE = slice(CENTRE.start, TILT.stop)
# A tilt so many sigmas from the line of sight is no frontal view: with this the stated sigmas of
# nearly frontal views are as large as their errors.
_DISTINCT_TILT_SIGMAS = 7.0
# Of the path that the image moved during the exposure: what of it no straight even motion explains.
_PATH_BIAS = 0.001


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
        C: (rows, rows), inverse of the information times noise^2, in `RingModel`'s order.
        scale: of the variance, from the residuals.
        plane: centre (3,), m, and the axes (3, 3) of the ring's plane, a row each.
        derivative: (rows - 1, n), of grey levels: the ratio, which the fit held, is left out.
        weighted: (n,), residuals times their weights.
        rays: (2, n), of the pixels, z = 1.
        shift: what else adds to that of the position: an unexplained shift of both edges, motion.
    """
    t, axes = plane
    gain = C[_POSE, 1:] - np.outer(C[_POSE, RATIO], C[RATIO, 1:] / C[RATIO, RATIO])
    directions = rays - (t[:2] / t[2])[:, None]
    covariance = clustered_covariance(
        scale * gain[:, :_FITTED], gain, derivative * weighted, directions
    )
    e = axes.astype(np.float64)
    covariance += frontal_inflation(covariance, e @ t / np.linalg.norm(t))
    sigma_tilt = math.sqrt(max(0.0, float(np.trace(covariance[3:, 3:])) / 2.0))
    return e.T @ covariance[:3, :3] @ e + shift(), sigma_tilt


def clustered_covariance(
    independent: F64, gain: F64, scores: NDArray[np.floating], directions: NDArray[np.floating]
) -> F64:
    """Return the covariance (5, 5) of centre and tilt, nowhere less than for independent errors.

    Args:
        independent: (5, 5), as residuals without correlation give it.
        gain: (5, rows), of centre and tilt by the normal equations' right side.
        scores: (rows, n), what each pixel adds to that right side.
        directions: (2, n), from the ring's centre to the pixels.
    """
    is_in = sectors(directions[0], directions[1], _SECTORS)[:, None] == np.arange(_SECTORS)
    used = int(is_in.any(axis=0).sum())
    pulls = gain @ (scores @ is_in)
    clustered = (pulls @ pulls.T) * (used / max(used - _FITTED, 1))
    variances = independent.diagonal()
    if not variances.min() > 0.0:
        return independent
    sigmas = np.sqrt(variances)
    unit = sigmas[:, None] * sigmas  # metres and radians are of different size
    values, axes = eigen(independent / unit)
    if not values.min() > 0.0:
        return independent
    # Of errors of one sigma each along the axes, and what clusters make of them.
    scale = np.sqrt(values)
    to_one = (axes / scale).T
    grown, ways = eigen(to_one @ (clustered / unit) @ to_one.T)
    widened = (axes * scale) @ (ways * np.sqrt(np.maximum(grown, 1.0)))
    covariance: F64 = unit * (widened @ widened.T)
    return covariance


def shift_covariance(position: F64, ratio: float, off: float, sigma: float) -> F64:
    """Return what an unexplained shift of both edges adds to a position's covariance (3, 3), m^2.

    A mild tone curve, denoising or another blur than the model's moves both edges into the black,
    or out of it. The ratio as the pixels have it is off by that, and so is the range: of the radii
    R and k R, weighted by their length, one less and one more by d make a least squares scale that
    is d / R (1 - k^2) / (1 + k^3) off, and a ratio that is d / R (1 + k) off.

    Args:
        position: of the ring's centre, camera frame, m, (3,).
        ratio: the ring's true one, k.
        off: by which the pixels' ratio differs.
        sigma: of that; so much of it is noise.
    """
    share = (1.0 - ratio) / (1.0 + ratio**3)
    return np.outer(position, position) * (share * share * max(0.0, off * off - sigma * sigma))


def motion_covariance(position: F64, radius: float, path: float) -> F64:
    """Return what motion during the exposure adds to a position's covariance (3, 3), m^2.

    Args:
        position: of the ring's centre, camera frame, m, (3,).
        radius: of the ring, m.
        path: of the image, rad.
    """
    off = _PATH_BIAS * path
    distance = float(np.linalg.norm(position))
    along = np.outer(position, position) * (off * distance / radius) ** 2
    return along + np.eye(3) * (off * distance) ** 2


def frontal_inflation(covariance: F64, sight: F64) -> F64:
    """Return what is to be added to a covariance (5, 5) of centre and tilt near frontal view.

    There the image changes with the square of the angle to the line of sight (unit vector, on the
    plane's axes). If the true angle is zero, the error of the one that is found is twice what a
    linear model at that angle says.
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
    added: F64 = np.outer(moved, moved) * (share / variance)
    return added
