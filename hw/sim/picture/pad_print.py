"""Differences of the simulated pad from its file: errors of printing, folds, dirt, wetness, glare.

The daemon knows only the file; the pictures show the pad with these differences. The landing point
is still the file's origin.
"""

import itertools
import math
from dataclasses import dataclass
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
    pad_texture,
)
from hw.sim.picture.view import F64, matrix, on_pad
from hw.sim.picture.wetness import COVER, SHEEN, SPOTS, wet_cover
from hw.sim.snapshot import PadPose
from landerd.geometry import Mat3, Vec3
from landerd.pad import Marker, PadLayout, Square, size_m

F32 = NDArray[np.float32]

DIRT = (0.15, 0.4)  # reflectance of dried mud and dead leaves, over that of the plate's white
DARKENED = 0.85  # share of light left where the print is wet, which is less porous than ground
GLARE = (0.03, 0.08)  # sigma of a spot of glare, over the plate's longer side
# A fold at most this far outside the corners of a block of rays may be in it, as the lens bends the
# block's edges.
EDGE_M = 0.02


@dataclass(frozen=True)
class Fold:
    """A plate folded along a line: the far part, without the landing point, has its own plane.

    Attributes:
        way: unit vector (2,) (north, east) across the line, away from the landing point.
        least: distance of the line from the landing point along `way`, m.
        R_pad_far: rotation (3, 3) from the far part's frame to the pad's; in its frame the far part
            lies as it would on the flat pad.
    """

    way: F64
    least: float
    R_pad_far: F64

    def far_part(self, pad: PadPose) -> PadPose:
        """Return the pose of the far part's frame for a pose of the pad."""
        hinge = self._hinge
        R = matrix(pad.R_local_pad) @ self.R_pad_far
        position = on_pad(pad, (hinge - self.R_pad_far @ hinge)[None])[0]
        rows = tuple(tuple(row) for row in R.tolist())
        return PadPose(cast(Vec3, tuple(position.tolist())), cast(Mat3, rows))

    def outline(self, plate: F64) -> F64:
        """Return the outline (n, 3) of the folded plate from the flat one's, pad frame, m."""
        beyond = plate[:, :2] @ self.way - self.least
        points = []
        for i, corner in enumerate(plate):
            before, here = beyond[i - 1], beyond[i]
            if (before > 0.0) != (here > 0.0):
                points.append(plate[i - 1] + before / (before - here) * (corner - plate[i - 1]))
            points.append(
                corner if here <= 0.0 else self._hinge + self.R_pad_far @ (corner - self._hinge)
            )
        return np.array(points)

    @property
    def _hinge(self) -> F64:
        """A point (3,) of the line, pad frame, m."""
        return np.array([*(self.least * self.way), 0.0])

    def reaches(self, H: F64, corners: F32) -> bool:
        """Tell whether a block of rays may see the far part.

        Args:
            H: `plane_homography` to the far part.
            corners: rays at the block's corners, on z = 1, (2, 2, 2).
        """
        north, east, descent = H[:, :2] @ corners.reshape(-1, 2).T + H[:, 2:]
        if descent.min() <= 0.0:
            return True
        beyond = (self.way[0] * north + self.way[1] * east) / descent - self.least
        return bool(beyond.max() > -EDGE_M)

    def bend(self, near: F32, far: F32, texture: TextureLevel) -> None:
        """Replace texels on the near part's plane by those on the far part's beyond the line.

        Args:
            near: texels (rows, columns, 2) where pixels see the near part's plane; changed.
            far: the same for the far part's plane.
            texture: of the flat pad.
        """
        k = texture.texel_m
        start = self.way @ texture.origin_m - self.least
        lies = cv2.transform(far, np.array([[k * self.way[1], -k * self.way[0], start]]))
        cv2.copyTo(far, (lies > 0.0).view(np.uint8), near)


def printed(layout: PadLayout, options: PadOptions, seed: int) -> PadLayout:
    """Return the layout as it was printed: scaled as a whole, and each marker misplaced.

    Args:
        layout: of the pad's file.
        options: scale of the print, and error of each marker's place.
        seed: of the errors' directions.
    """
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


def textures(
    layout: PadLayout, pad: PadOptions, render: RenderOptions, seed: int
) -> tuple[TextureLevel, ...]:
    """Return the printed pad's texture with dirt, wetness and glare, the finest level first.

    Args:
        layout: of the pad as it was printed.
        pad: ink and dirt.
        render: wetness and glare.
        seed: of all that is random.

    Raises:
        ValueError: a marker does not exist (see pad_texture).
    """
    black = BLACK if pad.black is None else pad.black * WHITE

    def weather(grey: F32) -> F32:
        return _used(grey, pad, render, seed)

    is_new = pad.dirt == render.wet == render.glare == 0.0
    return pad_texture(layout, black, None if is_new else weather)


def fold(layout: PadLayout, bend_deg: float) -> Fold | None:
    """Return the fold of a plate, midway between the two markers farthest apart; None: it is flat.

    Args:
        layout: of the pad; a plate with a single marker is not folded.
        bend_deg: slope of the part without the landing point, positive down.
    """
    pairs = itertools.combinations(layout.markers, 2)
    one, other = max(pairs, key=_distance, default=(None, None))
    if one is None or other is None or bend_deg == 0.0 or _distance((one, other)) == 0.0:
        return None
    start = np.array(one.position_m)
    way = (np.array(other.position_m) - start) / _distance((one, other))
    # The line is in the middle of the gap between the markers' edges.
    middle = 0.5 * (_radius(one) + _distance((one, other)) - _radius(other))
    least = float(start @ way) + middle
    if least < 0.0:
        way, least = -way, -least
    down, ahead = np.array([0.0, 0.0, 1.0]), np.array([*way, 0.0])
    frame = np.column_stack([ahead, np.cross(down, ahead), down])
    c, s = math.cos(math.radians(bend_deg)), math.sin(math.radians(bend_deg))
    slope = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return Fold(way, least, frame @ slope @ frame.T)


def _distance(pair: tuple[Marker, Marker]) -> float:
    """Return the distance of two markers' centres, m."""
    return math.dist(pair[0].position_m, pair[1].position_m)


def _radius(marker: Marker) -> float:
    """Return half a marker's size, m."""
    return 0.5 * size_m(marker)


def _used(grey: F32, pad: PadOptions, render: RenderOptions, seed: int) -> F32:
    """Return a plate's grey levels (rows, columns) with dirt, wet spots and a spot of glare."""
    rows, columns = grey.shape
    if pad.dirt > 0.0:
        rng = generator(seed, "dirt")
        mud = rng.uniform(*DIRT) * WHITE
        cover = blotches(rng, COVER, SPOTS, pad.dirt, 0.2)
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
    """Return a cover stretched to the size of the plate's grey levels."""
    return cast(F32, cv2.resize(cover, grey.shape[::-1], interpolation=cv2.INTER_LINEAR))
