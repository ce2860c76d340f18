"""Things on the ground that look like markers: manholes, wheels, targets, letters, other tags.

They are painted into the ground's texture (`ground`) around the place where the pad starts, without
touching it or each other.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.pad_texture import BLACK, WHITE, marker_bitmap
from hw.sim.picture.view import level_of_detail
from landerd.pad import PadLayout, Square

U8 = NDArray[np.uint8]
Rng = np.random.Generator

SIDE = 256  # texels along a side of a drawing
MARGIN = 16  # width of its transparent margin, texels: one on the coarsest level
LEVELS = 5  # number of levels of detail, each with half the resolution of the one before
GAP_M = 0.3  # least distance between two things
# Largest distance of a thing from the pad, beyond the least one, and what each failed attempt to
# place the thing adds to it.
NEAR_M = 5.0
FURTHER_M = 0.05
TRIES = 100  # attempts to place a thing
UNLIKE = 0.1  # least difference of a ring's inner ratio from those of the pad's rings
TAGS = ("APRILTAG_36h11", "APRILTAG_25h9", "APRILTAG_16h5", "4X4_50", "5X5_100", "6X6_250")
OPAQUE = 255 / WHITE  # level that makes `_disc` draw 255
_MIDDLE = (SIDE - 1) / 2  # of a drawing, texels
_BITS = 4  # fractional bits of the coordinates that OpenCV draws at


@dataclass(frozen=True)
class LookAlike:
    """A thing on the ground that looks like a marker.

    Attributes:
        place_m: north, east of its middle, local NED.
        heading: direction of its drawing's top, clockwise from north, rad.
        side_m: side of the square that it fills or that is about it.
        levels: for each level of detail, the drawing as grey levels times opacity, and its opacity
            (255: opaque), both (n, n).
    """

    place_m: tuple[float, float]
    heading: float
    side_m: float
    levels: tuple[tuple[U8, U8], ...]

    @property
    def radius_m(self) -> float:
        """Radius of a circle that contains it, m."""
        return self.side_m / math.sqrt(2.0)


def scattered(
    count: int, layout: PadLayout, place_m: tuple[float, float], reach_m: float, rng: Rng
) -> list[LookAlike]:
    """Return things at random places about the pad, fewer if there is no room for all.

    Args:
        count: number of things.
        layout: of the pad, from whose markers all of them differ.
        place_m: north, east of the landing point at the start, local NED.
        reach_m: half the side of the square about that place in which all of them lie.
        rng: source of all that is random.
    """
    plate = layout.plate
    pad_m = math.hypot(max(plate.north_m, plate.south_m), max(plate.east_m, plate.west_m))
    makers = [_MAKERS[i] for i in rng.permutation(len(_MAKERS))]
    things: list[LookAlike] = []
    for maker, least_m, most_m in (makers[i % len(makers)] for i in range(count)):
        levels = _levels(*maker(layout, rng))
        side_m, heading = float(rng.uniform(least_m, most_m)), float(rng.uniform(0, 2 * math.pi))
        for attempt in range(TRIES):
            away = pad_m + side_m + GAP_M
            away += (NEAR_M + FURTHER_M * attempt) * math.sqrt(rng.random())
            way = rng.uniform(0.0, 2.0 * math.pi)
            aside = away * math.cos(way), away * math.sin(way)
            place = place_m[0] + aside[0], place_m[1] + aside[1]
            thing = LookAlike(place, heading, side_m, levels)
            if max(map(abs, aside)) + side_m < reach_m and not any(
                _touch(thing, other) for other in things
            ):
                things.append(thing)
                break
    return things


def painted(
    texture: U8, texel_m: float, corner_m: tuple[float, float], things: Iterable[LookAlike]
) -> U8:
    """Return a texture of the ground with things painted on it.

    Args:
        texture: (rows, columns); rows count to the north, columns to the east.
        texel_m: side of a texel.
        corner_m: north, east of the first texel's outer corner, local NED.
        things: none of which crosses the texture's border.
    """
    texture = texture.copy()
    for thing in things:
        inner_m = thing.side_m / (SIDE - 2 * MARGIN)  # side of the finest level's texels
        level = level_of_detail(texel_m, inner_m, LEVELS)
        grey, alpha = thing.levels[level]
        k = inner_m * 2**level / texel_m
        c, s = k * math.cos(thing.heading), k * math.sin(thing.heading)
        row, column = (
            (p - q) / texel_m - 0.5 for p, q in zip(thing.place_m, corner_m, strict=True)
        )
        reach = math.ceil(k * len(grey) / math.sqrt(2.0)) + 1
        top, left = round(row) - reach, round(column) - reach
        part = texture[max(top, 0) : top + 2 * reach, max(left, 0) : left + 2 * reach]
        top, left = max(top, 0), max(left, 0)
        # A drawing's rows count down from its top, which points along the heading.
        middle = (len(grey) - 1) / 2
        to_part = np.array(
            [
                [c, -s, column - left - (c - s) * middle],
                [-s, -c, row - top + (s + c) * middle],
            ]
        )
        size = part.shape[::-1]
        light, shown = (
            cv2.warpAffine(a, to_part, size, flags=cv2.INTER_LINEAR) for a in (grey, alpha)
        )
        cv2.multiply(part, cv2.bitwise_not(shown), dst=part, scale=1 / 255)
        cv2.add(part, light, dst=part)
    return texture


def _touch(one: LookAlike, other: LookAlike) -> bool:
    """Tell whether two things are nearer to each other than `GAP_M`."""
    apart = math.dist(one.place_m, other.place_m)
    return apart < one.radius_m + other.radius_m + GAP_M


def _levels(grey: U8, alpha: U8) -> tuple[tuple[U8, U8], ...]:
    """Return grey levels times opacity, and opacity, of a drawing for each level of detail."""
    pair = [cv2.multiply(grey, alpha, scale=1 / 255), alpha]
    levels = []
    for level in range(LEVELS):
        size = (SIDE >> level,) * 2
        pair = [cv2.resize(drawing, size, interpolation=cv2.INTER_AREA) for drawing in pair]
        levels.append(cast(tuple[U8, U8], tuple(pair)))
    return tuple(levels)


# ---- drawings: grey levels and opacity (SIDE, SIDE), within the margin ---------------------------


def _manhole(_: PadLayout, rng: Rng) -> tuple[U8, U8]:
    """Draw a cast iron cover in its frame, or a drain."""
    grey, alpha = _empty()
    iron = float(rng.uniform(0.06, 0.2))
    _disc(alpha, 1.0, OPAQUE)
    _disc(grey, 1.0, 1.6 * iron)
    _disc(grey, rng.uniform(0.82, 0.92), 0.3 * iron)
    _disc(grey, 0.8, iron)
    for radius in rng.uniform(0.2, 0.75, 3):
        _disc(grey, radius, 0.5 * iron, 5)
    if rng.random() < 0.5:
        _disc(grey, 0.3, 1.5 * iron)
    return grey, alpha


def _wheel(_: PadLayout, rng: Rng) -> tuple[U8, U8]:
    """Draw a tyre with a bright rim of spokes, or without one, so that the ground shows."""
    grey, alpha = _empty()
    rim = rng.uniform(0.5, 0.65)
    _disc(alpha, 1.0, OPAQUE)
    _disc(grey, 1.0, 0.05)
    _disc(grey, 0.85, 0.035)
    if rng.random() < 0.4:
        _disc(alpha, rim, 0.0)
        return grey, alpha
    _disc(grey, rim, rng.uniform(0.3, 0.7))
    spokes = rng.integers(4, 8)
    for angle in 2.0 * math.pi * np.arange(spokes) / spokes:
        at = (0.62 * rim * math.cos(angle), 0.62 * rim * math.sin(angle))
        _disc(grey, rim * rng.uniform(0.16, 0.24), 0.04, at=at)
    _disc(grey, 0.15 * rim, 0.1)
    return grey, alpha


def _target(layout: PadLayout, rng: Rng) -> tuple[U8, U8]:
    """Draw rings with other ratios than the pad's, on a round or square white plate."""
    grey, alpha = _empty()
    if rng.random() < 0.5:
        _disc(alpha, 1.0, OPAQUE)
    else:
        alpha[MARGIN:-MARGIN, MARGIN:-MARGIN] = 255
    grey[:] = WHITE
    own = [ring.inner_ratio for ring in layout.rings]
    radius = 0.9
    for _ring in range(rng.integers(1, 4)):
        ratio = rng.uniform(0.2, 0.85)
        while any(abs(ratio - other) < UNLIKE for other in own):
            ratio = rng.uniform(0.2, 0.85)
        _disc(grey, radius, BLACK / WHITE)
        radius *= ratio
        _disc(grey, radius, 1.0)
        radius *= rng.uniform(0.5, 0.8)
    return grey, alpha


def _letter(_: PadLayout, rng: Rng) -> tuple[U8, U8]:
    """Draw a letter on the ground or on a plate, perhaps in a circle as on helipads."""
    grey, alpha = _empty()
    shape = np.zeros_like(grey)
    strokes = _LETTERS[str(rng.choice(sorted(_LETTERS)))]
    for start, end in strokes:
        ends = (_texels(start), _texels(end))
        cv2.line(shape, *ends, (255.0,), round(0.2 * SIDE / 2), cv2.LINE_4, _BITS)
    if rng.random() < 0.5:
        _disc(shape, 0.92, OPAQUE, round(0.1 * SIDE / 2))
    if rng.random() < 0.5:
        grey[:] = round(rng.uniform(0.5, 0.9) * WHITE)
        return grey, shape
    _disc(alpha, 1.0, OPAQUE)
    on_plate = cv2.addWeighted(shape, (BLACK - WHITE) / 255, shape, 0.0, WHITE)
    return cast(U8, on_plate), alpha


def _tag(layout: PadLayout, rng: Rng) -> tuple[U8, U8]:
    """Draw an AprilTag or ArUco marker on a white sheet, with an id that is not on the pad."""
    grey, alpha = _empty()
    own = [square.id for square in layout.squares]
    dictionary = str(rng.choice(TAGS))
    number = int(rng.choice([n for n in range(30) if n not in own]))
    kind = "apriltag" if dictionary.startswith("APRILTAG") else "aruco"
    tag = Square.model_validate(
        {"kind": kind, "dictionary": dictionary, "id": number, "size_m": 1.0}
    )
    cells = np.pad(marker_bitmap(tag), 1, constant_values=255)
    inside = SIDE - 2 * MARGIN
    sheet = cv2.resize(cells, (inside, inside), interpolation=cv2.INTER_NEAREST)
    levels = np.where(sheet > 0, WHITE, BLACK).astype(np.uint8)
    grey[MARGIN:-MARGIN, MARGIN:-MARGIN] = levels
    alpha[MARGIN:-MARGIN, MARGIN:-MARGIN] = 255
    return grey, alpha


_Maker = Callable[[PadLayout, Rng], tuple[U8, U8]]
# Each kind of thing, with the least and the largest side, m.
_MAKERS: Sequence[tuple[_Maker, float, float]] = (
    (_manhole, 0.5, 0.8),
    (_wheel, 0.5, 0.75),
    (_target, 0.3, 1.3),
    (_letter, 0.6, 2.0),
    (_tag, 0.15, 0.7),
)

_Point = tuple[float, float]
# Strokes of each letter within a circle of radius 1, from point to point (x to the right, y down).
_LETTERS: dict[str, list[tuple[_Point, _Point]]] = {
    "H": [((-0.4, -0.55), (-0.4, 0.55)), ((0.4, -0.55), (0.4, 0.55)), ((-0.4, 0.0), (0.4, 0.0))],
    "T": [((-0.45, -0.5), (0.45, -0.5)), ((0.0, -0.5), (0.0, 0.6))],
    "X": [((-0.5, -0.5), (0.5, 0.5)), ((-0.5, 0.5), (0.5, -0.5))],
    "P": [((-0.3, -0.6), (-0.3, 0.6)), ((-0.3, -0.6), (0.3, -0.6)), ((0.3, -0.6), (0.3, 0.0)),
          ((0.3, 0.0), (-0.3, 0.0))],
}  # fmt: skip


def _empty() -> tuple[U8, U8]:
    """Return black grey levels and no opacity, (SIDE, SIDE) each."""
    return np.zeros((SIDE, SIDE), np.uint8), np.zeros((SIDE, SIDE), np.uint8)


def _texels(at: _Point) -> tuple[int, int]:
    """Return a point in OpenCV's fixed-point coordinates of a drawing.

    It is given in radii of the circle inscribed within the margin.
    """
    k = (SIDE - 2 * MARGIN) / 2
    x, y = (round((_MIDDLE + k * p) * 2**_BITS) for p in at)
    return x, y


def _disc(image: U8, radius: float, level: float, line: int = -1, at: _Point = (0.0, 0.0)) -> None:
    """Draw a disc or a circle.

    Args:
        image: of a drawing; changed.
        radius: in radii of the circle inscribed within the margin.
        level: 0 is black and 1 the white of pads.
        line: width of a circle's line, texels; -1: a disc.
        at: centre, see `_texels`.
    """
    r = round(radius * (SIDE - 2 * MARGIN) / 2 * 2**_BITS)
    cv2.circle(image, _texels(at), r, (float(level * WHITE),), line, cv2.LINE_AA, _BITS)
