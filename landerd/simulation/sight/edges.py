"""The edges of a marker's print, cut into short straight pieces, from which its pose is fitted."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64
from landerd.pad import WHYCODE_BAND, WHYCODE_CORE, Marker, Ring, Square, WhyCode
from landerd.vision.square import printed_cells

_ARCS = 20  # number of pieces of a circle

_Piece = tuple[float, float, float, float]  # north, east of one end and of the other, m


@dataclass(frozen=True)
class Edges:
    """The pieces of a print's edges, marker frame."""

    points: F64  # middles of the pieces, north and east, m, (n, 2)
    along: F64  # unit vectors along the pieces, (n, 2)
    length_m: F64  # (n,)
    apart_m: float  # typical distance between neighbouring edges

    @property
    def count(self) -> int:
        """Number of pieces."""
        return len(self.points)


def edges_of(marker: Marker) -> Edges:
    """Return the edges of a marker's print, the top of which is to the north."""
    match marker:
        case Ring():
            inner = marker.inner_ratio * marker.radius_m
            pieces = [*_circle(marker.radius_m), *_circle(inner)]
            return _edges(pieces, marker.radius_m - inner)
        case WhyCode():
            tooth = 0.5 * (WHYCODE_CORE + WHYCODE_BAND) * math.pi / marker.bits
            return _edges(_teeth(marker), tooth * marker.radius_m)
        case Square():
            return _edges(*_cells(marker))


def _edges(pieces: list[_Piece], apart_m: float) -> Edges:
    ends = np.array(pieces)
    way = ends[:, 2:] - ends[:, :2]
    length = np.hypot(*way.T)
    return Edges(0.5 * (ends[:, :2] + ends[:, 2:]), way / length[:, None], length, apart_m)


def _arc(radius: float, first: float, last: float, count: int) -> list[_Piece]:
    """Return an arc about the origin as `count` pieces.

    Its radius is in m; the first and the last angle are clockwise from the north, rad.
    """
    a = np.linspace(first, last, count + 1)
    corners = radius * np.column_stack([np.cos(a), np.sin(a)])
    return [(*p, *q) for p, q in itertools.pairwise(corners.tolist())]


def _circle(radius: float) -> list[_Piece]:
    return _arc(radius, 0.0, 2.0 * math.pi, _ARCS)


def _teeth(code: WhyCode) -> list[_Piece]:
    """Return a WhyCode's outer edge, and the edges of its teeth and of the gaps between them."""
    core, band = WHYCODE_CORE * code.radius_m, WHYCODE_BAND * code.radius_m
    pieces = _circle(code.radius_m)
    half = math.pi / code.bits
    black = []
    for bit in range(code.bits):
        is_one = code.id >> (code.bits - 1 - bit) & 1
        black += [not is_one, bool(is_one)]
    for i, is_black in enumerate(black):
        # Cells are counted anticlockwise from the east; angles are clockwise from the north.
        first = 0.5 * math.pi - i * half
        pieces += _arc(core if is_black else band, first, first - half, 1)
        if is_black != black[i - 1]:
            c, s = math.cos(first), math.sin(first)
            pieces.append((core * c, core * s, band * c, band * s))
    return pieces


def _cells(square: Square) -> tuple[list[_Piece], float]:
    """Return the edges between black and white cells of a square, and the cells' side, m."""
    cells = np.pad(printed_cells(square), 1, constant_values=True)
    side = square.size_m / (len(cells) - 2)

    def at(i: float) -> float:
        return (i - 1) * side - 0.5 * square.size_m

    pieces: list[_Piece] = []
    for r, c in np.argwhere(cells[1:] != cells[:-1]).tolist():
        pieces.append((-at(r + 1), at(c), -at(r + 1), at(c + 1)))
    for r, c in np.argwhere(cells[:, 1:] != cells[:, :-1]).tolist():
        pieces.append((-at(r), at(c + 1), -at(r + 1), at(c + 1)))
    return pieces, side
