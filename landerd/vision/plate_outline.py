"""How much of the outlines of a pad's plate, and of the prints on it, is seen about a ring.

Light is the same on both sides of an outline, except at a shadow's edge: nearly everywhere the
plate is brighter than the ground just beyond its edge, and than the prints on it. Texture and spots
of light are brighter somewhere, but not along straight lines at known places. `plate_check`,
`plate_heading`, `plate_sides` and `plate_ring` use these places.
"""

import math
from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.pad import PadLayout, Plate, Ring, Square
from landerd.vision.arrays import U8, Mask
from landerd.vision.edge_profile import medians
from landerd.vision.patch import levels_at
from landerd.vision.pose import circle, normal_of, px_per_m, rotation_2d
from landerd.vision.square_pose import square_points

HEADINGS = 64  # that are tried
# How far from the outline either side is looked at: a share of the ring's radius (plate), of a
# print's side (print); and at least this many px, so that blur leaves something of the step.
_BESIDE_PLATE, _BESIDE_PRINT, _BLUR_PX = 0.12, 0.16, 1.5
_PER_SIDE = 8  # places on each side of an outline
_LEAST_SEEN = 0.7  # share of the places that must be in the picture
# If fewer are: the least share of the plate's places that must tell something, and the share of
# those with a step below which the ring is not the pad's.
_LEAST_CUT, _LEAST_PLATE_CUT = 0.25, 0.7
# Up to this share of places with a step, in either direction, ground counts as bright as the plate.
_EVEN_GROUND = 0.2
_LEAST_PRINT_PX = 3.0  # side of a print, px: smaller ones tell nothing
# Least step, as a share of the ring's contrast, and in grey levels. The contrast is understated
# where white is clipped, so the share is smaller there.
_STEP, _STEP_CLIPPED, _LEAST_STEP = 0.1, 0.05, 4.0
CLIPPED = 250.0  # grey level from which on white counts as clipped, over full scale
# Share of the points that tell a ring's black and white that may be out of the picture, and radius
# of the circle on which the white about it is measured, in the ring's radii: it is within the
# margin of any print.
_MOST_CUT, _OWN_WHITE = 0.6, 1.1
_PLATE_WEIGHT = 0.6  # of the plate's outline; the rest is that of the prints'
# Deduction from the share of steps if the plate inside its outlines is mostly darker than the white
# about the ring: the first per share of the ring's contrast. The same if it is brighter than the
# second, in units of that contrast: more than sun makes it. The deduction is at most the third.
_PER_DARKER, _BRIGHTEST, _MOST_OFF = 0.5, 1.4, 0.3
# Least share of the places with a step, after deduction; the same where white is clipped; that of
# the plate's alone, without deduction, where prints are faded; and that of the prints' alone, after
# deduction, on ground as bright as the plate. 6500 looks at pads and 1320 at other rings, in single
# pictures of 1000 field days, half of them among look-alikes, a third over full scale:
#   ring's radius, px   6-9     9-12     12-16    16-24    more
#   pads refused        6.8 %   3.6 %    5.1 %    4.4 %    1.4 %
#   others passed       42 %    14 %     17 %     7 of 37  2 of 7
_LEAST, _LEAST_CLIPPED, _LEAST_PLATE, _LEAST_PRINTS = 0.66, 0.44, 0.95, 0.88
# The same (first one) for a plate that carries the ring alone. Of 131 looks at manholes on two
# field days all but one have 0.28 at most; wheels have 0.7 (ring_explained._EVEN_CONTRAST).
_LEAST_ALONE = 0.4
# The same without deduction, where much of the plate lies in another light than the ring: steps are
# compared with the light at their own place. Of 242 looks at pads with a shadow's edge across them,
# to 0.2 of the light, 57 are refused without this rule, 2 with it. The limit is lower if the ring
# lies in the shadow: of 112 other rings refused on 120 field days none had 0.77.
_LEAST_IN_OWN_LIGHT, _LEAST_IN_SHADOW = 0.95, 0.82


@dataclass(frozen=True, slots=True)
class Outlines:
    """Places on the outlines of a plate and of the prints on it, about a ring."""

    places: F64  # from the ring's centre, pad's axes, m, (n, 2)
    ways: F64  # vectors across the outline to the plate's white, as long as sizes, m, (n, 2)
    sizes: F64  # of the outlined thing: the ring's radius for the plate, a print's side, m, (n,)
    is_plate: Mask  # of the plate's outline, else of a print's, (n,)

    def weights(self, plate: float) -> F64:
        """Return the weights (n,) of the places: `plate` in total for the plate's, else prints'."""
        n = int(self.is_plate.sum())
        shares = plate / n, (1.0 - plate) / max(len(self.is_plate) - n, 1)
        return np.where(self.is_plate, *shares)

    def beside(self, least: F64 | None = None) -> tuple[F64, F64]:
        """Return points on the white side of the outlines and beyond them, (n, 2), pad's axes, m.

        Args:
            least: smallest distance from the outlines, in sizes, (n,); None: the usual distances.
        """
        share = np.where(self.is_plate, _BESIDE_PLATE, _BESIDE_PRINT)
        # Half a size at most: farther would be beyond the centre of a small print.
        ways = self.ways * (share if least is None else np.clip(least, share, 0.5))[:, None]
        return self.places + ways, self.places - ways

    def levels(
        self, image: U8, camera: CameraModel, t: F64, axes: F64, turns: F64
    ) -> tuple[F64, F64, F64]:
        """Return sizes (n,) in px, and grey levels on the white side and beyond, (turns, n) each.

        Levels are NaN out of the picture.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: the ring's centre (3,), camera frame, m.
            axes: two unit vectors (3, 2) in the ring's plane.
            turns: rotations of the plate in that plane, transposed, (turns, 2, 2).
        """
        px = px_per_m(camera, t, normal_of(axes)) * self.sizes
        points = np.concatenate(self.beside(_BLUR_PX / px))
        grey = levels_at(image, camera, t + (points @ turns).reshape(-1, 2) @ axes.T)
        inside, beyond = np.moveaxis(grey.reshape(len(turns), 2, -1), 1, 0)
        return px, inside, beyond


class PlateOutline:
    """Tells whether the outlines about one ring of a pad are seen, at some heading."""

    def __init__(self, about: Outlines) -> None:
        """Prepare with the places on the outlines."""
        self._about, self._is_plate = about, about.is_plate
        self._weights = about.weights(_PLATE_WEIGHT)
        self._has_prints = not about.is_plate.all()
        self._least = _LEAST if self._has_prints else _LEAST_ALONE
        turns = [rotation_2d(2.0 * math.pi * k / HEADINGS).T for k in range(HEADINGS)]
        # Every second heading first: most pads are seen at one of them.
        self._turns = np.stack(turns[::2]), np.stack(turns[1::2])

    def is_seen(
        self, image: U8, camera: CameraModel, t: F64, axes: F64, levels: tuple[float, float]
    ) -> bool | None:
        """Tell whether enough of the outlines is seen at one heading at least.

        None: at none, but at one at least too much is out of the picture to tell.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: the ring's centre (3,), camera frame, m.
            axes: two unit vectors (3, 2) in the ring's plane.
            levels: grey levels of the ring's black and of the white about it.
        """
        is_cut = False
        for turns in self._turns:
            px, inside, beyond = self._about.levels(image, camera, t, axes, turns)
            is_known = self._is_plate | (px > _LEAST_PRINT_PX)
            seen, may_be = self._seen(inside, beyond, is_known, levels)
            if seen.any():
                return True
            is_cut |= bool(may_be.any())
        return None if is_cut else False

    def _seen(
        self, inside: F64, beyond: F64, is_known: Mask, levels: tuple[float, float]
    ) -> tuple[Mask, Mask]:
        """Tell for each heading whether the outlines are seen, and whether that cannot be told.

        Args:
            inside: grey levels on the white side, (headings, n).
            beyond: grey levels on the other side, (headings, n); ground that is clipped, as the
                white is, tells nothing.
            is_known: which places tell something, (n,).
            levels: of the ring's black and of the white about it.
        """
        (black, white), is_plate = levels, self._is_plate
        contrast, is_clipped = max(white - black, 1.0), white > CLIPPED
        rise = inside - beyond
        in_view = ~np.isnan(rise)
        least = (_STEP_CLIPPED if is_clipped else _STEP) * contrast
        is_step = rise > max(least, _LEAST_STEP)
        own_light = np.clip(inside / max(white, 1.0), 0.0, 1.0)
        is_own_step = rise > np.maximum(least * own_light, _LEAST_STEP)
        tells = in_view & ~(is_plate & (beyond > CLIPPED))
        known = self._weights * (tells & is_known)
        known /= np.maximum(known.sum(axis=1, keepdims=True), 1e-9)
        both, both_own = ((known * steps).sum(axis=1) for steps in (is_step, is_own_step))
        plate_view, plate = (of[:, is_plate].mean(axis=1) for of in (in_view, is_step))
        bright = medians(np.where(in_view, (inside - black) / contrast, 1.0))
        off = np.clip(_PER_DARKER * np.maximum(1.0 - bright, bright - _BRIGHTEST), 0.0, _MOST_OFF)
        is_seen = both - off >= (min(_LEAST_CLIPPED, self._least) if is_clipped else self._least)
        is_shadowed = bright > _BRIGHTEST
        is_seen |= both_own >= np.where(is_shadowed, _LEAST_IN_SHADOW, _LEAST_IN_OWN_LIGHT)
        is_cut = plate_view <= _LEAST_SEEN
        is_seen |= plate >= _LEAST_PLATE * plate_view
        if self._has_prints:
            prints_view, prints = (of[:, ~is_plate].mean(axis=1) for of in (in_view, is_step))
            is_cut |= prints_view <= _LEAST_SEEN
            is_seen |= prints - off * prints_view >= _LEAST_PRINTS * prints_view
        plate_tells = tells[:, is_plate].mean(axis=1)
        is_without = (plate_tells > _LEAST_CUT) & (plate < _LEAST_PLATE_CUT * plate_tells)
        if self._has_prints:
            uneven = (tells & (np.abs(rise) > least))[:, is_plate].mean(axis=1)
            is_without &= uneven > _EVEN_GROUND * plate_tells
        return is_seen & ~is_cut, is_cut & ~is_without


def own_levels(
    image: U8, camera: CameraModel, ring: Ring, t: F64, axes: F64
) -> tuple[float, float] | None:
    """Return the grey levels of a ring's black and of the white about it.

    None: too much of it is out of the picture.

    Args:
        image: grey image (height, width).
        camera: the lens.
        ring: its size and ratio.
        t: its centre (3,), camera frame, m.
        axes: two unit vectors (3, 2) in its plane.
    """
    rims = np.concatenate([circle(0.5 * (1.0 + ring.inner_ratio)), circle(_OWN_WHITE)])
    sides = levels_at(image, camera, t + ring.radius_m * rims @ axes.T).reshape(2, -1)
    is_out = np.isnan(sides)
    if is_out.mean() > _MOST_CUT or is_out.all(axis=1).any():
        return None
    # Not nanmedian, which takes 0.1 ms.
    black, white = (medians(side[None, ~out]) for side, out in zip(sides, is_out, strict=True))
    return float(black[0]), float(white[0])


def has_beside(layout: PadLayout, ring: Ring) -> bool:
    """Tell whether a pad has other markers beside a ring, round which its plate reaches."""
    return any(other.position_m != ring.position_m for other in layout.markers)


def outlines(layout: PadLayout, ring: Ring) -> Outlines:
    """Return the outlines of the plate about a ring, and of the markers beside it."""
    places, ways = along(plate_corners(layout.plate), _PER_SIDE)
    # See `Outlines.ways`.
    parts = [(places, -ring.radius_m * ways)]
    for marker in layout.markers:
        if marker.position_m == ring.position_m:
            continue
        if isinstance(marker, Square):
            size, turn = marker.size_m, rotation_2d(math.radians(marker.heading_deg))
            places, ways = (x @ turn.T for x in along(square_points(size), _PER_SIDE))
        else:
            size, ways = marker.radius_m, circle(1.0, 4 * _PER_SIDE)
            places = size * ways
        parts.append((places + np.array(marker.position_m), size * ways))
    all_places = np.concatenate([part[0] for part in parts]) - np.array(ring.position_m)
    all_ways: F64 = np.concatenate([part[1] for part in parts])
    is_plate = np.arange(len(all_ways)) < len(parts[0][0])
    return Outlines(all_places, all_ways, np.hypot(*all_ways.T), is_plate)


def plate_corners(plate: Plate) -> F64:
    """Return the corners (4, 2) of a plate in the pad's axes, clockwise from above."""
    north, east, south, west = plate.north_m, plate.east_m, -plate.south_m, -plate.west_m
    return np.array([(north, west), (north, east), (south, east), (south, west)])


def along(corners: F64, per_side: int) -> tuple[F64, F64]:
    """Return places along the sides of polygons, and the unit vectors out of them there.

    Each is (..., corners * per_side, 2) for corners (..., corners, 2).
    """
    sides = np.concatenate([corners[..., 1:, :], corners[..., :1, :]], axis=-2) - corners
    x, y = np.moveaxis(sides / np.sqrt((sides * sides).sum(axis=-1))[..., None], -1, 0)
    out = np.stack([-y, x], axis=-1)
    from_middle = corners - corners.mean(axis=-2)[..., None, :]
    out *= np.sign((out * from_middle).sum(axis=-1))[..., None]
    shares = (np.arange(per_side) + 0.5)[:, None] / per_side
    places = corners[..., None, :] + shares * sides[..., None, :]
    ways = np.broadcast_to(out[..., None, :], places.shape)
    flat = (*corners.shape[:-2], -1, 2)
    return places.reshape(flat), ways.reshape(flat)
