"""The tone curve of a camera between a print's black and white.

Cameras made for people bend grey levels: white paper beside black ink lights up the pixels between
them. The curve is a cubic that keeps both ends; its two numbers cover gammas to 2.4 and the
S-curves that are laid over them.
"""

import math

import numpy as np

from landerd.camera_model import F64

TONES = 2  # numbers of a curve: how much it bulges, and how much it is S-shaped
LINEAR = np.zeros(TONES)
TONE_SIGMA = 0.6  # of both, before anything is seen
_MAX_TONE = 1.2
_MIN_SLOPE = 0.03  # a curve rises everywhere


def toned(value: F64, tone: F64) -> tuple[F64, F64, F64]:
    """Return a curve at values (n,), 0 black and 1 white, its slope, and its derivative (2, n)."""
    bulge, bend = tone.tolist()
    product = value * (1.0 - value)
    by_tone = np.stack([product, product * (1.0 - 2.0 * value)])
    slope = 1.0 + bulge * (1.0 - 2.0 * value) + bend * (1.0 - 6.0 * product)
    return value + tone @ by_tone, np.maximum(slope, _MIN_SLOPE), by_tone


def bounded(tone: F64) -> F64:
    """Return the nearest tone that is a camera's."""
    return np.clip(tone, -_MAX_TONE, _MAX_TONE)


def edge_shift(tone: F64, blur: float) -> float:
    """Return by how much a curve moves an edge with a blur (variance), in its root's unit."""
    return float(tone[0]) * math.sqrt(blur / math.pi)  # the integral of Phi (1 - Phi)
