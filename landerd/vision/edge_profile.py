"""Edges between black and white, measured on lines across them, and the cost of a fit to them.

Rings, plates and printed codes use it alike. Each line is compared with the black and the white at
its own ends, so that the light need not be even.
"""

import numpy as np

from landerd.camera_model import F64
from landerd.vision.arrays import Mask

ROBUST_SIGMAS = 3.0  # residuals count less from about this on (Geman and McClure)
SIGMA_PER_MAD = 1.4826  # of a normal distribution: sigma over median absolute deviation
_LEAST_STEP = 6.0  # least difference of white and black beside an edge, grey levels
# Largest black over the white beside it, and the same if that white is clipped: a faded print's
# black is two thirds of its white after gamma, and more of a clipped white.
_MOST_BLACK, _MOST_BLACK_CLIPPED = 0.8, 0.92
_CLIPPED = 240.0  # grey level from which on white counts as clipped


def crossing(grey: F64, middle: F64, along: F64) -> tuple[F64, F64, Mask]:
    """Return the place of the edge on each line: where grey rises through the line's own level.

    If grey does so several times, the place nearest to `along` = 0 counts, where the edge is
    expected.

    Args:
        grey: grey levels on the lines, from black to white, (n, samples, ...); they are lightly
            smoothed here.
        middle: level to be crossed by each line, (n, ...).
        along: evenly spaced coordinates of the samples along a line, (samples,).

    Returns:
        place, in the unit of `along`; rise there in grey levels per sample; whether there is such a
        place. Each is (n, ...).
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
    """Return the medians (n,) of rows (n, samples), in a tenth of the time of numpy's own."""
    ordered = np.sort(values, axis=1)
    n = values.shape[1]
    middle: F64 = 0.5 * (ordered[:, (n - 1) // 2] + ordered[:, n // 2])
    return middle


def is_step(black: F64, white: F64, most_black: float = _MOST_BLACK) -> Mask:
    """Tell at which edges the contrast of black and white is enough for a print.

    Args:
        black: grey levels on the black side of edges, any shape.
        white: grey levels on their white side, same shape.
        most_black: largest black over a white that is not clipped.
    """
    most = np.where(white < _CLIPPED, most_black, _MOST_BLACK_CLIPPED) * white
    step: Mask = (white - black > _LEAST_STEP) & (black < most)
    return step


def edge_cost(residual: F64, noise_px: float, dependence: float) -> float:
    """Return the robust chi-square of a fit to edges (Geman and McClure).

    An edge that is not seen counts as much as an outlier.

    Args:
        residual: px, (n,); NaN where no edge is seen.
        noise_px: sigma of a residual, px.
        dependence: number of edges over that of independent ones.
    """
    u = (residual / (ROBUST_SIGMAS * noise_px)) ** 2
    robust = np.where(np.isnan(u), 1.0, u / (1.0 + u))
    return ROBUST_SIGMAS**2 * float(robust.sum()) / dependence
