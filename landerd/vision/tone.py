"""The tone curve of a camera between a print's black and white.

Cameras made for people bend grey levels: white paper beside black ink lights up the pixels between
them. The curve is a cubic that keeps both ends; its two numbers cover gammas to 2.4 and the
S-curves that are laid over them.
"""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64

Real = TypeVar("Real", np.float32, np.float64)

TONES = 2  # numbers of a curve: how much it bulges, and how much it is S-shaped
LINEAR = np.zeros(TONES)
TONE_SIGMA = 0.6  # of both, before anything is seen
MAX_TONE = 1.2  # of either
_MIN_SLOPE = 0.03  # a curve rises everywhere


def toned(
    value: NDArray[Real], tone: NDArray[Real]
) -> tuple[NDArray[Real], NDArray[Real], NDArray[Real]]:
    """Return curves at values (..., n), 0 black and 1 white, their slopes, and the derivatives.

    Tones are (..., 2), derivatives by them (..., 2, n).
    """
    bulge, bend = tone[..., :1], tone[..., 1:]
    product = value * (1.0 - value)
    by_bend = product * (1.0 - 2.0 * value)
    by_tone = np.stack([product, by_bend], axis=-2)
    if not tone.any():
        return value, np.ones_like(value), by_tone
    slope = 1.0 + bulge * (1.0 - 2.0 * value) + bend * (1.0 - 6.0 * product)
    return value + bulge * product + bend * by_bend, np.maximum(slope, _MIN_SLOPE), by_tone


def bounded(tone: F64) -> F64:
    """Return the nearest tone that is a camera's."""
    return np.clip(tone, -MAX_TONE, MAX_TONE)


def edge_shift(tone: F64, blur: float) -> float:
    """Return by how much a curve moves an edge with a blur (variance), in its root's unit."""
    return float(tone[0]) * math.sqrt(blur / math.pi)  # the integral of Phi (1 - Phi)
