"""The tone curve of a camera between a print's black and white.

Most cameras make pictures for people, so that grey levels are not proportional to light: pixels on
the edge between white paper and black ink become brighter than their mean. The curve is a cubic
that leaves black and white in place. Its two parameters cover gammas up to 2.4 and the S-curves
that cameras apply on top of them.

`print_fit` and `ring_response` fit the curve together with a pose.
"""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64

Real = TypeVar("Real", np.float32, np.float64)

TONES = 2  # number of a curve's parameters: how much it bulges, and how much it is S-shaped
LINEAR = np.zeros(TONES)  # parameters of a linear camera
TONE_SIGMA = 0.6  # of either parameter, before any picture
MAX_TONE = 1.2  # largest absolute value of either parameter
_MIN_SLOPE = 0.03  # least slope of a curve: it must rise everywhere


def toned(
    value: NDArray[Real], tone: NDArray[Real]
) -> tuple[NDArray[Real], NDArray[Real], NDArray[Real]]:
    """Apply tone curves.

    Args:
        value: 0 is black and 1 white, (..., n).
        tone: parameters of the curves, (..., 2).

    Returns:
        the curves at the values (..., n), their slopes there (..., n), and their derivatives by the
        parameters (..., 2, n).
    """
    bulge, bend = tone[..., :1], tone[..., 1:]
    by_tone = np.empty((*value.shape[:-1], TONES, value.shape[-1]), value.dtype)
    product, by_bend = by_tone[..., 0, :], by_tone[..., 1, :]
    np.multiply(value, 1.0 - value, out=product)
    np.multiply(product, 1.0 - 2.0 * value, out=by_bend)
    if not tone.any():
        return value, np.ones_like(value), by_tone
    slope = 1.0 + bulge * (1.0 - 2.0 * value) + bend * (1.0 - 6.0 * product)
    return value + bulge * product + bend * by_bend, np.maximum(slope, _MIN_SLOPE), by_tone


def bounded(tone: F64) -> F64:
    """Return the parameters (2,) limited to those that cameras have."""
    # numpy's `clip` takes twice as long.
    return np.minimum(np.maximum(tone, -MAX_TONE), MAX_TONE)


def edge_shift(tone: F64, blur: float) -> float:
    """Return by how much a tone curve shifts a blurred edge into the black.

    Args:
        tone: parameters of the curve, (2,).
        blur: variance of the edge's blur; the shift is in the unit of its root.
    """
    return float(tone[0]) * math.sqrt(blur / math.pi)  # the integral of Phi (1 - Phi)
