"""Whether a ring has beside it the white that carries the pad's other markers.

A look-alike whose ratio is off by a tenth cannot be told from a small ring behind a tone curve, nor
a ring of the right ratio that is somebody else's. But where the pad has a square, there is white
round it, which is seen long before the square can be read. No heading need be known: a ring is
refused if there is none under which most of that white is there. On ground nearly as bright as
white this says nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring, Square, WhyCode
from landerd.vision.expected import any_across
from landerd.vision.patch import levels_at
from landerd.vision.pose import MIN_DEPTH_M, circle, rotation_2d, rotation_from
from landerd.vision.square_pose import square_points

U8 = NDArray[np.uint8]

# Of the ring, the shorter one: smaller ones and what is beside them run together.
_MIN_RADIUS_PX = 6.0
_HEADINGS = 48  # white as wide as this leaves is half a square's side
_BESIDE = (1.15, 1.3, 1.45)  # times a marker's size: the white round it
_ROUND_RING = 1.15  # times its radius: nearer is its own white
_WHITE_SHARE = 0.6  # of the way from the ring's black to its white
_LEAST_WHITE = 0.7  # share of the points; a leg or dirt may hide some
_LEAST_SEEN = 0.9  # share of the points that must be in the picture, or nothing is said
_OWN_WHITE = 1.1  # times the ring's radius: within the margin of any print
# White round the ring that is darker than this, of the way from black, lies in patchy light, which
# may hide the plate too.
_EVEN_SHARE, _EVEN_PERCENTILE = 0.6, 10.0

_TURNS = [rotation_2d(2.0 * math.pi * k / _HEADINGS).T for k in range(_HEADINGS)]


class PlateCheck:
    """Looks for the white round a pad's other markers beside a ring."""

    def __init__(self, layout: PadLayout, camera: CameraModel) -> None:
        """Prepare the points that must be white for each ring that has another marker beside it."""
        self._camera = camera
        self._white = {ring: _white_beside(layout, ring) for ring in layout.rings}

    def contradicts(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool:
        """Tell whether a ring cannot be the pad's, as what it should have beside it is not white.

        Args:
            image: grey image (height, width).
            ring: of the pad.
            sighting: what was taken for it.
        """
        if not len(self._white[ring]):
            return False
        return all(
            self._is_bare(image, ring, np.array(s.position), np.array(s.normal))
            for s in sighting.solutions
        )

    def _is_bare(self, image: U8, ring: Ring, t: F64, normal: F64) -> bool:
        """Tell whether there is no heading under which a ring's pose has the plate beside it."""
        slant = float(normal @ t) / float(np.linalg.norm(t))
        px_per_m = math.sqrt(self._camera.fx * self._camera.fy) * slant / max(t[2], MIN_DEPTH_M)
        if px_per_m * ring.radius_m < _MIN_RADIUS_PX:
            return False
        axes = rotation_from(normal, any_across(normal))[:, :2]
        own = self._own_levels(image, ring, t, axes)
        if own is None:
            return False
        black, white = own
        around = self._turned(image, self._white[ring], t, axes)
        may_be = _share(around > black + _WHITE_SHARE * (white - black), around) >= _LEAST_WHITE
        return not bool(may_be.any())

    def _own_levels(self, image: U8, ring: Ring, t: F64, axes: F64) -> tuple[float, float] | None:
        """Return a ring's black and white; None: not all of it is seen, or in patchy light."""
        rims = np.concatenate([circle(0.5 * (1.0 + ring.inner_ratio)), circle(_OWN_WHITE)])
        levels = levels_at(image, self._camera, t + ring.radius_m * rims @ axes.T)
        if np.isnan(levels).any():
            return None
        stroke, around = levels.reshape(2, -1)
        black, white = float(np.median(stroke)), float(np.median(around))
        dimmest = float(np.percentile(around, _EVEN_PERCENTILE))
        return None if dimmest < black + _EVEN_SHARE * (white - black) else (black, white)

    def _turned(self, image: U8, points: F64, t: F64, axes: F64) -> F64:
        """Return grey levels (headings, n) at points (n, 2) about a ring's centre."""
        turned = np.concatenate([points @ each for each in _TURNS])
        return levels_at(image, self._camera, t + turned @ axes.T).reshape(_HEADINGS, -1)


def _share(good: NDArray[np.bool_], levels: F64) -> F64:
    """Return the shares (headings,) of points that are good; 1: too few are seen."""
    seen = ~np.isnan(levels)
    shares: F64 = np.where(seen.mean(axis=1) < _LEAST_SEEN, 1.0, good.mean(axis=1))
    return shares


def _white_beside(layout: PadLayout, ring: Ring) -> F64:
    """Return points (n, 2) about a ring's centre, pad axes, that are white; none: it is alone."""
    plate, points = layout.plate, []
    for other in layout.markers:
        if isinstance(other, Square | WhyCode) and other.position_m != ring.position_m:
            points += [s * _outline(other) + np.array(other.position_m) for s in _BESIDE]
    if not points:
        return np.empty((0, 2))
    p = np.concatenate(points)
    good = (p[:, 0] < plate.north_m) & (p[:, 0] > -plate.south_m)
    good &= (p[:, 1] < plate.east_m) & (p[:, 1] > -plate.west_m)
    for marker in layout.markers:
        middle = np.array(marker.position_m)
        if isinstance(marker, Square):
            reach = (
                0.5 * math.sqrt(2.0) * marker.size_m if marker.heading_deg else 0.5 * marker.size_m
            )
            good &= np.abs(p - middle).max(axis=1) > 1.1 * reach
        else:
            good &= np.hypot(*(p - middle).T) > _ROUND_RING * marker.radius_m
    white: F64 = p[good] - np.array(ring.position_m)
    return white


def _outline(marker: Square | WhyCode) -> F64:
    """Return points (n, 2) round a marker's edge about its centre, pad axes."""
    if isinstance(marker, WhyCode):
        return circle(marker.radius_m)
    corners = square_points(marker.size_m) @ rotation_2d(math.radians(marker.heading_deg)).T
    shares = np.linspace(0.0, 1.0, 5)[:-1, None]
    sides = [
        c + shares * (d - c) for c, d in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    return np.concatenate(sides)
