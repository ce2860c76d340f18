"""Edges from black to white on lines across them, and how well a fit explains where they are.

Of rings and of squares alike: a line has its own black and white, so that light does not matter.
"""

import numpy as np

from landerd.camera_model import F64
from landerd.vision.arrays import Mask

ROBUST_SIGMAS = 3.0  # an edge that is farther off counts less (Geman and McClure)
SIGMA_PER_MAD = 1.4826  # of a normal distribution: sigma over median absolute deviation
_LEAST_STEP = 6.0  # grey levels between black and white beside an edge
# Over the white beside it: behind gamma a faded print's is two thirds, more where white is clipped.
_MOST_BLACK, _MOST_BLACK_CLIPPED = 0.8, 0.92
_CLIPPED = 240.0  # grey level


def crossing(grey: F64, middle: F64, along: F64) -> tuple[F64, F64, Mask]:
    """Return where lines rise through a level nearest to their middle, by how much, and whether.

    Args:
        grey: levels (n, samples, ...), lightly smoothed here.
        middle: level of each line, (n, ...).
        along: where the samples are, (samples,).

    Returns:
        place, rise from one sample to the next in grey levels, and whether there is one, (n, ...).
    """
    smooth = grey.copy()
    smooth[:, 1:-1] = 0.25 * (grey[:, :-2] + grey[:, 2:]) + 0.5 * grey[:, 1:-1]
    above = smooth >= middle[:, None]
    rises = ~above[:, :-1] & above[:, 1:]
    step = np.maximum(smooth[:, 1:] - smooth[:, :-1], 1e-6)
    share = np.clip((middle[:, None] - smooth[:, :-1]) / step, 0.0, 1.0)
    starts = along[:-1].reshape(-1, *[1] * (grey.ndim - 2))
    at = starts + share * (along[1] - along[0])
    off = np.where(rises, np.abs(at), np.inf)
    nearest = off.argmin(axis=1)[:, None]
    found, rise, least = (np.take_along_axis(a, nearest, axis=1)[:, 0] for a in (at, step, off))
    return found, rise, np.isfinite(least)


def medians(values: F64) -> F64:
    """Return the medians of rows (n, samples), (n,). A tenth of the time of numpy's own."""
    ordered = np.sort(values, axis=1)
    n = values.shape[1]
    middle: F64 = 0.5 * (ordered[:, (n - 1) // 2] + ordered[:, n // 2])
    return middle


def is_step(black: F64, white: F64, most_black: float = _MOST_BLACK) -> Mask:
    """Tell where black beside white is as print and light make it.

    Args:
        black: levels beside edges, and
        white: on their other side.
        most_black: of black, over white that is not clipped.
    """
    most = np.where(white < _CLIPPED, most_black, _MOST_BLACK_CLIPPED) * white
    step: Mask = (white - black > _LEAST_STEP) & (black < most)
    return step


def edge_cost(residual: F64, noise_px: float, dependence: float) -> float:
    """Return the robust sum of squared residuals over the noise of independent edges.

    Args:
        residual: px, (n,); NaN where no edge is seen.
        noise_px: of edges.
        dependence: how many times fewer edges are independent.
    """
    u = (residual / (ROBUST_SIGMAS * noise_px)) ** 2
    robust = np.where(np.isnan(u), 1.0, u / (1.0 + u))
    return ROBUST_SIGMAS**2 * float(robust.sum()) / dependence
