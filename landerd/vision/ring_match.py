"""Where a ring may lie on level ground, by the directions of its edges' gradients.

Shadows, leaf shade, dirt and blur break a ring's edges and leave no dark component that is round as
a whole, but most gradients along what is left of the edges still point the right way. Gravity tells
how the ring of a level pad is foreshortened anywhere in the image, so that only place and size are
searched: by the mean cosine between the gradients of logarithmic levels and the directions from
black to white along both edges (Steger, "Occlusion, clutter, and illumination invariant object
recognition", ISPRS 2002). Of the pads of 16 px and larger that were missed on 100 field days half
are among the four best places of the picture, and two thirds of those from 20 px on. By the
correlation of levels it was two fifths, and none with a hard shadow across.

`ring_search` and `plate_ring` take these places as starts (the parts MATCH of a search).
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel, Window
from landerd.geometry import Vec3
from landerd.pad import Ring
from landerd.vision.arrays import F32, U8
from landerd.vision.pose import circle, rotation_2d

# Longer diameters that are looked for: the smallest, px, the factor from one to the next, and their
# number. A size matches rings up to a ninth smaller or larger.
SMALLEST_PX, STEP, SIZES = 18.0, 1.22, 9
_MATCHED_PX = 15.0  # longer diameter in the image as it is reduced for a size
_PARTS = 4  # of the image in either direction: within one, foreshortening is taken to be the same
_LEAST_COS = 0.3  # of the angle between line of sight and gravity
# Numbers of steps in which ellipses are made: of the cosine, and of half a turn.
_COSINES, _TURNS = 20, 24
# How many ellipses are kept: those of all sizes and parts of an image, 7 MB at 640x480.
_KEPT_PRINTS = SIZES * _PARTS**2
_POINTS = 120  # on either edge
_REACH_PX = math.ceil(0.5 * _MATCHED_PX) + 2  # of a print about its middle
DARK = 8.0  # grey levels, added before the logarithm: darker levels are only noise
_LOGARITHMS = np.log(np.arange(256, dtype=np.float32) + np.float32(DARK))
_FAINT = 0.08  # gradient that counts by half, of the logarithm, 1/px
_LEAST_MATCH = 0.4  # mean cosine
_SAME_PLACE = 0.4  # distance below which two places are one, a share of the smaller size
_PEAK_PX = 7  # side of the surroundings in which only the best place counts


def matches(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    down: Vec3,
    sizes: Sequence[float],
    most: int,
    window: Window | None = None,
) -> list[F64]:
    """Return the centres (3,), camera frame, m, of the best matches of a level ring, best first.

    Args:
        image: grey image (height, width).
        camera: the lens.
        ring: its true size and ratio.
        down: unit vector of gravity, camera frame.
        sizes: longer diameters that are looked for, px.
        most: largest number of centres.
        window: pixels to search; None: all.
    """
    h, w = image.shape
    part = Window(0, 0, w, h) if window is None else window.within(w, h)
    crop = image[part.y0 : part.y1, part.x0 : part.x1]
    shapes = _shapes(camera, part, np.array(down), 1 if window is not None else _PARTS)
    crops = _halvings(crop, max(sizes) / _MATCHED_PX)
    found = [m for size in sizes for m in _of_size(crops, ring.inner_ratio, size, shapes)]
    kept: list[tuple[float, float, F64]] = []
    for one in sorted(found, key=lambda m: -m[0]):
        if len(kept) == most:
            break
        if all(not _is_same(one, other) for other in kept):
            kept.append(one)
    focal = camera.focal
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
    """Return parts of the image, as shares of it, with a level ring's foreshortening in each.

    Foreshortening is its cosine and the direction of its shorter diameter, in steps.
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


def _halvings(image: U8, most: float) -> list[U8]:
    """Return an image and what is left of it after each halving, reduced by no more than `most`.

    Reducing the last of these that is still larger takes a tenth of the time of reducing the image
    itself by the mean of areas, and shows as many rings.
    """
    made = [image]
    for _ in range(int(math.log2(max(most, 1.0)))):
        h, w = (n // 2 * 2 for n in made[-1].shape)
        if min(h, w) < 2:
            break
        half = cv2.resize(made[-1][:h, :w], (w // 2, h // 2), interpolation=cv2.INTER_AREA)
        made.append(np.asarray(half, dtype=np.uint8))
    return made


def _of_size(
    crops: Sequence[U8],
    ratio: float,
    size: float,
    shapes: list[tuple[tuple[float, float, float, float], int, int]],
) -> list[tuple[float, float, F64]]:
    """Return mean cosine, size and place (2,), px of the crop, of all local maxima at a size.

    `crops` are the crop and what is left of it after each halving.
    """
    k = size / _MATCHED_PX
    h, w = (round(n / k) for n in crops[0].shape)
    if min(h, w) < 1:
        return []
    halvings = min(len(crops) - 1, int(math.log2(max(k, 1.0))))
    small = cv2.resize(crops[halvings], (w, h), interpolation=cv2.INTER_LINEAR)
    directions = _directions(np.asarray(small, dtype=np.uint8))
    found = []
    n = _REACH_PX
    for (x0, y0, x1, y1), cosine, turn in shapes:
        left, top = max(0, int(x0 * w) - n), max(0, int(y0 * h) - n)
        columns, rows = min(w, int(x1 * w) + n) - left, min(h, int(y1 * h) + n) - top
        if min(rows, columns) <= 2 * n + 1:
            continue
        match = _correlated(directions[top:, left:], (rows, columns), ratio, cosine, turn)
        if cv2.minMaxLoc(match)[1] <= _LEAST_MATCH:
            continue
        best = cv2.dilate(match, np.ones((_PEAK_PX, _PEAK_PX), np.uint8))
        peaks = np.flatnonzero((match > _LEAST_MATCH) & (match == best))
        for y, x in zip(*np.divmod(peaks, match.shape[1]), strict=True):
            at = (np.array((x + left + n, y + top + n)) + 0.5) * k - 0.5
            found.append((float(match[y, x]), size, at))
    return found


def _directions(image: U8) -> F32:
    """Return unit vectors from dark to bright, right and down, shorter where faint, (h, w, 2)."""
    levels = cv2.LUT(image, _LOGARITHMS)
    x, y = (cv2.Scharr(levels, cv2.CV_32F, *way, scale=1.0 / 32.0) for way in ((1, 0), (0, 1)))
    length = cv2.magnitude(x, y) + np.float32(_FAINT)
    return np.asarray(cv2.merge((cv2.divide(x, length), cv2.divide(y, length))), dtype=np.float32)


def _correlated(
    directions: F32, shape: tuple[int, int], ratio: float, cosine: int, turn: int
) -> F32:
    """Return the mean cosine with a print at each place where that is wholly inside a part.

    By Fourier transforms of complex numbers, right the real and down the imaginary part: the real
    part of directions by the print's conjugate is the sum of both products.

    Args:
        directions: in the image from the part's first row and column on.
        shape: rows and columns of the part.
        ratio: inner over outer diameter of the ring.
        cosine: of its foreshortening, in steps.
        turn: direction of that, in steps.
    """
    rows, columns = (cv2.getOptimalDFTSize(n) for n in shape)
    product = _spectrum(directions[:rows, :columns], rows, columns)
    product *= _print_spectrum(ratio, cosine, turn, rows, columns)
    match = cv2.idft(product.view(np.float32), flags=cv2.DFT_SCALE)
    inside = match[: shape[0] - 2 * _REACH_PX, : shape[1] - 2 * _REACH_PX]
    return np.asarray(cv2.extractChannel(inside, 0), dtype=np.float32)


def _spectrum(directions: F32, rows: int, columns: int) -> NDArray[np.complex64]:
    """Return the Fourier transform of directions (h, w, 2), padded to rows and columns."""
    h, w = directions.shape[:2]
    if (h, w) != (rows, columns):
        bottom, right = rows - h, columns - w
        directions = np.asarray(
            cv2.copyMakeBorder(directions, 0, bottom, 0, right, cv2.BORDER_CONSTANT), np.float32
        )
    return np.asarray(cv2.dft(directions), dtype=np.float32).view(np.complex64)


@lru_cache(maxsize=_KEPT_PRINTS)
def _print_spectrum(
    ratio: float, cosine: int, turn: int, rows: int, columns: int
) -> NDArray[np.complex64]:
    """Return the conjugate of the Fourier transform of `_print`, padded to rows and columns."""
    return _spectrum(_print(ratio, cosine, turn), rows, columns).conj()


def _print(ratio: float, cosine: int, turn: int) -> F32:
    """Return the edges of a ring of a ratio at a foreshortening given in steps.

    Directions from black to white, right and down, (2 n + 1, 2 n + 1, 2); their lengths add up to
    1.
    """
    n = _REACH_PX
    R = rotation_2d(math.pi * turn / _TURNS)
    foreshortened = np.array([(cosine / _COSINES,), (1.0,)])
    around = circle(1.0, _POINTS).T
    outwards = R @ (around / foreshortened)  # as long as the edge from point to point
    edges = np.zeros((2 * n + 1, 2 * n + 1, 2))
    for share, sign in ((1.0, 1.0), (ratio, -1.0)):
        at = R @ (around * foreshortened) * (0.5 * share * _MATCHED_PX) + n
        corner = np.floor(at).astype(int)
        for step in ((0, 0), (1, 0), (0, 1), (1, 1)):
            near = corner + np.array(step)[:, None]
            weights = sign * share * np.prod(1.0 - np.abs(at - near), axis=0)
            np.add.at(edges, (near[1], near[0]), (weights * outwards).T)
    total = (1.0 + ratio) * float(np.hypot(*outwards).sum())
    return (edges / total).astype(np.float32)
