"""Where in an image a dark ring could be: threshold, components, shape, grey levels.

Every test here is invariant under affine maps of the image, because an oblique ring is as much a
ring as one seen from above.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]
I32 = NDArray[np.int32]

# Where nothing else is said, the limits were set by trial when the segmentation was written, on the
# images of `bench.vision_ring`. What true rings give was measured afterwards, on 400 of its images
# of 1.5 to 25 m at 0 to 60 degrees, at every level of the pyramid that shows them at 8 to 110 px,
# with both thresholds: 2100 components.

# Shares of the local mean below which a pixel is dark. Of 20 rings half in a shadow of a fifth of
# the light the first sees 14 and the last all; it would lose black that a tone curve has raised.
THRESHOLDS = (0.65, 0.88, 0.45)
MIN_EXTENT_PX = 5  # of a ring's shorter side: below, its hole is no pixel any more
_LOCAL_MEAN_PX = 25  # side of the local mean: wider than the dark stroke of a ring of 85 px
_MAX_COMPONENTS = 200  # looked at, largest first: bounds the time in an image of noise
_MAX_OUTLINES = 8  # returned

# Of a component and its upright box.
_MAX_ASPECT = 4  # longer over shorter side: a ring at 75 degrees; true ones gave at most 2.8
_MAX_EXTENT = 0.9  # longer side over the image's: what fills a level is no ring in it
# Area over the box's. A ring of the thesis's ratio fills 0.65 of it frontally and 0.31 at the limit
# of aspect, turned by 45 degrees; true ones gave 0.25 (larger than the local mean) to 0.75. A thin
# ring, of a ratio above 0.8, is not found.
_MIN_FILL, _MAX_FILL = 0.25, 0.85
_MAX_OFF_CENTRE = 0.12  # centroid from the box's middle, over the longer side; true ones: 0.071
# Area over root of the second moments' determinant, over a ring's; true ones gave at most 1.09, but
# 2 % gave less than 0.7 with the lower threshold: larger than the local mean, or below 15 px.
_MIN_COMPACTNESS, _MAX_COMPACTNESS = 0.7, 1.3

# Grey levels are compared on three ellipses, scaled from the outline: inside the hole (in its own
# radii), along the middle of the stroke, and around, three quarters across the thesis's margin.
_HOLE_SCALE, _AROUND_SCALE = 0.4, 1.18
_MIN_POINTS = 10  # of each ellipse's 16 that must be in the image
_DARK_QUANTILE, _BRIGHT_QUANTILE = 0.8, 0.2  # so that a fifth of an ellipse may be hidden
_MIN_STEP = 8.0  # grey levels, 2.7 sigma of those images' noise; true rings gave at least 38
_SPREAD_FLOOR = 10.0  # grey levels, added to the stroke's spread: below that is noise

_ANGLES = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])


@dataclass(frozen=True)
class Ellipse:
    """Outer edge of a ring in pixels: points centre + axes (cos a, sin a)."""

    centre: F64  # (2,)
    axes: F64  # (2, 2), columns are the semi-axes

    def points(self, scale: float = 1.0) -> F64:
        """Return 16 pixels (16, 2) on the ellipse scaled about its centre."""
        p: F64 = self.centre[:, None] + scale * (self.axes @ _CIRCLE)
        return p.T

    def moved(self, x: float, y: float) -> "Ellipse":
        """Return the ellipse shifted by (x, y)."""
        return Ellipse(self.centre + np.array([x, y]), self.axes)


def ring_candidates(image: U8, inner_ratio: float, threshold: float) -> list[Ellipse]:
    """Return outlines of what looks like a dark ring of 6 to about 120 px, the likeliest first.

    `threshold` is the share of the local mean below which a pixel is dark. A low one parts a ring
    from a dark surrounding and from a shadow, a high one sees weak contrast.
    """
    labels, stats, picked = _ring_like(image, threshold)
    seen = []
    for i in picked[:_MAX_COMPONENTS]:
        x, y, cw, ch = (int(v) for v in stats[i, :4])
        mask = (labels[y : y + ch, x : x + cw] == i).astype(np.uint8) * 255
        ellipse = _outline(mask, inner_ratio)
        if ellipse is None:
            continue
        ellipse = ellipse.moved(x, y)
        score = ring_score(image, ellipse, inner_ratio)
        if score > 0.0:
            seen.append((score, ellipse))
    seen.sort(key=lambda found: -found[0])
    return [ellipse for _, ellipse in seen[:_MAX_OUTLINES]]


def _ring_like(image: U8, threshold: float) -> tuple[I32, I32, NDArray[np.intp]]:
    """Return the labels of dark components, OpenCV's statistics of them, and those like rings.

    The last, largest first, by size, fill and symmetry of the component and of its box.
    """
    mean = cv2.blur(image, (_LOCAL_MEAN_PX, _LOCAL_MEAN_PX), borderType=cv2.BORDER_REPLICATE)
    dark = cv2.compare(image, cv2.convertScaleAbs(mean, alpha=threshold), cv2.CMP_LT)
    _, labels, stats, centroids = cv2.connectedComponentsWithStats(
        dark, connectivity=4, ltype=cv2.CV_32S
    )
    w, h = stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]
    size = np.maximum(w, h)
    fill = stats[:, cv2.CC_STAT_AREA] / (w * h)
    middle = stats[:, :2] + (stats[:, 2:4] - 1) / 2.0
    off = np.abs(centroids - middle).max(axis=1) / size
    good = (
        (np.minimum(w, h) >= MIN_EXTENT_PX)
        & (np.minimum(w, h) * _MAX_ASPECT >= size)
        & (size < _MAX_EXTENT * max(image.shape))
        & (fill > _MIN_FILL)
        & (fill < _MAX_FILL)
        & (off < _MAX_OFF_CENTRE)
    )
    at = np.rint(centroids).astype(np.intp)
    picked = np.flatnonzero(good[1:]) + 1
    picked = picked[labels[at[picked, 1], at[picked, 0]] != picked]  # the hole is not dark
    largest_first = picked[np.argsort(-size[picked], kind="stable")]
    return np.asarray(labels, np.int32), np.asarray(stats, np.int32), largest_first


def _outline(mask: U8, k: float) -> Ellipse | None:
    """Return the outer ellipse of a mask's ring from its moments, or None if it is no ring.

    The second moments of a ring with semi-axes A are A A^T (1 + k^2) / 4, its area is
    pi det A (1 - k^2): area over root of the moments' determinant tells a ring of any obliqueness
    from discs and bars.
    """
    m = cv2.moments(mask, binaryImage=True)
    area = m["m00"]
    # A pixel is a square: its own second moment is not the ring's.
    xx, yy, xy = m["mu20"] / area, m["mu02"] / area, m["mu11"] / area
    det = xx * yy - xy * xy
    if det <= 0.0:
        return None
    compactness = area / math.sqrt(det)
    ideal = 4.0 * math.pi * (1.0 - k * k) / (1.0 + k * k)
    if not _MIN_COMPACTNESS * ideal < compactness < _MAX_COMPACTNESS * ideal:
        return None
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    axes = vectors * np.sqrt(values * 4.0 / (1.0 + k * k))
    return Ellipse(np.array([m["m10"] / area, m["m01"] / area]), axes)


def ring_score(image: U8, ellipse: Ellipse, k: float) -> float:
    """Return by how much hole and surroundings are brighter than the stroke, over its spread.

    Zero or less is no ring.
    """
    h, w = image.shape
    levels = []
    for scale in (_HOLE_SCALE * k, (1.0 + k) / 2.0, _AROUND_SCALE):
        p = np.rint(ellipse.points(scale)).astype(np.intp)
        inside = (p[:, 0] >= 0) & (p[:, 0] < w) & (p[:, 1] >= 0) & (p[:, 1] < h)
        if np.count_nonzero(inside) < _MIN_POINTS:
            return 0.0
        p = p[inside]
        levels.append(np.sort(image[p[:, 1], p[:, 0]].astype(np.float64)))
    hole, stroke, around = levels
    dark = stroke[int(_DARK_QUANTILE * len(stroke))]
    step = float(min(hole[len(hole) // 2], around[len(around) // 2]) - dark) - _MIN_STEP
    if around[int(_BRIGHT_QUANTILE * len(around))] <= stroke[len(stroke) // 2]:
        return 0.0
    return step / (_SPREAD_FLOOR + float(dark - stroke[int(_BRIGHT_QUANTILE * len(stroke))]))
