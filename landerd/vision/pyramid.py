"""The pyramid in which an image is searched for rings: the searched part at several sizes.

`ring_segment` finds rings of 10 to 100 px: each level shows the rings of an octave of sizes. A
level comes with the camera that would see it, so that fits work on any of them.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from landerd.camera_model import CameraModel, Window
from landerd.vision.arrays import U8

# Longer side of the coarsest level, px: segmentation finds rings up to those that fill it.
_COARSEST_PX = 100.0
_SEARCH_DIAMETER_PX = 28.0  # size of the rings in the only level, if their size is known
_SMALLEST_SIDE_PX = 8  # of a level
# Diameter of the largest rings that are looked for in a level, px: in the finest one the second, in
# the others but the coarsest the first. The next coarser level shows larger ones well, and the
# finest one takes three quarters of the time.
_LARGEST_PX, _SMALL_PX = 40.0, 24.0
# All these sizes are those of rings whose stroke is this share of the radius, or wider. Those of a
# thinner one grow as that shrinks: what matters is how many pixels wide it is.
_STROKE = 0.5
# An image is blank if within no square of this side, px of the image halved, grey levels differ by
# this much. Rings of less than 12 grey levels are refused, and squares of less than 14 are not
# detected. The faintest of 1500 pictures of pads, in all kinds of light, has 22; clear sky 0 to 8.
_STEP_PX, _LEAST_STEP = 7, 10
_STRIP_PX = 32  # rows of the halved image that are looked at together


@dataclass(frozen=True)
class Level:
    """The searched part of an image at one size, and the camera that would see just that."""

    finer: "U8 | Level"  # what it is reduced from: the part at its own size, or a finer level
    whole: CameraModel  # that sees the part at its own size
    size: tuple[int, int]  # width and height, px
    corner: tuple[int, int]  # of the part in the image: column and row, px
    reduction: float  # pixels of the image along one of the level
    # Diameter of the largest rings to look for here, px of the level; for oblique rings that is the
    # geometric mean of both diameters.
    largest_px: float

    @cached_property
    def camera(self) -> CameraModel:
        """The camera that would see the level, made on demand like its image."""
        return self.whole.resized(*self.size, 1.0 / self.reduction)

    @cached_property
    def image(self) -> U8:
        """The grey image, made on demand: a ring that is near needs the coarsest level only."""
        if isinstance(self.finer, Level):
            finer, k = self.finer.image, self.reduction / self.finer.reduction
        else:
            finer, k = self.finer, self.reduction
        if k == 1.0:
            return finer
        w, h = self.size
        whole = finer[: int(h * k), : int(w * k)] if k > 1.0 else finer
        interpolation = cv2.INTER_AREA if k > 1.0 else cv2.INTER_CUBIC
        return np.asarray(cv2.resize(whole, (w, h), interpolation=interpolation), dtype=np.uint8)


def levels(
    image: U8,
    camera: CameraModel,
    window: Window | None,
    expected_px: float | None,
    stroke: float = _STROKE,
) -> list[Level]:
    """Return the levels of the part to search, the coarsest first.

    Args:
        image: grey image (height, width).
        camera: that took it.
        window: the part to search; None: all of it.
        expected_px: diameter of the ring, if it is known: then there is one level only.
        stroke: width of the ring's black over its radius.
    """
    larger = max(1.0, _STROKE / stroke)
    h, w = image.shape
    part = Window(0, 0, w, h) if window is None else window.within(w, h)
    crop = image[part.y0 : part.y1, part.x0 : part.x1]
    size = max(crop.shape)
    if expected_px is not None:
        # Small rings are looked for in an enlarged window: their holes are few pixels wide.
        shown_px = larger * _SEARCH_DIAMETER_PX
        halvings = [max(-1, round(math.log2(max(expected_px, 1.0) / shown_px)))]
    else:
        coarsest = max(0, math.ceil(math.log2(max(size, 1) / _COARSEST_PX)))
        halvings = list(range(coarsest + 1))
    made: list[Level] = []
    seeing = camera.seeing(part)
    for n in halvings:
        k = 2.0**n
        reduced = int(crop.shape[1] / k), int(crop.shape[0] / k)
        if min(reduced) < _SMALLEST_SIDE_PX:
            break
        largest_px = larger * (_LARGEST_PX if n > 0 else _SMALL_PX)
        largest_px = math.inf if n == halvings[-1] else largest_px
        finer = made[-1] if made else crop
        made.append(Level(finer, seeing, reduced, (part.x0, part.y0), k, largest_px))
    return made[::-1]


def is_blank(image: U8) -> bool:
    """Tell whether an image (height, width) shows nothing that could be a marker, like clear sky.

    On such an image this takes a thirtieth of the time of a search. The last row or column of an
    odd number is not looked at.
    """
    near, reach = np.ones((_STEP_PX, _STEP_PX), np.uint8), _STEP_PX // 2
    h, w = max(1, image.shape[0] // 2), max(1, image.shape[1] // 2)
    for top in range(0, h, _STRIP_PX):  # mostly the first strip settles it
        part = image[2 * max(0, top - reach) : 2 * min(h, top + _STRIP_PX + reach), : 2 * w]
        size = w, max(1, len(part) // 2)
        strip = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
        if cv2.minMaxLoc(cv2.morphologyEx(strip, cv2.MORPH_GRADIENT, near))[1] >= _LEAST_STEP:
            return False
    return True
