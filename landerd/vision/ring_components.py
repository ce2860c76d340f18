"""The connected components of dark pixels in an image, or in several at once, for `ring_segment`.

Labelling a small image takes less time than the call that does it. Images that are searched the
same way are therefore laid out below one another, and their components labelled together.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.vision.arrays import U8, Mask

Indices = NDArray[np.intp]

_MIN_AREA_PX = 12  # a ring of 5 px without its hole
_MIN_HOLE = 0.05  # of a component's area: a plain ring's has 0.2
_MIN_CORNERS = 6  # of a hull: five define an ellipse


@dataclass(frozen=True)
class Components:
    """Dark components of several images, arrays (n,): area, middle and second moments.

    Middles are in the pixels of their own image. Second moments are central, over the area, px^2.
    """

    part: Indices  # number of the image
    area: F64
    x: F64
    y: F64
    xx: F64
    yy: F64
    xy: F64

    def at(self, picked: Indices) -> "Components":
        """Return some of the components."""
        moments = (self.area, self.x, self.y, self.xx, self.yy, self.xy)
        return Components(self.part[picked], *(values[picked] for values in moments))


class Mosaic:
    """Grey images, and what is dark in them under one another with a margin of what is not."""

    def __init__(self, images: Sequence[U8], darks: Sequence[U8]) -> None:
        """Lay out images (height, width), and as many that are 255 where it is dark, else 0."""
        self.heights = np.array([len(image) for image in images])
        self.widths = np.array([image.shape[1] for image in images])
        self._grey = [np.ravel(image) for image in images]
        sizes = self.heights * self.widths
        self._first = np.cumsum(sizes) - sizes  # of each image's pixels
        tops = np.zeros(len(images) + 1, np.intp)
        np.cumsum(self.heights + 1, out=tops[1:])
        self._tops = tops
        # A column on either side, so that no run goes on in the next row.
        self._dark = np.zeros((int(self._tops[-1]), int(self.widths.max()) + 2), np.uint8)
        for dark, top in zip(darks, self._tops[:-1].tolist(), strict=True):
            h, w = dark.shape
            self._dark[top : top + h, 1 : w + 1] = dark

    def grey(self, part: Indices, rows: Indices, columns: Indices) -> U8:
        """Return the grey levels of pixels of images; arrays of shapes that fit one another."""
        grey = self._grey[0] if len(self._grey) == 1 else np.concatenate(self._grey)
        levels: U8 = grey[self._first[part] + rows * self.widths[part] + columns]
        return levels

    def components(self, largest_px: float, holed_px: F64) -> Components:
        """Return the components that could be rings by their area and their centre.

        A component whose area is below `holed_px` must not be dark at its centre: that alone rules
        out four fifths of those in textures.

        Args:
            largest_px: diameter of the largest ring wanted.
            holed_px: area from which on the centre does not matter, px, (images,).
        """
        # OpenCV's own statistics would take longer than labelling, and lack the second moments.
        count, labelled = cv2.connectedComponents(self._dark, connectivity=4, ltype=cv2.CV_32S)
        labels = np.asarray(labelled, dtype=np.int32)
        first, length = _runs(self._dark)
        of: NDArray[np.signedinteger] = labels.reshape(-1)[first]
        area = np.bincount(of, length, count)
        is_sized = (area >= _MIN_AREA_PX) & (area <= 0.25 * math.pi * largest_px**2)
        label, used, of = _picked(is_sized, of)
        area_px = area[label].astype(np.float64)
        row, column = np.divmod(first[used], labels.shape[1])
        px, y = length[used].astype(np.float64), row.astype(np.float64)
        x = column + (0.5 * (px - 1.0) - 1.0)
        n = len(label)
        cx, cy = np.bincount(of, px * x, n) / area_px, np.bincount(of, px * y, n) / area_px
        is_open = labels[np.rint(cy).astype(np.intp), np.rint(cx).astype(np.intp) + 1] != label
        part = np.searchsorted(self._tops, cy, side="right") - 1
        picked, used, of = _picked(is_open | (area_px >= holed_px[part]), of)
        part, cx, cy, area_px = part[picked], cx[picked], cy[picked], area_px[picked]
        x, y, px = x[used] - cx[of], y[used] - cy[of], px[used]
        within = (px * px - 1.0) / 12.0  # a run's own second moment
        products = (x * x + within, y * y, x * y)
        n = len(picked)
        xx, yy, xy = (np.bincount(of, px * product, n) / area_px for product in products)
        return Components(part, area_px, cx, cy - self._tops[part], xx, yy, xy)

    def hole(self, c: Components, i: int) -> F64 | None:
        """Return the centroid (2,), px of its image, of the largest hole near component i.

        None: no hole there is large enough.
        """
        box, x0, y0 = self._box(c, i)
        contours, tree = cv2.findContours(box, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
        holes = [contour for contour, of in zip(contours, tree[0], strict=True) if of[3] >= 0]
        if not holes:
            return None
        m = cv2.moments(max(holes, key=cv2.contourArea))
        if m["m00"] < _MIN_HOLE * c.area[i]:
            return None
        return np.array([x0 + m["m10"] / m["m00"], y0 + m["m01"] / m["m00"]])

    def outer_edge(self, c: Components, i: int) -> tuple[F64, F64] | None:
        """Return centre (2,) and axes (2, 2) of an ellipse through the hull of component i, px.

        It is fitted to the corners of the hull, which lie on what is left of a broken ring's
        outline. None: the hull has too few corners.
        """
        box, x0, y0 = self._box(c, i)
        contours, _ = cv2.findContours(box, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        hull = cv2.convexHull(max(contours, key=len)) if contours else ()
        if len(hull) < _MIN_CORNERS:
            return None
        (x, y), widths, angle = cv2.fitEllipseDirect(np.asarray(hull))
        if not np.isfinite((x, y, *widths)).all():
            return None
        radii = 0.5 * (np.array(widths) + 1.0)  # corners are the middles of pixels
        a = math.radians(angle)
        turn = np.array([(math.cos(a), -math.sin(a)), (math.sin(a), math.cos(a))])
        return np.array([x0 + x, y0 + y]), turn * radii

    def _box(self, c: Components, i: int) -> tuple[U8, int, int]:
        """Return what is dark about one of the components, and where that begins, x and y."""
        part, x, y = int(c.part[i]), float(c.x[i]), float(c.y[i])
        # An ellipse's own reach is 2 sigmas, and perspective stretches it.
        across, down = 3.0 * math.sqrt(c.xx[i]), 3.0 * math.sqrt(c.yy[i])
        x0, x1 = max(math.floor(x - across), 0), min(math.ceil(x + across) + 1, self.widths[part])
        y0, y1 = max(math.floor(y - down), 0), min(math.ceil(y + down) + 1, self.heights[part])
        top = int(self._tops[part])
        return self._dark[top + y0 : top + y1, x0 + 1 : x1 + 1], x0, y0


def _picked(good: Mask, of: NDArray[np.signedinteger]) -> tuple[Indices, Indices, Indices]:
    """Return the indices of good components, those of their runs, and each run's new component.

    `good` is for each component (n,); `of` is the component of each run (m,).
    """
    used = np.flatnonzero(good[of])
    return np.flatnonzero(good), used, (np.cumsum(good) - 1)[of[used]]


def _runs(padded: U8) -> tuple[Indices, Indices]:
    """Return first pixel, counted row by row, and length of the runs of what is dark.

    They are a quarter of the pixels. No run reaches the left or right edge.
    """
    flat = padded.reshape(-1)
    ends = np.flatnonzero(flat[1:] != flat[:-1]) + 1  # first pixels and, one by one, those beyond
    return ends[::2], ends[1::2] - ends[::2]
