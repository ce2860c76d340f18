"""Whether a ring has beside it the white that carries the pad's other markers.

A look-alike whose ratio is off by a tenth cannot be told from a small ring behind a tone curve, nor
a ring of the right ratio that is somebody else's. But where the pad has a square, there is white
round it, which is seen long before the square can be read. No heading need be known: a ring is
refused if there is none under which that white stands out from the ground behind it or, on ground
as bright as white, a print from the white; and under which the whole plate, evenly white, stands
out from ground and prints (`PlateTemplate`): texture stands out somewhere, but not evenly. Where a
shadow's edge lies across the plate its outlines tell it (`PlateOutline`). Of larger rings a part of
these must be seen in any light: spots of light on the ground are as white, but not as straight.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring, Square, WhyCode
from landerd.vision.expected import any_across
from landerd.vision.patch import levels_at, on_plate
from landerd.vision.plate_outline import PlateOutline
from landerd.vision.plate_template import PlateTemplate, mean_seen, share_seen
from landerd.vision.pose import circle, px_per_m, rotation_2d, rotation_from
from landerd.vision.ring_explained import Vouches
from landerd.vision.square_pose import square_points

U8 = NDArray[np.uint8]

# Of the ring, the shorter one: the white of smaller ones runs together with what is beside it, and
# of the smallest nothing can be said.
_CLEAR_RADIUS_PX, _MIN_RADIUS_PX = 6.0, 3.5
_HEADINGS = 48  # white as wide as this leaves is half a square's side
_BESIDE = (1.15, 1.3, 1.45)  # times a marker's size: the white round it
_ROUND_RING = 1.15  # times its radius: nearer is its own white
_LEAST_SEEN = 0.9  # share of the points that must be in the picture, or nothing is said
_OWN_WHITE = 1.1  # times the ring's radius: within the margin of any print
_BEYOND, _BRIGHTEST = (1.25, 1.4), 95.0  # where white may be, too; percentile
# White round the ring that is darker than this, of the way from black, lies in patchy light, which
# may hide the plate too.
_EVEN_SHARE, _EVEN_PERCENTILE = 0.6, 10.0
# So far from the ground behind it to the brightest white the plate is, in even light and in other:
# 265 pads in pictures of the field world gave 0.54 and 0.36 and more (one in a hundred less); other
# rings' own plates at most 0.37. In a shadow it is still brighter by a factor and some grey levels.
_STANDS_OUT_EVEN, _STANDS_OUT = 0.5, 0.38
_STANDS_OUT_TIMES, _LEAST_STEP = 2.0, 5.0
_HIDDEN_SHARE = 0.3  # of the plate's white, by leaves or dirt, or because it is another's corner
# Of all headings, those under which the plate could lie, beyond those that the pad itself lets it
# (0.19 of the thesis's): the 265 pads gave 0.08 at most, foreign tags more than 0.2, the middle of
# a target 0.8.
_MOST_HEADINGS = 0.2
_BRIGHT_SHARE = 0.7  # of the way from black: of ground that is as bright as white
_PRINT_SHARE = 0.3  # of the contrast: a marker's print, half of it black, is so much less bright
_CLIPPED = 250.0  # grey level of white over full scale: a small print in it is nearly washed out
# Of `PlateTemplate`. 97 % of 311 true rings on 45 field days with ten look-alikes each gave more,
# and 21 % of what else all other limits let pass on 28 of them, which was 49 %.
_LEAST_FIT, _LEAST_UNEVEN_FIT = 0.6, 0.12
_BEHIND = (0.3, 0.45, 0.6)  # times the ring's radius, the plate's edge
_FAR_BESIDE = 1.7  # times the ring's radius: beyond the corners of another ring's own plate

_TURNS = [rotation_2d(2.0 * math.pi * k / _HEADINGS).T for k in range(_HEADINGS)]


class _OwnLevels(NamedTuple):
    """Grey levels of a ring and of the white about it."""

    black: float
    white: float
    brightest: float  # of the white
    is_even: bool  # the white, all around


class PlateCheck:
    """Looks for the white round a pad's other markers beside a ring."""

    def __init__(self, layout: PadLayout, camera: CameraModel) -> None:
        """Prepare the points that must be white for each ring that has another marker beside it."""
        self._camera = camera
        self._white = {ring: _white_beside(layout, ring) for ring in layout.rings}
        self._most_headings = {
            ring: _MOST_HEADINGS + _headings_on_plate(layout, ring, white)
            for ring, white in self._white.items()
        }
        self._templates = {
            ring: PlateTemplate(layout, ring) for ring, white in self._white.items() if len(white)
        }
        self._outlines = {ring: PlateOutline(layout, ring) for ring in self._templates}
        self._ground = {ring: _ground_behind(layout, ring) for ring in layout.rings}
        self._prints = {ring: _prints_beside(layout, ring) for ring in layout.rings}
        self._last: tuple[MarkerSighting, bool] | None = None

    def contradicts(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool:
        """Tell whether a ring cannot be the pad's, as what it should have beside it is not white.

        Args:
            image: grey image (height, width).
            ring: of the pad.
            sighting: what was taken for it.
        """
        if not len(self._white[ring]):
            return False
        if self._last is None or self._last[0] is not sighting:  # the search asks, and then vision
            is_bare = all(
                self._is_bare(image, ring, np.array(s.position), np.array(s.normal))
                for s in sighting.solutions
            )
            self._last = sighting, is_bare
        return self._last[1]

    def voucher(self, image: U8, ring: Ring) -> Vouches | None:
        """Return what tells whether the whole plate is seen about a ring; None: it cannot be."""
        template = self._templates.get(ring)
        if template is None:
            return None

        def vouches(t: F64, normal: F64, contrast: float) -> bool:
            axes = rotation_from(normal, any_across(normal))[:, :2]
            return bool((template.fits(image, self._camera, t, axes, contrast) > _LEAST_FIT).any())

        return vouches

    def _is_bare(self, image: U8, ring: Ring, t: F64, normal: F64) -> bool:
        """Tell whether there is no heading under which a ring's pose has the plate beside it."""
        radius_px = px_per_m(self._camera, t, normal) * ring.radius_m
        if radius_px < _MIN_RADIUS_PX:
            return False
        axes = rotation_from(normal, any_across(normal))[:, :2]
        own = self._own_levels(image, ring, t, axes)
        if own is None:
            return False
        outline = self._outlines[ring]
        likeliest = self._heading_of_white(image, ring, t, axes, own, radius_px)
        if likeliest is None:
            return not outline.is_seen(image, self._camera, t, axes)
        if own.white > _CLIPPED:  # over full scale, which hides its outlines
            return False
        return outline.is_missing(image, self._camera, t, axes, radius_px, likeliest)

    def _heading_of_white(
        self,
        image: U8,
        ring: Ring,
        t: F64,
        axes: F64,
        own: _OwnLevels,
        radius_px: float,
    ) -> int | None:
        """Return a heading under which the plate's white stands out, evenly; None: there is none.

        That of the template which fits best.
        """
        black, white, brightest, is_even = own
        behind = _mean(self._turned(image, self._ground[ring], t, axes))
        plate = _lower(self._turned(image, self._white[ring], t, axes))
        share = _STANDS_OUT_EVEN if is_even else _STANDS_OUT
        may_be = _stands_out(plate, behind, brightest, share)
        if (may_be & ~np.isnan(plate - behind)).mean() > self._most_headings[ring]:
            may_be[:] = False
        is_bright = behind > black + _BRIGHT_SHARE * (white - black)
        if is_bright.any():  # there it is the other markers' print that stands out
            printed = _mean(self._turned(image, self._prints[ring], t, axes))
            least = np.where(plate > _CLIPPED, _LEAST_STEP, _PRINT_SHARE * (white - black))
            is_printed = ~(plate - printed < least)
            # A print too small to be seen: the plate itself stands out by as much.
            stands_out = may_be & (plate - behind > _PRINT_SHARE * (white - black))
            may_be = np.where(is_bright, is_printed | stands_out, may_be)
        if not may_be.any():
            return None
        is_clear = is_even and radius_px > _CLEAR_RADIUS_PX
        fits = self._templates[ring].fits(image, self._camera, t, axes, white - black)
        least_fit = _LEAST_FIT if is_clear else _LEAST_UNEVEN_FIT
        if (fits < least_fit).all():  # NaN, where too little is seen, is not
            return None
        return int(np.argmax(np.where(np.isnan(fits), -np.inf, fits)))

    def _own_levels(self, image: U8, ring: Ring, t: F64, axes: F64) -> _OwnLevels | None:
        """Return a ring's own levels; None: not all of it is seen."""
        scales = (0.5 * (1.0 + ring.inner_ratio), _OWN_WHITE, *_BEYOND)
        rims = np.concatenate([circle(scale) for scale in scales])
        levels = levels_at(image, self._camera, t + ring.radius_m * rims @ axes.T)
        if np.isnan(levels).any():
            return None
        stroke, around, *beyond = levels.reshape(len(scales), -1)
        black, white = float(np.median(stroke)), float(np.median(around))
        is_even = np.percentile(around, _EVEN_PERCENTILE) >= black + _EVEN_SHARE * (white - black)
        brightest = float(np.percentile(np.concatenate([around, *beyond]), _BRIGHTEST))
        return _OwnLevels(black, white, brightest, bool(is_even))

    def _turned(self, image: U8, points: F64, t: F64, axes: F64) -> F64:
        """Return grey levels (headings, n) at points (n, 2) about a ring's centre."""
        turned = np.concatenate([points @ each for each in _TURNS])
        return levels_at(image, self._camera, t + turned @ axes.T).reshape(_HEADINGS, -1)


def _is_seen(levels: F64) -> NDArray[np.bool_]:
    """Tell for which headings enough of the points (headings, n) are in the picture."""
    return np.asarray(share_seen(levels) >= _LEAST_SEEN)


def _mean(levels: F64) -> F64:
    """Return the mean levels (headings,) of points (headings, n); NaN: too few are seen."""
    return np.where(_is_seen(levels), mean_seen(levels), np.nan)


def _lower(levels: F64) -> F64:
    """Return the level (headings,) that most of points (headings, n) reach; NaN: few are seen."""
    ordered = np.sort(levels, axis=1)  # NaN last
    lower = ordered[:, int(_HIDDEN_SHARE * levels.shape[1])]
    return np.where(_is_seen(levels), lower, np.nan)


def _stands_out(plate: F64, ground: F64, brightest: float, share: float) -> NDArray[np.bool_]:
    """Tell where (headings,) a plate stands out from the ground; where either is not seen, too."""
    step = plate - ground
    is_brighter = (step > share * (brightest - ground)) | (plate > _STANDS_OUT_TIMES * ground)
    return (is_brighter & (step > _LEAST_STEP)) | np.isnan(step)


def _headings_on_plate(layout: PadLayout, ring: Ring, white: F64) -> float:
    """Return the share of headings under which most of white (n, 2) is on the plate again."""
    if not len(white):
        return 1.0
    middle = np.array(ring.position_m)
    shares = [on_plate(layout.plate, white @ turn + middle).mean() for turn in _TURNS]
    return float((np.array(shares) >= 1.0 - _HIDDEN_SHARE).mean())


def _prints_beside(layout: PadLayout, ring: Ring) -> F64:
    """Return points (n, 2) about a ring's centre, pad axes, on the prints of the other markers."""
    shares = np.linspace(-0.4, 0.4, 5)
    grid = np.stack(np.meshgrid(shares, shares), axis=-1).reshape(-1, 2)
    points = [
        _across(other) * grid @ rotation_2d(_heading(other)).T + np.array(other.position_m)
        for other in _others(layout, ring)
    ]
    prints: F64 = np.concatenate([*points, np.empty((0, 2))]) - np.array(ring.position_m)
    return prints


def _others(layout: PadLayout, ring: Ring) -> list[Square | WhyCode]:
    """Return what else the pad has beside a ring."""
    return [
        m
        for m in layout.markers
        if isinstance(m, Square | WhyCode) and m.position_m != ring.position_m
    ]


def _across(marker: Square | WhyCode) -> float:
    """Return the side of a square, m, or of one that lies within a code's circle."""
    return marker.size_m if isinstance(marker, Square) else marker.radius_m


def _heading(marker: Square | WhyCode) -> float:
    """Return the heading of a square on the pad, rad; a code's does not matter."""
    return math.radians(marker.heading_deg) if isinstance(marker, Square) else 0.0


def _ground_behind(layout: PadLayout, ring: Ring) -> F64:
    """Return points (n, 2) about a ring's centre, pad axes, behind the plate's other markers."""
    plate, points = layout.plate, []
    for share in _BEHIND:
        m = share * ring.radius_m
        north, east = np.meshgrid(
            np.linspace(-plate.south_m - m, plate.north_m + m, 17),
            np.linspace(-plate.west_m - m, plate.east_m + m, 17),
        )
        grid = np.stack([north.ravel(), east.ravel()], axis=1)
        is_edge = (np.abs(north - north.mean()) > north.max() - north.mean() - 1e-9) | (
            np.abs(east - east.mean()) > east.max() - east.mean() - 1e-9
        )
        points.append(grid[is_edge.ravel()])
    p = np.concatenate(points)
    others = [np.array(other.position_m) for other in _others(layout, ring)]
    if not others:
        return np.empty((0, 2))
    own = np.hypot(*(p - np.array(ring.position_m)).T)
    near = np.min([np.hypot(*(p - o).T) for o in others], axis=0) < own
    ground: F64 = p[near] - np.array(ring.position_m)
    return ground


def _white_beside(layout: PadLayout, ring: Ring) -> F64:
    """Return points (n, 2) about a ring's centre, pad axes, that are white; none: it is alone.

    But those that may be the corners of another ring's own plate.
    """
    points = [
        s * _outline(other) + np.array(other.position_m)
        for other in _others(layout, ring)
        for s in _BESIDE
    ]
    if not points:
        return np.empty((0, 2))
    p = np.concatenate(points)
    good = on_plate(layout.plate, p)
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
    is_far = np.hypot(*white.T) > _FAR_BESIDE * ring.radius_m
    return np.asarray(white[is_far])


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
