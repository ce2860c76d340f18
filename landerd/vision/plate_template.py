"""How well what lies about a ring fits the pad's plate: white, with darker prints, before ground.

The picture is sampled in polar coordinates about the ring's centre, so that each heading of the
plate is a shift of the samples.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.pad import PadLayout, Plate, Ring, Square
from landerd.vision.patch import levels_at, on_plate
from landerd.vision.pose import rotation_2d

U8 = NDArray[np.uint8]
Mask = NDArray[np.bool_]

HEADINGS = 64
# In radii of the ring: where samples begin, how far apart they are, how far beyond the plate they
# go, and what is left out on either side of its edge.
_BEGIN, _STEP, _BEYOND, _EDGE = 1.06, 0.08, 0.35, 0.04
_PRINT, _BESIDE_PRINT = 0.85, 1.15  # times a marker's size: within its print, and beside it
_LEAST_SEEN = 0.7  # of the samples of each kind, or nothing is said of a heading
_SPREAD = 0.7  # share of the white samples that are no farther from their median
_CLIPPED = 250.0  # grey level
_NOISE_SHARE = 0.05  # of the ring's contrast, that any picture has


class PlateTemplate:
    """Where about one ring of a pad its plate is white, where printed, and where ground begins."""

    def __init__(self, layout: PadLayout, ring: Ring) -> None:
        """Prepare the samples; needs a pad with other markers beside the ring."""
        plate, radius = layout.plate, ring.radius_m
        middle = np.array(ring.position_m)
        corners = np.array([[plate.north_m, plate.east_m], [-plate.south_m, -plate.west_m]])
        reach = math.hypot(*np.abs(corners - middle).max(axis=0)) + _BEYOND * radius
        radii = np.arange(_BEGIN * radius, reach, _STEP * radius)
        angles = np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS)
        across = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        self._points: F64 = (radii[:, None, None] * across).reshape(-1, 2)
        on_pad = self._points + middle
        is_printed, is_near = _prints(layout, ring, on_pad)
        is_inside = on_plate(_grown(plate, -_EDGE * radius), on_pad)
        is_ground = on_plate(_grown(plate, _BEYOND * radius), on_pad)
        is_ground &= ~on_plate(_grown(plate, _EDGE * radius), on_pad)
        self._white = _turned(is_inside & ~is_near)
        self._printed = _turned(is_inside & is_printed)
        self._ground = _turned(is_ground)

    def fits(self, image: U8, camera: CameraModel, t: F64, axes: F64, contrast: float) -> F64:
        """Return by how much plate stands out under each heading, over how uneven it is.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: the ring's centre (3,), camera frame, m.
            axes: two unit vectors (3, 2) in the ring's plane.
            contrast: of the ring, from black to white, grey levels.

        Returns:
            (headings,); NaN where too little is in the picture.
        """
        levels = levels_at(image, camera, t + self._points @ axes.T)
        white, printed, ground = (levels[at] for at in (self._white, self._printed, self._ground))
        median = _quantile(white, 0.5)
        spread = _quantile(np.abs(white - median[:, None]), _SPREAD)
        step = 2.0 * (median - mean_seen(printed))
        # White over full scale hides how bright the ground is.
        step = np.where(median < _CLIPPED, np.minimum(step, median - mean_seen(ground)), step)
        fits: F64 = step / (spread + _NOISE_SHARE * max(contrast, 1.0))
        is_seen = [share_seen(kind) >= _LEAST_SEEN for kind in (white, printed, ground)]
        return np.where(np.all(is_seen, axis=0), fits, np.nan)


def _grown(plate: Plate, by: float) -> Plate:
    """Return a plate that is so much larger on every side, m."""
    sides = (plate.north_m, plate.south_m, plate.east_m, plate.west_m)
    north, south, east, west = (side + by for side in sides)
    return Plate(north_m=north, south_m=south, east_m=east, west_m=west)


def _prints(layout: PadLayout, ring: Ring, points: F64) -> tuple[Mask, Mask]:
    """Tell which points (n, 2) of the pad are on other markers' prints, and which are near them."""
    distance = np.full(len(points), np.inf)  # over that of the print's edge
    for marker in layout.markers:
        off = points - np.array(marker.position_m)
        if isinstance(marker, Square):
            own = off @ rotation_2d(math.radians(marker.heading_deg))
            distance = np.minimum(distance, np.abs(own).max(axis=1) / (0.5 * marker.size_m))
        elif marker is not ring:
            distance = np.minimum(distance, np.hypot(*off.T) / marker.radius_m)
    return distance < _PRINT, distance < _BESIDE_PRINT


def _turned(mask: Mask) -> NDArray[np.intp]:
    """Return the indices (headings, n) of samples that are of a kind under each heading."""
    circle, angle = np.nonzero(mask.reshape(-1, HEADINGS))
    return np.stack([circle * HEADINGS + (angle + k) % HEADINGS for k in range(HEADINGS)])


def _quantile(levels: F64, share: float) -> F64:
    """Return the level (headings,) that such a share of those seen (headings, n) do not reach."""
    seen = np.count_nonzero(~np.isnan(levels), axis=1)
    at = np.clip((share * seen).astype(int), 0, levels.shape[1] - 1)
    ordered = np.sort(levels, axis=1)  # NaN last
    quantile: F64 = np.take_along_axis(ordered, at[:, None], axis=1)[:, 0]
    return quantile


def mean_seen(levels: F64) -> F64:
    """Return the mean (headings,) of the levels (headings, n) that are seen."""
    seen = ~np.isnan(levels)
    mean: F64 = np.where(seen, levels, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    return mean


def share_seen(levels: F64) -> F64:
    """Return the share (headings,) of the points (headings, n) that are in the picture."""
    share: F64 = (~np.isnan(levels)).mean(axis=1)
    return share
