"""The edges of a WhyCode for `print_edges`: its outline, and those of the teeth that are its code.

A WhyCode is a black ring whose inner side has teeth. Round the ring each bit takes two slots, of
which one is a tooth and the other a gap.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.pad import WHYCODE_BAND, WHYCODE_CORE, WhyCode
from landerd.vision.print_edges import Lines, PrintEdges
from landerd.vision.whycode_print import bits_of

_OUTLINE_PLACES = 32  # lines across the outline
# Width of a cell, in outer radii: half a tooth of six bits is as wide, the stroke twice as wide.
_CELL = 0.2


def whycode_edges(code: WhyCode) -> PrintEdges:
    """Return the edges of a printed WhyCode, for a fit of its pose to them."""
    radius = code.radius_m
    tooth_angle = math.pi / code.bits
    a = (np.arange(_OUTLINE_PLACES) + 0.5) * (2.0 * math.pi / _OUTLINE_PLACES)
    outline = Lines(radius * _direction(a), _direction(a), np.full(len(a), -1.0 / radius))
    slot = np.arange(2 * code.bits)
    is_tooth = slot % 2 == bits_of(code)[slot // 2]
    # The inner ends of the teeth, and the inner edge of the stroke in the gaps between them.
    middle = _direction((slot + 0.5) * tooth_angle)
    core, band = WHYCODE_CORE * radius, WHYCODE_BAND * radius
    tips = Lines(core * middle, -middle, np.full(len(slot), 1.0 / core))
    gaps = Lines(band * middle, -middle, np.full(len(slot), 1.0 / band))
    # The sides between slots, anticlockwise: white lies on that of the gap.
    side = _direction(slot * tooth_angle)
    onwards = _direction(slot * tooth_angle + 0.5 * math.pi)
    before = np.roll(is_tooth, 1)
    towards = np.where((before & ~is_tooth)[:, None], onwards, -onwards)
    sides = Lines(0.5 * (core + band) * side, towards, np.zeros(len(slot)))
    is_side = before != is_tooth
    plain = sides.of(~is_side)
    code_edges = tips.of(is_tooth).and_those(gaps.of(~is_tooth), sides.of(is_side))
    foreign = tips.of(~is_tooth).and_those(
        gaps.of(is_tooth), sides.of(is_side).turned(), plain, plain.turned()
    )
    is_code = np.arange(_OUTLINE_PLACES + len(code_edges.place)) >= _OUTLINE_PLACES
    size = code.outer_diameter_m
    return PrintEdges(outline.and_those(code_edges), is_code, foreign, _CELL * radius, size)


def _direction(angle: NDArray[np.floating]) -> F64:
    """Return north and east (n, 2) of angles (n,) anticlockwise from the east, rad."""
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)
