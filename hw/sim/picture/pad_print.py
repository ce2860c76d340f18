"""The pad as it really was printed, mounted and used, against what its file says.

The core goes by the file; only the world's pictures show this. The landing point is the file's
origin still.
"""

import itertools
import math
from dataclasses import dataclass, replace
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.fractal import blotches, generator
from hw.sim.picture.pad_texture import (
    BLACK,
    WHITE,
    TextureLevel,
    covered,
    pad_texture,
    plate_corners,
)
from hw.sim.picture.view import F64, matrix, on_pad
from hw.sim.picture.wetness import COVER, OCTAVES, SHEEN, wet_cover
from hw.sim.snapshot import PadPose
from landerd.geometry import IDENTITY, Mat3, Vec3
from landerd.pad import Marker, PadLayout, Square

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]

DIRT = (0.15, 0.4)  # reflectance of dried mud and dead leaves against the plate's white
DARKENED = 0.85  # light that is left where the print is wet; it is no porous ground
GLARE = (0.03, 0.08)  # sigma of the spot against the plate's longer side
OVERLAP_M = 0.05  # of the part with the landing point, under the folded one


@dataclass(frozen=True)
class Panel:
    """A flat part of the plate.

    Its own frame is that of the pad as if it were not folded.
    """

    levels: tuple[TextureLevel, ...]
    outline: F64  # (n, 3), convex, in its own frame
    origin: Vec3  # of its frame, in the pad's
    R_pad_panel: Mat3

    def placed(self, pad: PadPose) -> PadPose:
        """Return where the panel lies when the pad is there."""
        if self.R_pad_panel == IDENTITY:
            return pad
        position = on_pad(pad, np.array([self.origin]))[0]
        R = matrix(pad.R_local_pad) @ matrix(self.R_pad_panel)
        return PadPose(cast(Vec3, tuple(position.tolist())), _rows(R))


def printed(layout: PadLayout, options: PadOptions, seed: int) -> PadLayout:
    """Return the layout as printed: all markers larger or smaller, each a little misplaced."""
    if options.print_scale == 1.0 and options.marker_error_m == 0.0:
        return layout
    rng = generator(seed, "print")
    markers = []
    for marker in layout.markers:
        way = rng.uniform(0.0, 2.0 * math.pi)
        size = "size_m" if isinstance(marker, Square) else "outer_diameter_m"
        north, east = (options.print_scale * p for p in marker.position_m)
        place = (
            north + options.marker_error_m * math.cos(way),
            east + options.marker_error_m * math.sin(way),
        )
        changes = {"position_m": place, size: options.print_scale * getattr(marker, size)}
        markers.append(marker.model_copy(update=changes))
    return layout.model_copy(update={"markers": tuple(markers)})


def panels(
    layout: PadLayout, pad: PadOptions, render: RenderOptions, seed: int
) -> tuple[Panel, ...]:
    """Draw the printed pad: one panel, or two of a folded plate, the landing point's first.

    Raises:
        ValueError: a marker does not exist (see pad_texture).
    """
    black = BLACK if pad.black is None else pad.black * WHITE

    def weather(grey: F32) -> F32:
        return _used(grey, pad, render, seed)

    is_new = pad.dirt == render.wet == render.glare == 0.0
    levels = pad_texture(layout, black, None if is_new else weather)
    outline = np.array(plate_corners(layout))
    fold = fold_line(layout)
    if pad.bend_deg == 0.0 or fold is None:
        return (Panel(levels, outline, (0.0, 0.0, 0.0), IDENTITY),)
    point, towards = fold
    along = float(point @ towards)
    near = _part(levels, outline, -towards, -along - OVERLAP_M)
    far = _part(levels, outline, towards, along)
    R = _slope(towards, math.radians(pad.bend_deg))
    hinge = np.array([*point, 0.0])
    moved = hinge - R @ hinge
    return (
        Panel(*near, (0.0, 0.0, 0.0), IDENTITY),
        Panel(*far, cast(Vec3, tuple(moved.tolist())), _rows(R)),
    )


def fold_line(layout: PadLayout) -> tuple[F64, F64] | None:
    """Return a point of the line that a plate bends along, and the way (2,) across it.

    The line lies in the middle of the gap between the two markers that are furthest apart, the way
    leads away from the landing point. None: there is but one marker.
    """
    pairs = itertools.combinations(layout.markers, 2)
    one, other = max(pairs, key=_distance, default=(None, None))
    if one is None or other is None or _distance((one, other)) == 0.0:
        return None
    start = np.array(one.position_m)
    way = (np.array(other.position_m) - start) / _distance((one, other))
    middle = 0.5 * (_radius(one) + _distance((one, other)) - _radius(other))
    point = start + middle * way
    return point, (way if point @ way >= 0.0 else -way)


def _distance(pair: tuple[Marker, Marker]) -> float:
    return math.dist(pair[0].position_m, pair[1].position_m)


def _radius(marker: Marker) -> float:
    return 0.5 * (marker.size_m if isinstance(marker, Square) else marker.outer_diameter_m)


def _slope(way: F64, angle: float) -> F64:
    """Return the rotation (3, 3) that turns a level way (2,) down by an angle."""
    down = np.array([0.0, 0.0, 1.0])
    ahead = np.array([*way, 0.0])
    frame = np.column_stack([ahead, np.cross(down, ahead), down])
    c, s = math.cos(angle), math.sin(angle)
    return cast(F64, frame @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ frame.T)


def _rows(R: F64) -> Mat3:
    return cast(Mat3, tuple(tuple(row) for row in R.tolist()))


def _part(
    levels: tuple[TextureLevel, ...], outline: F64, way: F64, least: float
) -> tuple[tuple[TextureLevel, ...], F64]:
    """Return textures and outline of what lies further along a way (2,) than least, m."""
    cut = []
    for level in levels:
        rows, columns = level.grey.shape
        north = level.origin_m[0] - level.texel_m * np.arange(rows, dtype=np.float32)
        east = level.origin_m[1] + level.texel_m * np.arange(columns, dtype=np.float32)
        inside = np.add.outer(way[0] * north, way[1] * east - least).astype(np.float32)
        share = covered(inside, 1 / level.texel_m)
        grey = cast(U8, cv2.multiply(level.grey, share, dtype=cv2.CV_8U))
        alpha = cast(U8, cv2.multiply(level.alpha, share, dtype=cv2.CV_8U))
        cut.append(replace(level, grey=grey, alpha=alpha))
    beyond = outline[:, :2] @ way - least
    corners = []
    for i, corner in enumerate(outline):
        before, here = beyond[i - 1], beyond[i]
        if (before >= 0.0) != (here >= 0.0):
            corners.append(outline[i - 1] + before / (before - here) * (corner - outline[i - 1]))
        if here >= 0.0:
            corners.append(corner)
    return tuple(cut), np.array(corners)


def _used(grey: F32, pad: PadOptions, render: RenderOptions, seed: int) -> F32:
    """Return a plate's grey levels (rows, columns) with dirt, wet spots and a glare on it."""
    rows, columns = grey.shape
    if pad.dirt > 0.0:
        rng = generator(seed, "dirt")
        mud = rng.uniform(*DIRT) * WHITE
        cover = blotches(rng, COVER, OCTAVES, pad.dirt, 0.2)
        grey = grey + _spread(cover, grey) * (np.float32(mud) - grey)
    if render.wet > 0.0:
        wet = _spread(wet_cover(render.wet, generator(seed, "wet pad")), grey)
        grey = grey * (1.0 - (1.0 - DARKENED) * wet) + SHEEN * wet
    if render.glare > 0.0:
        rng = generator(seed, "glare")
        at = rng.uniform(0.1, 0.9, 2) * grey.shape
        sigma = rng.uniform(*GLARE) * max(grey.shape)
        y, x = (
            np.exp(-0.5 * ((np.arange(n) - m) / sigma) ** 2)
            for n, m in ((rows, at[0]), (columns, at[1]))
        )
        grey = grey + (255.0 * render.glare * np.outer(y, x)).astype(np.float32)
    return np.minimum(grey, 255.0)


def _spread(cover: F32, grey: F32) -> F32:
    """Stretch a cover over the plate."""
    return cast(F32, cv2.resize(cover, grey.shape[::-1], interpolation=cv2.INTER_LINEAR))
