"""Where a ring may lie on level ground, by correlation with what it would look like there.

Leaf shade, dirt and blur break a ring's edges and leave nothing dark that is as a whole round, but
on the whole hole and margin are still brighter than the stroke. Gravity tells how the ring of a
level pad is foreshortened wherever it is in the image, so that it is looked for by place and size
alone: by the correlation coefficient of logarithmic levels with white, black, white within an
ellipse. Half of the pads that were missed on 100 field days, 16 px and larger, are among the five
likest places of the picture so, nine in ten in leaf shade from 24 px on.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.pad import Ring
from landerd.vision.ring_pixels import F32
from landerd.vision.window import Window

U8 = NDArray[np.uint8]

# Larger diameters, px, that are looked for: a size matches rings to a ninth smaller and larger.
SMALLEST_PX, STEP, SIZES = 18.0, 1.22, 9
_MATCHED_PX = 15.0  # larger diameter in the reduced image
_MARGIN = 1.22  # of white about the ring that is asked for, of its radius: within any plate's
_BLUR_PX = 0.6  # of the ring in the reduced image
_PARTS = 4  # of the image, each way: in each the ring is foreshortened alike
_LEAST_COS = 0.3  # of the angle between line of sight and gravity
# Steps of the ellipses that are made once: of the cosine, and of half a turn.
_COSINES, _TURNS = 20, 24
_SUPERSAMPLED = 5
DARK = 8.0  # grey levels, added before the logarithm: below, noise is all there is
_LEAST_SCATTER = 0.03  # of the logarithm
_LEAST_MATCH = 0.42  # correlation
_SAME_PLACE = 0.4  # of the smaller size
_PEAK_PX = 7  # about a place no other counts


@dataclass(frozen=True, slots=True)
class _Print:
    """A ring in its margin, at one foreshortening."""

    weights: F32  # (2 n + 1, 2 n + 1), of mean zero within the ellipse, zero beyond
    box: tuple[int, int]  # that holds it, px
    norm: float


def matches(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    down: Vec3,
    sizes: Sequence[float],
    most: int,
    window: Window | None = None,
) -> list[F64]:
    """Return centres (3,) of what is likest a level ring, camera frame, m, the likest first.

    Args:
        image: grey image (height, width).
        camera: the lens.
        ring: its true size and ratio.
        down: unit vector of gravity, camera frame.
        sizes: larger diameters that are looked for, px.
        most: at most so many.
        window: pixels to search; None: all.
    """
    h, w = image.shape
    part = Window(0, 0, w, h) if window is None else window.within(w, h)
    crop = image[part.y0 : part.y1, part.x0 : part.x1]
    shapes = _shapes(camera, part, np.array(down), 1 if window is not None else _PARTS)
    found = [m for size in sizes for m in _of_size(crop, ring.inner_ratio, size, shapes)]
    kept: list[tuple[float, float, F64]] = []
    for one in sorted(found, key=lambda m: -m[0]):
        if len(kept) == most:
            break
        if all(not _is_same(one, other) for other in kept):
            kept.append(one)
    focal = math.sqrt(camera.fx * camera.fy)
    centres, corner = [], np.array((part.x0, part.y0))
    for _, size, at in kept:
        ray = np.append(camera.rays((at + corner)[None])[0], 1.0)
        centres.append(ray / np.linalg.norm(ray) * (focal * ring.outer_diameter_m / size))
    return centres


def _is_same(one: tuple[float, float, F64], other: tuple[float, float, F64]) -> bool:
    apart = float(np.hypot(*(one[2] - other[2])))
    return apart < _SAME_PLACE * min(one[1], other[1])


def _shapes(
    camera: CameraModel, part: Window, down: F64, parts: int
) -> list[tuple[tuple[float, float, float, float], int, int]]:
    """Return the parts of the image, as shares of it, and how the ring is foreshortened in each.

    That is its cosine and the way of its shorter diameter, in steps.
    """
    shares = np.arange(parts) / parts
    corners = [(x, y, x + 1.0 / parts, y + 1.0 / parts) for y in shares for x in shares]
    corner, size = np.array((part.x0, part.y0)), np.array((part.x1 - part.x0, part.y1 - part.y0))
    middles = np.array([(x0 + x1, y0 + y1) for x0, y0, x1, y1 in corners]) * 0.5 * size
    flat = camera.rays(middles + corner)
    rays = np.column_stack([flat, np.ones(len(flat))])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    cosines = rays @ down
    aside = down - cosines[:, None] * rays
    way = aside[:, :2] - aside[:, 2:] * flat
    turns = np.rint(np.arctan2(way[:, 1], way[:, 0]) / math.pi * _TURNS).astype(int) % _TURNS
    steps = np.rint(cosines * _COSINES).astype(int)
    return [
        (share, int(cosine), int(turn))
        for share, cosine, turn, c in zip(corners, steps, turns, cosines, strict=True)
        if c > _LEAST_COS
    ]


def _of_size(
    crop: U8,
    ratio: float,
    size: float,
    shapes: list[tuple[tuple[float, float, float, float], int, int]],
) -> list[tuple[float, float, F64]]:
    """Return correlation, size and place (2,), px of the part, of all likest places of a size."""
    k = size / _MATCHED_PX
    h, w = (round(n / k) for n in crop.shape)
    if min(h, w) < 1:
        return []
    interpolation = cv2.INTER_AREA if k > 1.0 else cv2.INTER_LINEAR
    small = cv2.resize(crop, (w, h), interpolation=interpolation)
    levels = np.log(small.astype(np.float32) + np.float32(DARK))
    found = []
    for (x0, y0, x1, y1), cosine, turn in shapes:
        shape = _print(ratio, cosine, turn)
        n = len(shape.weights) // 2
        left, top = max(0, int(x0 * w) - n), max(0, int(y0 * h) - n)
        part = levels[top : int(y1 * h) + n, left : int(x1 * w) + n]
        if min(part.shape) <= 2 * n + 1:
            continue
        match = _correlation(part, shape, n)
        peaks = (match == cv2.dilate(match, np.ones((_PEAK_PX, _PEAK_PX), np.uint8))) & (
            match > _LEAST_MATCH
        )
        for y, x in zip(*np.nonzero(peaks), strict=True):
            at = (np.array((x + left + n, y + top + n)) + 0.5) * k - 0.5
            found.append((float(match[y, x]), size, at))
    return found


def _correlation(part: F32, shape: _Print, n: int) -> F32:
    """Return correlation coefficients at all places where a print lies wholly in a part.

    Mean and scatter are those of the box about the ellipse.
    """
    inner = slice(n, part.shape[0] - n), slice(n, part.shape[1] - n)
    mean = cv2.boxFilter(part, -1, shape.box)[inner]
    square = cv2.sqrBoxFilter(part, cv2.CV_32F, shape.box)[inner]
    scatter = np.sqrt(np.maximum(square - mean * mean, _LEAST_SCATTER**2))
    both = cv2.matchTemplate(part, shape.weights, cv2.TM_CCORR)
    return np.asarray(both / (shape.norm * scatter), dtype=np.float32)


@lru_cache(maxsize=512)
def _print(ratio: float, cosine: int, turn: int) -> _Print:
    """Return the print of a ring of a ratio, with a foreshortening in steps."""
    n = math.ceil(0.5 * _MARGIN * _MATCHED_PX) + 1
    fine = (np.arange((2 * n + 1) * _SUPERSAMPLED) + 0.5) / _SUPERSAMPLED - 0.5 - n
    x, y = np.meshgrid(fine, fine)
    c, s = math.cos(math.pi * turn / _TURNS), math.sin(math.pi * turn / _TURNS)
    radius = np.hypot((c * x + s * y) * (_COSINES / cosine), c * y - s * x) / (0.5 * _MATCHED_PX)
    inside = radius < _MARGIN
    white = np.where((radius < ratio) | (radius > 1.0), 1.0, -1.0) * inside

    def reduced(fine_levels: F64) -> F32:
        cells = fine_levels.reshape(2 * n + 1, _SUPERSAMPLED, 2 * n + 1, _SUPERSAMPLED)
        return np.asarray(cells.mean(axis=(1, 3)), dtype=np.float32)

    mask = reduced(inside.astype(np.float64)) > 0.4
    blurred = cv2.GaussianBlur(reduced(white), (0, 0), _BLUR_PX)
    weights: F32 = (mask * (blurred - blurred[mask].mean())).astype(np.float32)
    box = int(mask.any(axis=0).sum()), int(mask.any(axis=1).sum())
    norm = math.sqrt(float((weights * weights).sum()) * float(mask.sum()))
    return _Print(weights, box, norm)
