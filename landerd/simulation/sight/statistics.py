"""What vision finds, and how truly: measured on pictures by `python -m bench.sight`.

The pose's errors follow from `edge_fit` and the day's grey levels. What that does not tell is here:
how often a marker that is in the picture is found, and by how much vision's errors are larger than
the bound.
"""

import math
from dataclasses import dataclass

import numpy as np

from hw.sim.picture.levels import Levels
from landerd.camera_model import F64

PIXEL_BLUR = 0.289  # sigma of a pixel's own width, px


@dataclass(frozen=True)
class Kind:
    """One kind of marker.

    Attributes:
        least_px: smallest side or diameter in the image of which half are found, and
        spread_px: on the logistic curve about it.
        found: share of the large ones in plain sight.
        least_shown: share of the edges that must be in the picture.
        variance: of an edge's place over the bound.
        blurs: distance between edges, in blurs, at which 63 % of the contrast is left.
    """

    least_px: float
    spread_px: float
    found: float
    least_shown: float
    variance: float
    blurs: float


KINDS = {
    "whycon": Kind(8.0, 0.7, 0.998, 0.75, 1.3, 2.0),
    "whycode": Kind(20.0, 2.0, 0.99, 0.98, 2.0, 2.0),
    "apriltag": Kind(9.0, 0.8, 0.998, 0.6, 1.6, 2.0),
    "aruco": Kind(8.0, 0.8, 0.998, 0.6, 1.6, 2.0),
}
DETECTED_SHOWN = 0.995  # share of a square's edges in the picture, to be found where nobody expects
# Edges that all lie beside their place alike, and as they differ from side to side, px.
EDGE_BIAS_PX, LATERAL_BIAS_PX = 0.004, 0.003
_LEAST_CONTRAST, _LEAST_NOISES = 12.0, 9.0  # `ring_stages`: grey levels, and over the noise
_ROUNDING = 0.29  # grey levels


def found_share(kind: Kind, size_px: float, levels: Levels) -> float:
    """Return how often a marker of a size in the image is found."""
    noise = math.hypot(levels.noise, _ROUNDING)
    if levels.contrast < max(_LEAST_CONTRAST, _LEAST_NOISES * noise):
        return 0.0
    x = (size_px - kind.least_px) / kind.spread_px
    return kind.found / (1.0 + math.exp(-min(max(x, -50.0), 50.0)))


def edge_variance(kind: Kind, blur_px: F64, apart_px: float, levels: Levels) -> F64:
    """Return the variance (n,) of the place of a pixel length of edges so blurred, px^2."""
    noise = math.hypot(levels.noise, _ROUNDING)
    left = -np.expm1(-((apart_px / (kind.blurs * blur_px)) ** 2))
    share = noise / np.maximum(levels.contrast * left, 1e-3)
    return kind.variance * 2.0 * math.sqrt(math.pi) * blur_px * share * share
