"""Whether the outlines of a pad's plate and of its prints are seen about a ring, in any light.

Where a shadow's edge lies across a pad its white has two levels, and dark ground in the sun is as
bright as white in the shade. But on either side of an outline lies the same light: the plate is
brighter than the ground just beyond it, and than the prints on it, nearly everywhere.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.pad import PadLayout, Plate, Ring, Square
from landerd.vision.edge_profile import is_step
from landerd.vision.patch import levels_at
from landerd.vision.plate_template import HEADINGS, share_seen
from landerd.vision.pose import circle, rotation_2d
from landerd.vision.square_pose import square_points

U8 = NDArray[np.uint8]

# How far from the outline either side is looked at: of the ring's radius, of a print's side.
_BESIDE_PLATE, _BESIDE_PRINT = 0.12, 0.16
_PER_SIDE = 12  # places on each side of an outline
_LEAST_SEEN = 0.7  # of the places that must be in the picture
# Share of the places with a step, of the plate's outline and of the prints': of 169 fits to pads
# half in a shadow that showed no even plate 152 had more, of 352 to other rings none.
_MIN_PLATE, _MIN_PRINTS = 0.75, 0.75
# Or of the plate's alone, where shade hides faded prints: of 821 fits to other rings that show no
# even plate, on 39 field days, none had so much; of 576 to pads 50, on days without a landing else.
_MIN_PLATE_ALONE = 0.85
# With less of both there is no plate. Of pads on 57 field days and of 517 pads in leaf shade, the
# ring more than 9 px in radius, 12 in 1000 showed less; of the look-alikes that other limits let
# pass on 9 of these days 7 in 10.
_LEAST_PART, _PART_PER_PX, _CLEAR_RADIUS_PX = 0.55, 0.04, 9.0


class PlateOutline:
    """The outlines about one ring of a pad."""

    def __init__(self, layout: PadLayout, ring: Ring) -> None:
        """Prepare the places; needs a pad with other markers beside the ring."""
        middle = np.array(ring.position_m)
        places, ways = along(plate_corners(layout.plate))
        ways = ways * (_BESIDE_PLATE * ring.radius_m)
        inside, beyond = [places - ways], [places + ways]
        for marker in layout.markers:
            if marker.position_m == ring.position_m:
                continue
            if isinstance(marker, Square):
                size, turn = marker.size_m, rotation_2d(math.radians(marker.heading_deg))
                places, ways = (x @ turn.T for x in along(square_points(size)))
            else:
                size, ways = marker.radius_m, circle(1.0)
                places = size * ways
            places = places + np.array(marker.position_m)
            ways = ways * (_BESIDE_PRINT * size)
            inside.append(places + ways)  # there the plate is without
            beyond.append(places - ways)
        self._count = len(inside[0])  # of places on the plate's outline; the rest are on prints'
        points = np.concatenate([*inside, *beyond]) - middle
        turns = [rotation_2d(2.0 * math.pi * k / HEADINGS).T for k in range(HEADINGS)]
        self._points: F64 = np.stack([points @ turn for turn in turns])  # (headings, n, 2)

    def is_seen(self, image: U8, camera: CameraModel, t: F64, axes: F64) -> bool:
        """Tell whether there is a heading under which all outlines are seen, or nearly the plate's.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: the ring's centre (3,), camera frame, m.
            axes: two unit vectors (3, 2) in the ring's plane.
        """
        plate, prints = self._shares(image, camera, t, axes, self._points)
        is_whole = (plate >= _MIN_PLATE) & (prints >= _MIN_PRINTS)
        return bool((is_whole | (plate >= _MIN_PLATE_ALONE)).any())

    def is_missing(
        self,
        image: U8,
        camera: CameraModel,
        t: F64,
        axes: F64,
        radius_px: float,
        likeliest: int,
    ) -> bool:
        """Tell whether under no heading as much as a part of an outline is seen.

        Args:
            image: as of `is_seen`, and what follows.
            camera: the lens.
            t: the ring's centre.
            axes: of the ring's plane.
            radius_px: of the ring; of smaller ones less of the outlines is seen.
            likeliest: heading of a `PlateTemplate`, tried first: a pad's needs no other.
        """
        if radius_px < _CLEAR_RADIUS_PX:
            return False
        least = min(_LEAST_PART, _PART_PER_PX * radius_px)
        for points in (self._points[[likeliest]], self._points):
            plate, prints = self._shares(image, camera, t, axes, points)
            if not ((plate < least) & (prints < least)).all():
                return False
        return True

    def _shares(
        self, image: U8, camera: CameraModel, t: F64, axes: F64, points: F64
    ) -> tuple[F64, F64]:
        """Return the shares of plate and prints with a step, each (headings,).

        NaN: too few of the points (headings, n, 2) are in the picture.
        """
        levels = levels_at(image, camera, t + points.reshape(-1, 2) @ axes.T)
        inside, beyond = np.moveaxis(levels.reshape(len(points), 2, -1), 1, 0)
        plate, prints = (
            _share(inside[part], beyond[part])
            for part in (np.s_[:, : self._count], np.s_[:, self._count :])
        )
        return plate, prints


def _share(inside: F64, beyond: F64) -> F64:
    """Return the share (headings,) of the places (headings, n) in the picture that have a step."""
    seen = share_seen(inside - beyond)
    steps = is_step(beyond, inside).mean(axis=1)  # NaN is none
    return np.where(seen > _LEAST_SEEN, steps / np.maximum(seen, 1e-9), np.nan)


def plate_corners(plate: Plate) -> F64:
    """Return the corners (4, 2) of a plate in the pad's axes, clockwise from above."""
    north, east, south, west = plate.north_m, plate.east_m, -plate.south_m, -plate.west_m
    return np.array([(north, west), (north, east), (south, east), (south, west)])


def along(corners: F64) -> tuple[F64, F64]:
    """Return places along a polygon's sides, and the unit vectors out of it there, (n, 2) each."""
    middle = corners.mean(axis=0)
    shares = (np.arange(_PER_SIDE) + 0.5)[:, None] / _PER_SIDE
    places, ways = [], []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        out = np.array([-along[1], along[0]])
        out = out * np.sign(out @ (start - middle))
        places.append(start + shares * (end - start))
        ways.append(np.tile(out, (_PER_SIDE, 1)))
    return np.concatenate(places), np.concatenate(ways)
