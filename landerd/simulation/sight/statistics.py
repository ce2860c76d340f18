"""Detection rates and errors of vision for modelled sight, measured by `python -m bench.sight`.

Errors of poses follow from `edge_fit` and the grey levels. Here is what these do not determine: how
often a marker in the picture is found, and by how much vision's errors exceed the Cramér-Rao bound.
"""

import math
from dataclasses import dataclass

import numpy as np

from hw.sim.options import SimOptions
from hw.sim.picture.levels import Levels
from landerd.camera_model import F64
from landerd.vision.ring_pixels import MARGIN

PIXEL_BLUR = 0.289  # sigma of a pixel's own box, px


@dataclass(frozen=True)
class Kind:
    """Statistics of one kind of marker.

    Attributes:
        least_px: side or diameter in the image at which half of the markers are found.
        spread_px: scale of the logistic curve of the share found, by size.
        found: share found of large markers in plain sight.
        least_shown: least share of the edges in the picture with which a marker can be found.
        variance: of an edge's place, over the Cramér-Rao bound.
        full_px: size up to which vision uses all pixels; of larger markers it samples them.
        blurs: distance between edges in the image, in sigmas of the blur, at which 63 % of the
            contrast is left.
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
# `Kind.least_shown` of a square larger than the picture: its cells are tracked (`square_fit`).
LARGE_SQUARE_SHOWN = 1.0 / 3.0
# Least share of a square's edges in the picture with which it is found where it is not expected.
DETECTED_SHOWN = 0.995
_LEAST_CONTRAST, _LEAST_NOISES = 12.0, 9.0  # least contrast: grey levels, and over the noise
_ROUNDING = 0.29  # noise by rounding, grey levels
# Errors that residuals do not show, as `ring_sighting`, `patch` and `print_fit` state them.
_RING_BIAS_PX, _RING_LATERAL_PX = 0.004, 0.003
_SURROUNDINGS_PX, _SURROUNDINGS_DECAY_PX = 0.18, 0.33
_FITTED_SIDE_PX = 25.0  # side from which on prints are fitted on a reduced image
_PRINT_BIAS_PX, _REDUCED_BIAS_PX, _UNSHARP_BIAS = 0.006, 0.001, 0.05
_SHARP_PX = 0.666  # blur of a sharp lens and of a pixel's box
# Shifts of edges of rings that are fitted to edges alone: all alike, and from side to side.
BY_EDGES_PX = (0.055, 0.05)
# Actual shift by what surrounds a ring over the stated one; it makes rings seem farther away.
_SURROUNDINGS_TRUE = 1.6

# The pad's north by its plate, as `plate_heading` finds it: least width of the ring in the image,
# and share of pictures in which it is found.
_PLATE_NORTH_PX, _PLATE_NORTH_TOLD = 18.0, 0.98
# Sigma of its error times the width, rad px; stated sigma over that sigma; and a least stated one.
_PLATE_NORTH_RAD_PX, _PLATE_NORTH_STATED, _PLATE_NORTH_LEAST = 0.25, 2.0, math.radians(1.0)


def found_share(kind: Kind, size_px: float, levels: Levels) -> float:
    """Return the share of markers of a size in the image that are found, if wholly in sight."""
    noise = math.hypot(levels.noise, _ROUNDING)
    if levels.contrast < max(_LEAST_CONTRAST, _LEAST_NOISES * noise):
        return 0.0
    x = (size_px - kind.least_px) / kind.spread_px
    return kind.found / (1.0 + math.exp(-min(max(x, -50.0), 50.0)))


def edge_variance(kind: Kind, size_px: float, blur_px: F64, apart_px: float, levels: Levels) -> F64:
    """Return the variances (n,) of the places of edges, for each pixel of their length, px^2.

    Args:
        kind: of the marker.
        size_px: of the marker in the image.
        blur_px: sigma of each edge's blur, (n,).
        apart_px: distance between neighbouring edges in the image.
        levels: grey levels.
    """
    noise = math.hypot(levels.noise, _ROUNDING)
    left = -np.expm1(-((apart_px / (kind.blurs * blur_px)) ** 2))
    share = noise / np.maximum(levels.contrast * left, 1e-3)
    sampled = max(1.0, size_px / kind.full_px)
    return sampled * kind.variance * 2.0 * math.sqrt(math.pi) * blur_px * share * share


def print_bias_px(size_px: float, blur_px: float) -> float:
    """Return the stated error of a square's or code's corners that residuals do not show, px."""
    reduced = max(1, round(size_px / _FITTED_SIDE_PX))
    unsharp = _UNSHARP_BIAS * math.sqrt(max(0.0, blur_px**2 - _SHARP_PX**2))
    return reduced * math.hypot(_PRINT_BIAS_PX, _REDUCED_BIAS_PX * reduced) + unsharp


def plate_north_share(width_px: float) -> float:
    """Return the share of pictures in which the plate shows the north of a ring of a width."""
    return 0.0 if width_px < _PLATE_NORTH_PX else _PLATE_NORTH_TOLD


def plate_north_sigma(width_px: float) -> tuple[float, float]:
    """Return the actual and the stated sigma of the north by the plate, rad."""
    error = _PLATE_NORTH_RAD_PX / width_px
    return error, math.hypot(_PLATE_NORTH_STATED * error, _PLATE_NORTH_LEAST)


def is_by_edges(options: SimOptions, levels: Levels) -> bool:
    """Tell whether rings are fitted to edges alone, as no model explains their grey levels."""
    camera, tone = options.camera, options.camera.tone
    is_even = options.render.leaf_shade == 0.0 and options.pad.dirt == 0.0
    is_linear = tone.curve == "linear" and tone.contrast == 0.0 and camera.sharpening == 0.0
    return not (is_even and is_linear and levels.clipped <= 1.0)


def ring_bias_px(size_px: float, draws: F64, *, by_edges: bool) -> F64:
    """Return the shifts of a ring's edges, px, (3,): of all alike, and from side to side (x, y).

    Args:
        size_px: of the ring in the image.
        draws: standard normal random numbers, (3,).
        by_edges: whether the ring is fitted to its edges alone.
    """
    white = math.exp(-MARGIN * 0.5 * size_px / _SURROUNDINGS_DECAY_PX)
    alike, aside = BY_EDGES_PX if by_edges else (_RING_BIAS_PX, _RING_LATERAL_PX)
    shone = _SURROUNDINGS_TRUE * _SURROUNDINGS_PX * white
    return np.array([alike * draws[0] + shone, *(aside * draws[1:])])
