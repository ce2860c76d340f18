"""A pad's heading by the outline of its plate about a ring, where no marker can be read.

A pad's tag is a third as wide as its ring: it can be read from half as far, and dirt, glare or leaf
shade may hide its code down to the ground. The plate is wider than the ring, and the ring is seldom
at its centre. So of all headings of plate and prints about the ring only one has white just inside
the plate's sides and ground beyond. The nearest of `HEADINGS` is found first; the distances of the
plate's sides from it (`plate_sides`) then give heading, place and size, of which the heading is
kept.

No heading is given if the plate looks alike from two sides and no print distinguishes them; nor if
a square on it is large enough in the picture for its cells to be seen, and they are not those of
its print: the plate may be another pad's.

`vision` adds the heading to a ring's measurement; `plate_check` asks whether the plate stands out
at one heading.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.messages import PoseSolution
from landerd.pad import PadLayout, Ring, Square
from landerd.vision.arrays import Image
from landerd.vision.patch import levels_at
from landerd.vision.plate_outline import CLIPPED, HEADINGS, outlines, own_levels
from landerd.vision.plate_sides import PlateSides
from landerd.vision.pose import normal_of, px_per_m, rotation_2d, rotation_from, wrapped
from landerd.vision.square import printed_cells

_ALL = slice(None)
_MIN_DIAMETER_PX = 18.0  # of the ring where it is narrowest
_SAME_CHI2 = 12.0  # a mirrored pose of the ring is not tried if its chi-square is larger by more

# ---- how much of the outlines is seen ----------------------------------------------------------
_LEAST_PRINT_PX = 5.0  # side of a print, px: smaller ones tell nothing
# A step (level inside minus level beyond an outline) counts in full from this share of the sum of
# both levels on, each increased by _NOISE, grey levels. The share is smaller where white is
# clipped; where the ground is clipped, the plate's outline tells nothing.
_WHOLE_STEP, _WHOLE_STEP_CLIPPED, _NOISE = 0.15, 0.05, 8.0
# Ink shows at most this share of the white about it. If a ring's black shows more, the rest is a
# veil that fog, haze or a lens with the sun on it lays over all levels: no share of a step goes by
# that.
_INK_SHARE = 0.4
_PLATE_WEIGHT = 0.65  # of the plate's outline; the rest is that of the prints'

# ---- which heading -----------------------------------------------------------------------------
_LEAST_IN_VIEW = 0.6  # share of the plate's outline that must be in the picture
# How much of the outlines must be seen, from 0 to 1, and by how much more (the lead) than at any
# heading turned by more than the third.
_LEAST_SEEN, _LEAST_LEAD, _OTHER_WAY = 0.5, 0.2, math.radians(30.0)
# If the heading is known to lie within the third: how much must be seen there, and the share that
# must be in the picture.
_LEAST_SEEN_CUT, _LEAST_CUT, _NEAR = 0.7, 0.2, math.radians(15.0)
# Sigma of the plate's centre, in radii of the ring, and of its size, a share, against what the ring
# and the pad file tell.
_OFF_SIGMA, _SIZE_SIGMA = 0.1, 0.05
# Factor on the fit's sigma, and the least that is added to it, rad: the error over the stated sigma
# of 560 rings of 40 field days, 18 px wide and more, is 0.6 rms (1.0 for the smallest). How askew a
# plate is that a builder measured nobody knows.
_INFLATION, _LEAST_SIGMA = 2.0, math.radians(1.0)

# ---- whether the plate stands out at one heading -----------------------------------------------
# A ring is not the pad's if the lead of all outlines and that of the plate's alone (prints fade)
# are below the first times that of a clean pad, or if less than the second is seen. Headings with
# more than _WHOLE_VIEW of the plate in the picture are compared; one with less, but more than
# _CUT_VIEW, leaves it open if more than _CUT_STANDS_OUT of what is in view is seen. Of 62 looks at
# other rings on 140 field days that nothing else refused 42 are refused so, of 551 at pads five.
_LEAD_SHARE, _LEAST_STANDS_OUT = 0.25, 0.35
_WHOLE_VIEW, _CUT_VIEW, _CUT_STANDS_OUT = 0.7, 0.25, 0.6
# The same as _CUT_STANDS_OUT if the plate would be cut at every heading, so that there is none to
# compare with. Of 180 pads whose ring the picture's edge cuts three had less than 0.6, 0.46 at
# least; of 100 black hoops so cut that nothing else refused five had 0.42 at most.
_ALL_CUT_STANDS_OUT = 0.45
# On ground as bright as the plate, or brighter (about wood or grey board), the plate's outline is
# not seen, and prints decide alone. Ground is such if the mean of the outline's steps, those to
# brighter ground counted as none, is at most the first, at every heading. Then so much of the
# prints must be seen, with this lead, where at least this share of them is in view. On white
# concrete and snow nine pads that the outline had refused gave 0.83 at least with leads from 0.79;
# of 160 other rings on concrete with up to three dark squares about them two pass, both too small
# for the code to tell.
_EVEN_GROUND, _PRINTS_STAND_OUT, _PRINTS_LEAD, _PRINTS_VIEW = 0.25, 0.7, 0.5, 0.4

# ---- whether the code on it is another's -------------------------------------------------------
# A square is checked if its cells are at least this wide, px, and at least this share of them is in
# view. Its code's cells, moved by one of these shifts, in cells, to the north and east, must
# correlate with the print by at least the last. Of 27 pictures of three tags that dirt, glare or
# leaf shade hid from every decoder all day 23 do; of 26 other prints one in 150, one in 25 on those
# three.
_CELL_PX, _LEAST_CELLS = 2.0, 0.4
_SHIFTS, _LEAST_CORRELATION = (-0.4, 0.0, 0.4), 0.4
_LEAST_SCATTER = 4.0  # grey levels, rms: with less it is one dark square


@dataclass(frozen=True, slots=True)
class PlateNorth:
    """A pad's north as its plate shows it."""

    north: F64  # unit vector (3,) in the ring's plane, camera frame
    sigma: float  # rad


class PlateHeading:
    """The outlines of a pad's plate and prints about one of its rings.

    Attributes:
        about: places on the outlines.
        sides: of the plate, to be fitted.
        angles: headings that are tried, rad.
    """

    def __init__(self, layout: PadLayout, ring: Ring) -> None:
        """Prepare the places to look at."""
        about = outlines(layout, ring)
        self._ring = ring
        self.about = about
        self._codes = [
            _Code.of(square, ring)
            for square in layout.squares
            if square.position_m != ring.position_m
        ]
        self._weights = about.weights(_PLATE_WEIGHT)
        self.angles = np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS)
        self._turns = np.stack([rotation_2d(a).T for a in self.angles])
        self._is_other = np.abs(wrapped(self.angles)) > _OTHER_WAY  # from the first one
        clean = self._clean_leads(layout, ring)
        self._least_leads = tuple(_LEAD_SHARE * lead for lead in clean)
        self.sides = PlateSides(about, ring.radius_m)

    def find(
        self,
        image: Image,
        camera: CameraModel,
        ring: tuple[PoseSolution, ...],
        known: F64 | None = None,
    ) -> PlateNorth | None:
        """Return the pad's north about a ring with these solutions; None: the plate is not seen.

        Args:
            image: grey image (height, width).
            camera: the lens.
            ring: its solutions, best first.
            known: expected north (3,), camera frame: near it less of the plate need be in the
                picture.
        """
        best: tuple[float, PlateNorth] | None = None
        for s in ring:
            if s.cost > ring[0].cost + _SAME_CHI2:
                continue
            t, normal = np.array(s.position), np.array(s.normal)
            if px_per_m(camera, t, normal) * self._ring.outer_diameter_m < _MIN_DIAMETER_PX:
                continue
            axes = rotation_from(normal)[:, :2]
            seen = self._nearest_way(image, camera, t, axes, known)
            if seen is None or (best is not None and best[0] >= seen[0]):
                continue
            fit = self.sides.fit(image, camera, t, axes, seen[1], _OFF_SIGMA, _SIZE_SIGMA)
            if fit is None:
                continue
            north = axes @ rotation_2d(fit.heading)
            if not self._is_another(image, camera, t, north):
                sigma = math.hypot(_INFLATION * math.sqrt(fit.covariance[0, 0]), _LEAST_SIGMA)
                best = seen[0], PlateNorth(north[:, 0], sigma)
        return None if best is None else best[1]

    def _nearest_way(
        self, image: Image, camera: CameraModel, t: F64, axes: F64, known: F64 | None
    ) -> tuple[float, float] | None:
        """Return how much is seen at the best heading, and that heading, rad; None: too little.

        Headings are about the axes (3, 2).
        """
        if known is not None:
            north, east = axes.T @ known
            off = np.abs(wrapped(self.angles - math.atan2(east, north)))
            (near,) = np.nonzero(off < _NEAR)
            seen, plate_in_view = self.ways(image, camera, t, axes, near)
            seen = np.where(plate_in_view > _LEAST_CUT, seen, -1.0)
            k = int(np.argmax(seen))
            if seen[k] > _LEAST_SEEN_CUT:
                return float(seen[k]), float(self.angles[near[k]])
        seen, plate_in_view = self.ways(image, camera, t, axes)
        whole = np.where(plate_in_view > _LEAST_IN_VIEW, seen, -1.0)
        k = int(np.argmax(whole))
        # For the lead, cut headings count too: a plate cut off behind its tag looks like one that
        # is turned by a quarter and cut less.
        seen = np.where(plate_in_view > _CUT_VIEW, seen, -1.0)
        if whole[k] < _LEAST_SEEN or self._lead(seen, k) < _LEAST_LEAD:
            return None
        return float(seen[k]), float(self.angles[k])

    def stands_out(self, image: Image, camera: CameraModel, t: F64, axes: F64) -> bool | None:
        """Tell whether the plate is seen about a ring at one heading more than at others.

        On ground as bright as the plate, or brighter, its prints must be, and no other code be seen
        there. White on all sides, or ground with bright spots, looks alike at many headings. None:
        undecided, as the plate may be out of the picture.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: the ring's centre (3,), camera frame, m.
            axes: two unit vectors (3, 2) in the ring's plane.
        """
        steps, weights, in_view = self._steps(image, camera, t, axes)
        k = self._of_prints_alone(steps, weights)
        if k is not None:
            return not self._is_another(image, camera, t, axes @ rotation_2d(float(self.angles[k])))
        seen = _mean(steps, weights)
        is_whole, is_cut = in_view > _WHOLE_VIEW, in_view > _CUT_VIEW
        most = _CUT_STANDS_OUT if is_whole.any() else _ALL_CUT_STANDS_OUT
        if not is_cut.any() or (seen[is_cut & ~is_whole] > most).any():
            return None
        seen = np.where(is_whole, seen, -1.0)
        of_plate = np.where(is_whole, _mean(steps, weights * self.about.is_plate), -1.0)
        of_all, of_plate_alone = self._least_leads
        leads = self._lead(seen) >= of_all or self._lead(of_plate) >= of_plate_alone
        return leads and float(seen.max()) > _LEAST_STANDS_OUT

    def _of_prints_alone(self, steps: F64, weights: F64) -> int | None:
        """Return the index of the heading at which prints stand out on bright ground; else None."""
        is_plate = self.about.is_plate
        if _mean(np.maximum(steps, 0.0), weights * is_plate).max() > _EVEN_GROUND:
            return None
        of_prints = weights * ~is_plate
        in_view = of_prints.sum(axis=1) > _PRINTS_VIEW * self._weights[~is_plate].sum()
        seen = np.where(in_view, _mean(steps, of_prints), 0.0)
        k = int(np.argmax(seen))
        return k if seen[k] > _PRINTS_STAND_OUT and self._lead(seen) > _PRINTS_LEAD else None

    def _is_another(self, image: Image, camera: CameraModel, t: F64, axes: F64) -> bool:
        """Tell whether another code is seen beside a ring at t (3,) under the pad's axes (3, 2)."""
        return any(code.is_another(image, camera, t, axes) for code in self._codes)

    def _lead(self, seen: F64, of: int | None = None) -> float:
        """Return how much more is seen at a heading than at any turned by more than `_OTHER_WAY`.

        `of` is the heading's index; None: that at which most is seen.
        """
        k = int(np.argmax(seen)) if of is None else of
        return float(seen[k]) - float(np.roll(seen, -k)[self._is_other].max())

    def _clean_leads(self, layout: PadLayout, ring: Ring) -> tuple[float, float]:
        """Return the leads of all outlines and of the plate's alone for a pad of ideal contrast."""
        inside, beyond = (
            _is_white(layout, ring, p @ self._turns).astype(float) for p in self.about.beside()
        )
        steps, weights = inside - beyond, np.broadcast_to(self._weights, inside.shape)
        both = _mean(steps, weights), _mean(steps, weights * self.about.is_plate)
        return self._lead(both[0]), self._lead(both[1])

    def ways(
        self,
        image: Image,
        camera: CameraModel,
        t: F64,
        axes: F64,
        which: NDArray[np.intp] | slice = _ALL,
    ) -> tuple[F64, F64]:
        """Return how much of the outlines is seen at each heading, and how much is in the picture.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: the ring's centre (3,), camera frame, m.
            axes: two unit vectors (3, 2) in the ring's plane.
            which: indices of the headings.

        Returns:
            weighted mean of the steps, from -1 to 1, and share of the plate's outline in the
            picture, (headings,) each.
        """
        steps, weights, plate_in_view = self._steps(image, camera, t, axes, which)
        return _mean(steps, weights), plate_in_view

    def _steps(
        self,
        image: Image,
        camera: CameraModel,
        t: F64,
        axes: F64,
        which: NDArray[np.intp] | slice = _ALL,
    ) -> tuple[F64, F64, F64]:
        """Return steps (-1 to 1) and weights (headings, n), and the plate's share in view."""
        about = self.about
        px, inside, beyond = about.levels(image, camera, t, axes, self._turns[which])
        in_view = ~np.isnan(inside - beyond)
        whole = np.where(inside > CLIPPED, _WHOLE_STEP_CLIPPED, _WHOLE_STEP)
        light = np.maximum(inside + beyond - 2.0 * self._veil(image, camera, t, axes), 0.0)
        steps = (inside - beyond) / (whole * (light + 2.0 * _NOISE))
        steps = np.where(in_view, np.clip(steps, -1.0, 1.0), 0.0)
        is_known = np.where(about.is_plate, beyond <= CLIPPED, px > _LEAST_PRINT_PX)
        weights = self._weights * (in_view & is_known)
        return steps, weights, in_view[:, about.is_plate].mean(axis=1)

    def _veil(self, image: Image, camera: CameraModel, t: F64, axes: F64) -> float:
        """Return the grey level that a veil adds to all levels about a ring; see `_INK_SHARE`."""
        levels = own_levels(image, camera, self._ring, t, axes)
        if levels is None:
            return 0.0
        black, white = levels
        return max((black - _INK_SHARE * white) / (1.0 - _INK_SHARE), 0.0)


def _mean(steps: F64, weights: F64) -> F64:
    """Return the weighted means of steps (headings, n), (headings,)."""
    mean: F64 = (steps * weights).sum(axis=1) / np.maximum(weights.sum(axis=1), 1e-9)
    return mean


def _is_white(layout: PadLayout, ring: Ring, points: F64) -> NDArray[np.bool_]:
    """Tell which points (..., 2) about a ring, pad's axes, m, lie on the plate but on no print."""
    plate, at = layout.plate, points + np.array(ring.position_m)
    north, east = np.moveaxis(at, -1, 0)
    is_white: NDArray[np.bool_] = (-plate.south_m < north) & (north < plate.north_m)
    is_white &= (-plate.west_m < east) & (east < plate.east_m)
    for marker in layout.markers:
        off = at - np.array(marker.position_m)
        if isinstance(marker, Square):
            off = off @ rotation_2d(math.radians(marker.heading_deg))
            is_white &= np.abs(off).max(axis=-1) > 0.5 * marker.size_m
        else:
            is_white &= np.hypot(off[..., 0], off[..., 1]) > marker.radius_m
    return is_white


@dataclass(frozen=True, slots=True)
class _Code:
    """The cells of a square's code, as they lie about a ring."""

    cells: F64  # 1 white and -1 black, less their mean, (n,)
    points: F64  # centres under all shifts, (shifts, n, 2), from the ring's centre, pad's axes, m
    cell_m: float

    @classmethod
    def of(cls, square: Square, ring: Ring) -> "_Code":
        print_ = printed_cells(square)
        cell = square.size_m / len(print_)
        at = cell * (np.arange(1, len(print_) - 1) - 0.5 * (len(print_) - 1))
        middles = np.stack(np.meshgrid(-at, at, indexing="ij"), axis=-1).reshape(-1, 2)
        shifts = cell * np.stack(np.meshgrid(_SHIFTS, _SHIFTS), axis=-1).reshape(-1, 1, 2)
        place = np.array(square.position_m) - np.array(ring.position_m)
        points = (middles + shifts) @ rotation_2d(math.radians(square.heading_deg)).T + place
        cells = 2.0 * print_[1:-1, 1:-1].ravel() - 1.0
        return cls(cells - cells.mean(), points, cell)

    def is_another(self, image: Image, camera: CameraModel, t: F64, axes: F64) -> bool:
        """Tell whether another code is seen beside a ring at t (3,) under the pad's axes (3, 2)."""
        if px_per_m(camera, t, normal_of(axes)) * self.cell_m < _CELL_PX:
            return False
        grey = levels_at(image, camera, t + self.points.reshape(-1, 2) @ axes.T)
        grey = grey.reshape(len(self.points), -1)
        in_view: NDArray[np.bool_] = ~np.isnan(grey)
        if in_view.mean() < _LEAST_CELLS:
            return False
        mean = np.where(in_view, grey, 0.0).sum(axis=1) / np.maximum(in_view.sum(axis=1), 1)
        off = np.where(in_view, grey - mean[:, None], 0.0)
        squared = np.maximum((off * off).sum(axis=1), _LEAST_SCATTER**2 * in_view.sum(axis=1))
        correlation = (off @ self.cells) / np.sqrt(squared * (self.cells @ self.cells))
        return float(correlation.max()) < _LEAST_CORRELATION
