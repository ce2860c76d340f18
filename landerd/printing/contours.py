"""The black areas of a pad as closed contours.

Coordinates are those of the print: millimetres to the right of and down from the north-west corner
of the plate. What lies within an odd number of a marker's contours is black.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landerd.pad import WHYCODE_BAND, WHYCODE_CORE, Marker, PadLayout, Ring, Square, WhyCode
from landerd.vision.square import printed_cells

Point = tuple[float, float]
Segment = tuple[Point, ...]  # its end (a line), or two control points and the end (a cubic Bézier)

# A cubic Bézier through so large an arc leaves the circle by 4e-6 of the radius at most.
_LARGEST_ARC = math.radians(45.0)


@dataclass(frozen=True)
class Contour:
    """A closed outline; the last segment ends at the start."""

    start: Point
    segments: tuple[Segment, ...]

    @property
    def points(self) -> tuple[Point, ...]:
        """Start and end of each segment."""
        return (self.start, *(segment[-1] for segment in self.segments))


def plate_size_mm(layout: PadLayout) -> tuple[float, float]:
    """Return width and height of the plate, mm."""
    p = layout.plate
    return 1e3 * (p.west_m + p.east_m), 1e3 * (p.north_m + p.south_m)


def pad_contours(layout: PadLayout) -> tuple[tuple[Contour, ...], ...]:
    """Return the contours of each marker, in the layout's order."""
    return tuple(_marker(marker, layout) for marker in layout.markers)


def _marker(marker: Marker, layout: PadLayout) -> tuple[Contour, ...]:
    north, east = marker.position_m
    centre = 1e3 * (layout.plate.west_m + east), 1e3 * (layout.plate.north_m - north)
    if isinstance(marker, Square):
        return _square(marker, centre)
    outer = _toothed(centre, [1e3 * marker.radius_m], 0.0)
    if isinstance(marker, Ring):
        return outer, _toothed(centre, [1e3 * marker.inner_ratio * marker.radius_m], 0.0)
    return outer, _whycode_hole(marker, centre)


# ---- rings -------------------------------------------------------------------------------------


def _whycode_hole(code: WhyCode, centre: Point) -> Contour:
    """Return the white inside of a WhyCode: its band where a half cell is white, else its core."""
    core, band = (1e3 * k * code.radius_m for k in (WHYCODE_CORE, WHYCODE_BAND))
    radii = []
    for bit in f"{code.id:0{code.bits}b}":
        radii += [band, core] if bit == "1" else [core, band]
    return _toothed(centre, radii, -math.radians(code.heading_deg))


def _toothed(centre: Point, radii: list[float], first: float) -> Contour:
    """Return arcs of equal length and these radii, joined by radial lines.

    Args:
        centre: mm.
        radii: mm, anticlockwise.
        first: where the first arc begins, rad, anticlockwise from the pad's east.
    """
    step = 2.0 * math.pi / len(radii)
    segments: list[Segment] = []
    for i, (radius, following) in enumerate(zip(radii, [*radii[1:], radii[0]], strict=True)):
        segments += _arc(centre, radius, first + i * step, step)
        if following != radius:
            segments.append((_on_circle(centre, following, first + (i + 1) * step),))
    start = _on_circle(centre, radii[0], first)
    segments[-1] = (*segments[-1][:-1], start)  # to the bit
    return Contour(start, tuple(segments))


def _arc(centre: Point, radius: float, begin: float, angle: float) -> Iterator[Segment]:
    parts = math.ceil(angle / _LARGEST_ARC - 1e-9)
    step = angle / parts
    reach = radius * 4.0 / 3.0 * math.tan(step / 4.0)  # of the control points along the tangents
    for i in range(parts):
        a, b = begin + i * step, begin + (i + 1) * step
        (xa, ya), (xb, yb) = _on_circle(centre, radius, a), _on_circle(centre, radius, b)
        yield (
            (xa - reach * math.sin(a), ya - reach * math.cos(a)),
            (xb + reach * math.sin(b), yb + reach * math.cos(b)),
            (xb, yb),
        )


def _on_circle(centre: Point, radius: float, angle: float) -> Point:
    return centre[0] + radius * math.cos(angle), centre[1] - radius * math.sin(angle)


# ---- squares -----------------------------------------------------------------------------------


def _square(marker: Square, centre: Point) -> tuple[Contour, ...]:
    cells = printed_cells(marker)
    size, n = 1e3 * marker.size_m, len(cells)
    heading = math.radians(marker.heading_deg)
    c, s = math.cos(heading), math.sin(heading)

    def place(corner: tuple[int, int]) -> Point:
        right, down = (size * (k / n - 0.5) for k in corner)
        return centre[0] + right * c - down * s, centre[1] + right * s + down * c

    return tuple(_polygon([place(corner) for corner in loop]) for loop in cell_outlines(~cells))


def _polygon(points: list[Point]) -> Contour:
    return Contour(points[0], tuple((p,) for p in [*points[1:], points[0]]))


def cell_outlines(black: NDArray[np.bool_]) -> list[list[tuple[int, int]]]:
    """Return the outlines of a grid's black areas: corners (column, row) of closed polygons.

    Cells that share an edge are one area. Where two cells touch at a corner only, their outlines
    touch there and do not cross, so that a cutter leaves whole pieces.

    Args:
        black: (rows, columns).
    """
    ways: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    around = np.pad(black, 1)
    for row, column in np.argwhere(black).tolist():
        # Edges of the cell towards white, black on their right.
        corners = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
        beyond = [(-1, 0), (0, 1), (1, 0), (0, -1)]  # row, column: above, right, below, left
        for i, (dr, dc) in enumerate(beyond):
            if not around[row + 1 + dr, column + 1 + dc]:
                ways[corners[i]].append(corners[(i + 1) % 4])
    loops = []
    while ways:
        loops.append(_without_straight(_walk(ways)))
    return loops


def _walk(ways: dict[tuple[int, int], list[tuple[int, int]]]) -> list[tuple[int, int]]:
    """Take one closed way out of the edges; at a fork turn right, which stays at the same cell."""
    start = at = next(iter(ways))
    came = (0, 0)
    loop: list[tuple[int, int]] = []
    while not loop or at != start:
        loop.append(at)
        right = (at[0] - came[1], at[1] + came[0])
        to = right if right in ways[at] else ways[at][0]
        ways[at].remove(to)
        if not ways[at]:
            del ways[at]
        came, at = (to[0] - at[0], to[1] - at[1]), to
    return loop


def _without_straight(loop: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Leave out the corners at which the way goes straight on."""

    def turns(i: int) -> bool:
        before, here, after = loop[i - 1], loop[i], loop[(i + 1) % len(loop)]
        return before[0] != after[0] and before[1] != after[1] and here != after

    return [loop[i] for i in range(len(loop)) if turns(i)]


def reaching_out(layout: PadLayout) -> Iterable[Marker]:
    """Yield the markers that reach over the plate's edge."""
    width, height = plate_size_mm(layout)
    for marker, contours in zip(layout.markers, pad_contours(layout), strict=True):
        points = [p for contour in contours for p in contour.points]
        if any(not (0.0 <= x <= width and 0.0 <= y <= height) for x, y in points):
            yield marker
