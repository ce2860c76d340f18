"""The pad's print as textures of decreasing resolution, from which `pad_view` samples.

Texels are exact area averages: a texel through which an edge runs is grey in proportion. Sampling a
level whose texels are not larger than the distance between samples therefore does not shift edges.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.geometry import Vec3
from landerd.pad import (
    WHYCODE_BAND,
    WHYCODE_CORE,
    PadLayout,
    Plate,
    Ring,
    Square,
    WhyCode,
)

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

WHITE = 200  # grey level of the plate under full light
BLACK = 24  # grey level of the print: 12 % of white, as measured prints are (8 to 22 %)
# Texels per metre of the finest level: one is a pixel of the thesis camera at 0.4 m.
FINEST_PER_M = 1024
LARGEST_TEXELS = 4096  # largest number of texels along a side of the plate
LEVELS = 7  # number of levels, each with half the resolution of the one before
_HALVES = ((1.0, 0.0), (0.0, 1.0))  # black (1) and white halves of a WhyCode's cell for bits 0, 1


@dataclass(frozen=True)
class TextureLevel:
    """The texture in one resolution.

    Its rows count to the south and its columns to the east.
    """

    texel_m: float  # side of a texel
    origin_m: tuple[float, float]  # north, east of the centre of the first texel, pad frame
    grey: U8  # grey levels times opacity, (rows, columns)
    alpha: U8  # opacity: 255 on the plate, 0 beside it, (rows, columns)

    def from_pad(self) -> NDArray[np.float64]:
        """Return the matrix (3, 3) from (north, east, 1), m, to texels (column, row, 1)."""
        k = 1.0 / self.texel_m
        north, east = self.origin_m
        return np.array([[0.0, k, -k * east], [-k, 0.0, k * north], [0.0, 0.0, 1.0]])


def plate_corners(layout: PadLayout) -> tuple[Vec3, Vec3, Vec3, Vec3]:
    """Return the corners of the plate in the pad frame, m, clockwise from north-west."""
    p = layout.plate
    return (
        (p.north_m, -p.west_m, 0.0),
        (p.north_m, p.east_m, 0.0),
        (-p.south_m, p.east_m, 0.0),
        (-p.south_m, -p.west_m, 0.0),
    )


def marker_bitmap(marker: Square) -> U8:
    """Return a marker's cells (n, n), 0 black and 255 white, the top row first.

    The top is that of the marker as its makers print it: OpenCV's AprilTags are upside down against
    the AprilTag project's own pictures.

    Raises:
        ValueError: OpenCV has no such dictionary, or the dictionary no such id.
    """
    code = getattr(cv2.aruco, "DICT_" + marker.dictionary, None)
    if code is None:
        raise ValueError(f"no marker dictionary {marker.dictionary!r}")
    dictionary = cv2.aruco.getPredefinedDictionary(code)
    if marker.id >= len(dictionary.bytesList):
        raise ValueError(f"{marker.dictionary} has no id {marker.id}")
    cells = cv2.aruco.generateImageMarker(dictionary, marker.id, dictionary.markerSize + 2)
    return cast(U8, np.rot90(cells, 2) if marker.kind == "apriltag" else cells)


def pad_texture(
    layout: PadLayout, ink: float = BLACK, weather: Callable[[F32], F32] | None = None
) -> tuple[TextureLevel, ...]:
    """Return the pad's texture, the finest level first.

    Args:
        layout: markers and plate.
        ink: grey level of the print.
        weather: changes the plate's grey levels (rows, columns), the north-west corner first; None:
            a clean pad.

    Raises:
        ValueError: a marker does not exist (see marker_bitmap).
    """
    grid = _grid(layout.plate)
    alpha = _plate_alpha(layout.plate, grid)
    grey = cast(F32, ink + (WHITE - ink) * _white(layout, grid))
    if weather is not None:
        grey[grid.plate] = weather(grey[grid.plate])
    grey = grey * alpha
    return _levels(grey, alpha, grid)


@dataclass(frozen=True)
class _Grid:
    """The texels of the finest level, pad frame."""

    per_m: float  # texels per metre
    north: float  # of the first row's centres, m
    east: float  # of the first column's centres, m
    norths: F32  # of all rows' centres, m, (rows, 1)
    easts: F32  # of all columns' centres, m, (1, columns)
    plate: tuple[slice, slice]  # rows and columns that the plate fills


def _grid(plate: Plate) -> _Grid:
    """Return the texels for a plate, with a margin round it."""
    height, width = plate.north_m + plate.south_m, plate.east_m + plate.west_m
    per_m = float(FINEST_PER_M)
    while per_m * max(height, width) > LARGEST_TEXELS:
        per_m /= 2
    # A whole number of texels on every level, and at least one empty coarsest texel all round.
    block = 2 ** (LEVELS - 1)
    rows, columns = (block * (math.ceil(per_m * d / block) + 2) for d in (height, width))
    north = plate.north_m + (block - 0.5) / per_m
    east = -plate.west_m - (block - 0.5) / per_m
    norths = (north - np.arange(rows) / per_m).astype(np.float32)[:, None]
    easts = (east + np.arange(columns) / per_m).astype(np.float32)[None, :]
    top, left = (slice(block, block + round(per_m * d)) for d in (height, width))
    return _Grid(per_m, north, east, norths, easts, (top, left))


def _white(layout: PadLayout, grid: _Grid) -> F32:
    """Return the white share of each texel (rows, columns) of an infinite plate."""
    norths, easts, per_m = grid.norths, grid.easts, grid.per_m
    white = np.ones((norths.size, easts.size), np.float32)
    for marker in layout.markers:
        n, e = marker.position_m
        size = (
            marker.size_m * math.sqrt(2) if isinstance(marker, Square) else marker.outer_diameter_m
        )
        reach = size / 2 + 2 / per_m
        window = np.ix_(np.abs(norths[:, 0] - n) < reach, np.abs(easts[0] - e) < reach)
        dn, de = norths[window[0][:, 0]] - np.float32(n), easts[:, window[1][0]] - np.float32(e)
        if isinstance(marker, Ring):
            black = _ring(marker, dn, de, per_m)
        elif isinstance(marker, WhyCode):
            black = _whycode(marker, dn, de, per_m)
        else:
            black = _square(marker, dn, de, per_m)
        white[window] *= 1.0 - black
    return white


def _plate_alpha(plate: Plate, grid: _Grid) -> F32:
    """Return the share of each texel (rows, columns) that lies on the plate."""
    norths, easts, per_m = grid.norths, grid.easts, grid.per_m
    on_north = _covered(plate.north_m - norths, per_m) * _covered(plate.south_m + norths, per_m)
    on_east = _covered(plate.east_m - easts, per_m) * _covered(plate.west_m + easts, per_m)
    return on_north * on_east


def _levels(grey: F32, alpha: F32, grid: _Grid) -> tuple[TextureLevel, ...]:
    """Return the finest level and coarser ones, each averaged from the one before.

    Args:
        grey: grey levels times opacity of the finest level, (rows, columns).
        alpha: its opacity, 0 to 1, (rows, columns).
        grid: its texels.
    """
    levels = []
    for level in range(LEVELS):
        texel = 2**level / grid.per_m
        # Levels have the same outer border, so that centres of larger texels lie farther inside.
        shift = (texel - 1 / grid.per_m) / 2
        levels.append(
            TextureLevel(
                texel,
                (grid.north - shift, grid.east + shift),
                np.rint(grey).astype(np.uint8),
                np.rint(255 * alpha).astype(np.uint8),
            )
        )
        half = (grey.shape[1] // 2, grey.shape[0] // 2)
        grey = cast(F32, cv2.resize(grey, half, interpolation=cv2.INTER_AREA))
        alpha = cast(F32, cv2.resize(alpha, half, interpolation=cv2.INTER_AREA))
    return tuple(levels)


def _covered(inside_m: F32, per_m: float) -> F32:
    """Return the share of texels on the inner side of an edge, any shape.

    `inside_m` is the distance of a texel's centre from the edge, positive on the inner side.
    """
    return cast(F32, np.clip(0.5 + inside_m * np.float32(per_m), 0.0, 1.0))


def _ring(ring: Ring, dn: F32, de: F32, per_m: float) -> F32:
    """Return the black share of texels at dn (rows, 1), de (1, columns) from a ring's centre, m."""
    radius = cast(F32, np.sqrt(dn * dn + de * de))
    outer = _covered(ring.outer_diameter_m / 2 - radius, per_m)
    inner = _covered(ring.inner_ratio * ring.outer_diameter_m / 2 - radius, per_m)
    return outer - inner


def _whycode(code: WhyCode, dn: F32, de: F32, per_m: float) -> F32:
    """Return the black share of texels at dn (rows, 1), de (1, columns) from a code's centre, m."""
    radius = cast(F32, np.sqrt(dn * dn + de * de))
    disc, band, core = (
        _covered(np.float32(k * code.outer_diameter_m / 2) - radius, per_m)
        for k in (1.0, WHYCODE_BAND, WHYCODE_CORE)
    )
    # Angle anticlockwise from the print's east, in half cells. Of the borders between halves those
    # within a cell have black on one side; those between cells only if neighbouring bits are equal.
    turn = np.arctan2(dn, de) + np.float32(math.radians(code.heading_deg))
    at = (turn * np.float32(code.bits / math.pi)) % (2 * code.bits)
    halves = [half for i in reversed(range(code.bits)) for half in _HALVES[code.id >> i & 1]]
    black = np.array(halves, np.float32)
    border = np.rint(at)
    beyond = (at - border) * (radius * np.float32(math.pi / code.bits * per_m))  # texels
    share = np.clip(np.float32(0.5) + beyond, 0.0, 1.0)
    after = border.astype(np.intp) % len(black)
    teeth = black[after] * share + black[after - 1] * (1.0 - share)
    return cast(F32, disc - band + (band - core) * teeth)


def _square(marker: Square, dn: F32, de: F32, per_m: float) -> F32:
    """Return the black share of texels at dn (rows, 1), de (1, columns) from a square's centre."""
    cells = 1.0 - np.pad(marker_bitmap(marker), 1, constant_values=255).astype(np.float32) / 255.0
    n = cells.shape[0] - 2
    per_cell = np.float32(per_m * marker.size_m / n)  # texels
    h = math.radians(marker.heading_deg)
    c, s = np.float32(math.cos(h) * n / marker.size_m), np.float32(math.sin(h) * n / marker.size_m)
    half = np.float32(n / 2 + 1)
    u = half + de * c - dn * s  # distance from the padded bitmap's left edge, cells
    v = half - dn * c - de * s  # distance from its top edge, cells

    def sharpened(cell: F32) -> F32:
        # Interpolation between cells' centres is narrowed to one texel about their border.
        before = np.floor(cell - 0.5)
        step = np.clip((cell - 1.0 - before) * per_cell + 0.5, 0.0, 1.0)
        return cast(F32, (before + step).astype(np.float32))

    return cast(
        F32,
        cv2.remap(cells, sharpened(u), sharpened(v), cv2.INTER_LINEAR, borderValue=(0.0,)),
    )
