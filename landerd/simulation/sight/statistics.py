"""Detection rates and errors of vision, measured on pictures by `python -m bench.sight`.

The pose's errors follow from `edge_fit` and the day's grey levels. What that does not tell is here:
how often a marker that is in the picture is found, and by how much vision's errors are larger than
the bound.
"""

import math
from dataclasses import dataclass

import numpy as np

from hw.sim.options import SimOptions
from hw.sim.picture.levels import Levels
from landerd.camera_model import F64
from landerd.vision.ring_pixels import MARGIN

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
        full_px: largest size whose pixels are all used; larger ones are sampled.
        blurs: distance between edges in the image, in blurs, at which 63 % of the contrast is left.
    """

    least_px: float
    spread_px: float
    found: float
    least_shown: float
    variance: float
    full_px: float
    blurs: float


KINDS = {
    "whycon": Kind(4.4, 0.35, 0.995, 0.75, 6.5, 30.0, 2.0),
    "whycode": Kind(20.0, 2.0, 0.99, 0.98, 2.0, 200.0, 2.0),
    "apriltag": Kind(9.6, 0.6, 0.998, 0.6, 1.3, 60.0, 2.0),
    "aruco": Kind(8.5, 0.6, 0.998, 0.6, 1.3, 60.0, 2.0),
}
# Of a square that is larger than the picture: it is followed by its cells (`square_fit`).
LARGE_SQUARE_SHOWN = 1.0 / 3.0
DETECTED_SHOWN = 0.995  # share of a square's edges in the picture, to be found where nobody expects
_LEAST_CONTRAST, _LEAST_NOISES = 12.0, 9.0  # `ring_checks`: grey levels, and over the noise
_ROUNDING = 0.29  # grey levels
# Errors that no residual shows, as `ring_sighting`, `patch` and `print_fit` state them.
_RING_BIAS_PX, _RING_LATERAL_PX = 0.004, 0.003
_SURROUNDINGS_PX, _SURROUNDINGS_DECAY_PX = 0.18, 0.33
_FITTED_SIDE_PX = 25.0  # larger prints are fitted on a reduced image
_PRINT_BIAS_PX, _REDUCED_BIAS_PX, _UNSHARP_BIAS = 0.006, 0.001, 0.05
_SHARP_PX = 0.666  # blur of a sharp lens, and of a pixel's width
BY_EDGES_PX = (0.055, 0.05)  # of rings by their edges: alike all round, from side to side
_SURROUNDINGS_TRUE = 1.6  # the error itself, over the stated one: it makes rings seem farther

# The pad's north by its plate, as `plate_heading` finds and states it.
_PLATE_NORTH_PX, _PLATE_NORTH_TOLD = 18.0, 0.98
_PLATE_NORTH_RAD_PX, _PLATE_NORTH_STATED, _PLATE_NORTH_LEAST = 0.25, 2.0, math.radians(1.0)


def found_share(kind: Kind, size_px: float, levels: Levels) -> float:
    """Return how often a marker of a size in the image is found, all of it in sight."""
    noise = math.hypot(levels.noise, _ROUNDING)
    if levels.contrast < max(_LEAST_CONTRAST, _LEAST_NOISES * noise):
        return 0.0
    x = (size_px - kind.least_px) / kind.spread_px
    return kind.found / (1.0 + math.exp(-min(max(x, -50.0), 50.0)))


def edge_variance(kind: Kind, size_px: float, blur_px: F64, apart_px: float, levels: Levels) -> F64:
    """Return the variance (n,) of the place of a pixel length of edges so blurred, px^2."""
    noise = math.hypot(levels.noise, _ROUNDING)
    left = -np.expm1(-((apart_px / (kind.blurs * blur_px)) ** 2))
    share = noise / np.maximum(levels.contrast * left, 1e-3)
    sampled = max(1.0, size_px / kind.full_px)
    return sampled * kind.variance * 2.0 * math.sqrt(math.pi) * blur_px * share * share


def print_bias_px(size_px: float, blur_px: float) -> float:
    """Return the stated error of the corners of a square or code that no residual shows, px."""
    reduced = max(1, round(size_px / _FITTED_SIDE_PX))
    unsharp = _UNSHARP_BIAS * math.sqrt(max(0.0, blur_px**2 - _SHARP_PX**2))
    return reduced * math.hypot(_PRINT_BIAS_PX, _REDUCED_BIAS_PX * reduced) + unsharp


def plate_north_share(width_px: float) -> float:
    """Return in how many pictures a ring so wide at the narrowest has its north by the plate."""
    return 0.0 if width_px < _PLATE_NORTH_PX else _PLATE_NORTH_TOLD


def plate_north_sigma(width_px: float) -> tuple[float, float]:
    """Return the error of that north, and the stated one, rad."""
    error = _PLATE_NORTH_RAD_PX / width_px
    return error, math.hypot(_PLATE_NORTH_STATED * error, _PLATE_NORTH_LEAST)


def is_by_edges(options: SimOptions, levels: Levels) -> bool:
    """Tell whether rings are fitted to their edges alone: the grey levels cannot be explained."""
    camera, tone = options.camera, options.camera.tone
    is_even = options.render.leaf_shade == 0.0 and options.pad.dirt == 0.0
    is_linear = tone.curve == "linear" and tone.contrast == 0.0 and camera.sharpening == 0.0
    return not (is_even and is_linear and levels.clipped <= 1.0)


def ring_bias_px(size_px: float, draws: F64, *, by_edges: bool) -> F64:
    """Return the error (3,) of a ring's edges: alike all round, and from side to side, px.

    `draws` (3,) are standard normal.
    """
    white = math.exp(-MARGIN * 0.5 * size_px / _SURROUNDINGS_DECAY_PX)
    alike, aside = BY_EDGES_PX if by_edges else (_RING_BIAS_PX, _RING_LATERAL_PX)
    shone = _SURROUNDINGS_TRUE * _SURROUNDINGS_PX * white
    return np.array([alike * draws[0] + shone, *(aside * draws[1:])])
