"""The search of one image for a pad's ring: clear candidates first, hidden ones last.

`whycon.find_rings` calls the methods of `RingSearch` in the order that `RingWork.part` gives; each
spends some of the work that an image may cost (`ring_work`). A candidate is an outline that
`ring_segment` found. It is tried:

1. By a full fit to grey levels, from its outline or a rough fit (`ring_fit_stages`), and what
   follows from that (`ring_selection`). Clear candidates are tried as they are found, the others
   after all levels have been searched.
2. If it is dark in white, but the fit leaves too much unexplained, it is doubtful: behind a camera
   response, by its edges (`ring_explained`), and with a shadow or motion in the model.

Rings without a candidate are looked for by an arc at the image's edge (`ring_cut`), the plate's
outline (`plate_search`), or correlation with a level ring (`ring_match`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.messages import MarkerSighting
from landerd.pad import Ring
from landerd.vision.arrays import U8
from landerd.vision.plate_ring import PlateRing
from landerd.vision.plate_search import PlateSearch
from landerd.vision.pyramid import Level
from landerd.vision.ring_checks import (
    is_dark_in_white,
    is_poor,
    may_be_behind,
    may_have_edges,
    tells_ratio,
)
from landerd.vision.ring_cut import cut_rings
from landerd.vision.ring_explained import (
    Explained,
    Vouches,
    edge_fits,
    explained,
    matched_fits,
    vouched_grey,
)
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_fit_stages import (
    Start,
    full_fits,
    hard_fits,
    start_at_outline,
    start_at_pose,
    start_by_rough_fit,
)
from landerd.vision.ring_match import matches
from landerd.vision.ring_pose import mirrored, poses_through
from landerd.vision.ring_response import CameraResponse
from landerd.vision.ring_segment import (
    Candidate,
    Look,
    Segmentation,
    hole_candidates,
    ring_candidates,
)
from landerd.vision.ring_selection import explained_fits, fits_behind_response, is_ours, remember
from landerd.vision.ring_sighting import ring_sighting
from landerd.vision.ring_work import (
    EDGE_COST,
    FULL_COST,
    HARD_COST,
    RESPONSE_COST,
    ROUGH_COST,
    Place,
    RingWork,
)

Refusal = Callable[[MarkerSighting], bool]  # tells that a ring is not the pad's
# Finds the outlines in some looks of which a ring has this ratio: `ring_candidates` or
# `hole_candidates`.
_Find = Callable[[Sequence[Look], float], list[list[Candidate]]]

# ---- candidates --------------------------------------------------------------------------------
# A candidate is clear from this share of spokes on that are bright, dark and bright: it is fitted
# before all levels are searched. Plain rings gave 1.0; a photograph of the ground has 0.1 clear
# outlines on average.
_CLEAR_SHARE = 0.9
# Least diameter of a clear outline in its level, px, except in the finest one: a smaller ring shows
# better in the next finer level.
_CLEAR_PX = 9.0
# Outlines smaller than this share of the smallest ring wanted are not fitted. Of 254 rings of 10 to
# 16 px in all kinds of light all had an outline of at least 0.91 of the final fit's.
_SMALLEST_SHARE = 0.85

# ---- doubtful ones -----------------------------------------------------------------------------
# Share of spokes from which on shadow and motion are tried: in the same image, and in the image
# that continues a search. The first holds for four in ten of the doubtful outlines in photographs
# of the ground, and for rings except those with a shadow's edge across them.
_HARD_SHARE, _CONTINUED_HARD_SHARE = 0.9, 0.7
_EDGE_SHARE = 0.5  # share of spokes from which on a response or edges are tried

# ---- the image ---------------------------------------------------------------------------------
# A level is full of texture if at more than this share of its pixels dark and bright meet. Of 250
# tiles of photographs that are below it nine in ten have less than 0.03 in the finest level; the
# fullest of all have 0.19.
_MAX_EDGE_SHARE = 0.05
# Largest distance of a fit from the place that its plate's outline tells, a share of the range.
_OFF_PLATE = 0.12
_MOST_MATCHED = 2  # places tried that correlate best with a level ring
_MOST_CUT = 2  # arcs tried of rings that the image's edge may cut


@dataclass(frozen=True)
class Beside:
    """What the surroundings of a ring tell about it; None: that is not asked."""

    refuses: Refusal | None = None  # a ring is not the pad's
    vouches: Vouches | None = None  # a ring is the pad's, although its edges alone do not show it
    plate: PlateSearch | None = None  # where a ring lies, by the outline of its plate
    on_plate: PlateRing | None = None  # the ring itself on level ground, by the plate's sides


@dataclass(frozen=True)
class _Try:
    """A candidate that is worth a fit."""

    level: Level
    candidate: Candidate
    place: Place


@dataclass(frozen=True)
class _Doubtful:
    """A candidate that may be a ring behind a camera response, in shadow or in motion."""

    place: Place
    share: float  # of the candidate's spokes that are bright, dark and bright
    fits: list[RingFit]  # plain ones, best first
    is_linear: bool = False  # a response was tried and does not explain it


class RingSearch:
    """The search of one image: what was found, what is left to try, and what is doubtful.

    Attributes:
        found: the rings found so far.
    """

    def __init__(
        self,
        image: U8,
        ring: Ring,
        camera: CameraModel,
        down: Vec3 | None,
        work: RingWork,
        response: CameraResponse,
        beside: Beside,
    ) -> None:
        self._image, self._ring, self._camera, self._down = image, ring, camera, down
        self._work, self._response = work, response
        self._refuses, self._vouches, self._plate = beside.refuses, beside.vouches, beside.plate
        self._on_plate = beside.on_plate
        self._later: list[_Try] = []  # candidates that are not clear
        self._doubtful: list[_Doubtful] = []
        self._level_found: Level | None = None  # in which a ring was found
        # What is dark in a level, by the level's reduction and the segmentation.
        self._darks: dict[tuple[float, Segmentation], U8] = {}
        self._has_tried_hidden = False  # `_clearly_hidden` is tried once in an image
        self.found: list[MarkerSighting] = []

    @property
    def is_level_known(self) -> bool:
        """Whether gravity is known, so that `find_matched` can look for a level ring."""
        return self._on_plate is not None and self._down is not None

    def nearest_first(self) -> list[MarkerSighting]:
        """Return the rings found, the nearest first."""
        return sorted(self.found, key=lambda s: s.solutions[0].position[2])

    def find_clear(self, looks: Sequence[tuple[Level, Segmentation]]) -> bool:
        """Fit the clear candidates, look by look, until one shows a ring; tell whether one did.

        Candidates that are not clear are kept for `find_doubtful`.
        """
        return self._find_clear_by(looks, ring_candidates)

    def find_holes(self, looks: Sequence[tuple[Level, Segmentation]]) -> bool:
        """Do the same with outlines of holes, for rings whose outer edge is broken."""
        return self._find_clear_by(looks, hole_candidates)

    def _find_clear_by(self, looks: Sequence[tuple[Level, Segmentation]], find: _Find) -> bool:
        ratio = self._ring.inner_ratio
        # Of a level with nothing dark in it, as of the sky, nothing is worked out.
        looks = [(v, s) for v, s in looks if cv2.hasNonZero(self._dark(v, s))]
        least_px = _SMALLEST_SHARE * self._work.smallest_px
        of_looks = find(
            [
                Look(v.image, self._dark(v, s), v.largest_px, least_px / v.reduction)
                for v, s in looks
            ],
            ratio,
        )
        return any(
            self._find_clear(level, candidates)
            for (level, _), candidates in zip(looks, of_looks, strict=True)
        )

    def _dark(self, level: Level, segment: Segmentation) -> U8:
        """Return what is dark in a level, 255 there and else 0; segmented once."""
        key = level.reduction, segment
        if key not in self._darks:
            self._darks[key] = segment(level.image)
        return self._darks[key]

    def is_textured(self, level: Level, segment: Segmentation) -> bool:
        """Tell whether a level is so full of texture that labelling the next finer one takes long.

        Edges are counted instead of time, so that the answer is the same on any machine.
        """
        dark = self._dark(level, segment)
        edges = cv2.countNonZero(cv2.bitwise_xor(dark[:, 1:], dark[:, :-1]))
        return edges > _MAX_EDGE_SHARE * dark.size

    def _find_clear(self, level: Level, candidates: list[Candidate]) -> bool:
        for candidate in candidates:
            one = _Try(level, candidate, _place(level, candidate))
            is_clear = candidate.share >= _CLEAR_SHARE and (
                level.reduction <= 1.0 or one.place.size_px >= _CLEAR_PX * level.reduction
            )
            if is_clear and not self._is_known(one.place):
                self._try(one)
            else:
                self._later.append(one)
        return bool(self.found)

    def find_cut(self, level: Level, segment: Segmentation) -> bool:
        """Fit edges to dark arcs that end at the image's edge; tell whether one is the ring.

        Done in the first image that gets a part of the search, not where that part is continued.
        """
        if self._work.is_continued:
            return False
        cut = cut_rings(self._dark(level, segment), level.camera, self._ring)
        for poses in cut[:_MOST_CUT]:
            if not self._work.affords(EDGE_COST):
                break
            fits = edge_fits(self._image, self._camera, self._ring, poses, self._vouches)
            if fits and self._report(fits, level):
                return True
        return False

    def find_on_plate(self, levels: Sequence[Level]) -> bool:
        """Fit edges, else grey levels, where the outline of the pad's plate shows the ring to be.

        Done once, as `find_cut`.
        """
        if self._plate is None or self._work.is_continued:
            return False
        pose = self._plate.find(self._image, levels, self._camera)
        if pose is None or not self._work.affords(EDGE_COST):
            return False
        other = mirrored(*pose, self._ring.radius_m)
        starts = [pose] if other is None else [pose, other]
        # If the plate carries other markers beside the ring, its outline has vouched already.
        vouches = None if self._vouches is None else lambda *_: True
        fits = edge_fits(self._image, self._camera, self._ring, starts, vouches)
        if not fits and self._work.affords(FULL_COST):
            grey = full_fits(self._image, self._camera, self._ring, start_at_pose(pose))
            grey = [f for f in grey if _is_near(f.position, pose[0])]
            fits = vouched_grey(self._camera, self._ring, grey, self._vouches) if grey else []
        return bool(fits) and self._report(fits)

    def find_matched(self, sizes: Sequence[float]) -> bool:
        """Fit edges, else the plate's sides, where the image correlates best with a level ring.

        Done once, as `find_cut`. `sizes` are the longer diameters that are tried, px.
        """
        if self._on_plate is None or self._down is None or self._work.is_continued:
            return False
        places = matches(self._image, self._camera, self._ring, self._down, sizes, _MOST_MATCHED)
        for place in places:
            if self._work.affords(EDGE_COST):
                start = place, np.array(self._down)
                fits = matched_fits(self._image, self._camera, self._ring, start, self._vouches)
                if fits and self._report(fits):
                    return True
            if not self._work.affords(ROUGH_COST):
                break
            sighting = self._on_plate.find(self._image, self._camera, place, self._down)
            if sighting is not None:
                self.found.append(sighting)
                return True
        return False

    def find_doubtful(self) -> None:
        """Fit the candidates left for later, the likeliest first, until the work is spent.

        Once a level has shown a ring, only that level's candidates are fitted. Places that were
        refused in another level come last.
        """
        later = sorted(self._later, key=lambda t: (-t.candidate.share, -t.candidate.score))
        again = []
        for one in later:
            if self._work.is_done(one.place):
                continue
            if self._is_known(one.place):
                again.append(one)
            elif not self._try_of_level(one):
                return
        for one in again:
            if not self._try_of_level(one):
                return

    def find_hard(self) -> None:
        """Fit doubtful ones behind a response and by their edges, then with shadow and motion."""
        unclear = self._find_toned()
        if not self.found:
            self._find_shaded_or_moving(has_edges=unclear is not None)
        if unclear is not None and not self.found:
            self._report(unclear.fits)
        for one in self._doubtful:
            is_over = self._work.is_unexplained(one.place) or not _may_be_toned(one)
            if is_over and one.share < _CONTINUED_HARD_SHARE:
                self._work.refuse(one.place)

    def _find_toned(self) -> Explained | None:
        """Take the first doubtful one that a response, or edges moved by a tone curve, explain.

        Returns:
            if none is: the first that has a ring's edges without such a shift, which shadow or
            motion may explain better.
        """
        unclear = None
        best_first = sorted(self._doubtful, key=lambda d: d.fits[0].noise / d.fits[0].contrast)
        for one in filter(_may_be_toned, best_first):
            if self._work.is_unexplained(one.place):
                continue
            fits = [] if one.is_linear else self._behind_response(one.fits[0])
            if not fits:
                if not self._work.affords(EDGE_COST):
                    break
                by_edges = explained(self._image, self._camera, self._ring, one.fits, self._vouches)
                self._work.leave_unexplained(one.place)
                unclear = unclear or by_edges
                fits = by_edges.fits if by_edges is not None and by_edges.is_toned else []
            if fits and self._report(fits):
                return None
        return unclear

    def _behind_response(self, fit: RingFit) -> list[RingFit]:
        """Return the fits behind a response; empty: it explains nothing, or work is short."""
        if not may_be_behind(fit) or not self._work.affords(RESPONSE_COST):
            return []
        return fits_behind_response(self._image, self._camera, self._ring, fit)

    def _report(self, fits: list[RingFit], level: Level | None = None) -> bool:
        """Add a ring to those found unless it is refused as not the pad's; tell whether it was."""
        sighting = ring_sighting(fits, self._ring, self._camera, self._down)
        if self._refuses is not None and self._refuses(sighting):
            return False
        remember(self._response, fits[0])
        self.found.append(sighting)
        self._level_found = level or self._level_found
        return True

    def _find_shaded_or_moving(self, *, has_edges: bool) -> None:
        """Fit the best doubtful one with shadow and motion, in this image or in a later one.

        In texture it is left for a later one, unless a doubtful one has a ring's edges
        (`has_edges`): then it is done whatever it costs.
        """
        waits = self._work.is_spread and not self._work.is_continued
        hard = [] if waits and not has_edges else self._hard_now()
        if not hard or not (has_edges or self._work.affords(HARD_COST)):
            if any(d.share >= _CONTINUED_HARD_SHARE for d in self._doubtful):
                self._work.cut()
            return
        best = min(hard, key=lambda d: d.fits[0].noise / d.fits[0].contrast)
        fits = hard_fits(self._image, self._camera, self._ring, best.fits)
        if is_ours(self._image, self._camera, self._ring, fits[0]) and self._report(fits):
            return
        self._work.refuse(best.place)
        if not all(d.place.is_same(best.place) for d in self._doubtful):
            self._work.cut()

    def _hard_now(self) -> list[_Doubtful]:
        """Return the doubtful ones that are worth a fit with shadow and motion in this image."""
        least = _CONTINUED_HARD_SHARE if self._work.is_continued else _HARD_SHARE
        return [d for d in self._doubtful if d.share >= least and is_poor(d.fits[0])]

    def _is_known(self, place: Place) -> bool:
        """Tell whether a plain fit at this place was tried and showed no ring."""
        return self._work.is_refused(place) or any(d.place.is_same(place) for d in self._doubtful)

    def _try_of_level(self, one: _Try) -> bool:
        """Fit a candidate unless a ring was found in another level; False: no work is left."""
        is_wanted = self._level_found is None or self._level_found is one.level
        return self._try(one) if is_wanted else True

    def _reserve(self) -> int:
        """Return the cost to keep in reserve for explaining the best doubtful one.

        Including shadow and motion if that much is left, else without; 0 if not even that is left.
        """
        toned = [
            d for d in self._doubtful if _may_be_toned(d) and not self._work.is_unexplained(d.place)
        ]
        cost = EDGE_COST * bool(toned) + RESPONSE_COST * any(not d.is_linear for d in toned)
        hard_cost = cost + HARD_COST * bool(self._hard_now())
        return next((c for c in (hard_cost, cost) if self._work.has(c)), 0)

    def _try(self, one: _Try) -> bool:
        """Fit a candidate; False: no work is left for it.

        It is then reported, kept as doubtful, or its place refused.
        """
        if one.candidate.is_bloomed:
            return self._try_edges(one)
        reserve = self._reserve()
        if not self._work.affords_search(ROUGH_COST, reserve):
            return False
        is_clear = one.candidate.share >= _CLEAR_SHARE
        if is_clear:
            # A rough fit first takes twice as long, and tells no more.
            start = start_at_outline(
                self._image, self._camera, one.level, one.candidate, self._ring
            )
        else:
            start = start_by_rough_fit(one.level, one.candidate, self._ring)
        if start is None and is_clear:
            return self._try_edges(one)
        if start is None or any(_covers(s, self._camera, start.pose[0]) for s in self.found):
            self._work.refuse(one.place)
            return True
        fitted = self._full_fits(start, reserve)
        if fitted is None:
            return False
        fits, has_ring = fitted
        if has_ring:
            fits = explained_fits(
                self._image, self._camera, self._ring, fits, self._vouches, are_full=True
            )
            return self._reported(one, fits)
        is_dark = bool(fits) and is_dark_in_white(fits[0])
        if is_dark and tells_ratio(fits[0], self._ring):
            is_first = is_clear and not self._has_tried_hidden
            hidden = self._clearly_hidden(one.place, fits) if is_first else []
            if hidden:
                return self._reported(one, hidden)
            is_linear = is_first and not self._response.pictures_by_edges
            self._doubtful.append(_Doubtful(one.place, one.candidate.share, fits, is_linear))
        elif is_clear and not is_dark:
            return self._try_edges(one)
        else:
            self._work.refuse(one.place)
        return True

    def _full_fits(self, start: Start, reserve: int) -> tuple[list[RingFit], bool] | None:
        """Return the full fits from a start, and if they are of our ring; None: no work is left.

        Where clipped white does not explain what is seen, motion, shadow or edges may, and these
        begin with fits without it.
        """
        for clips in (True, False):
            if not self._work.affords_search(FULL_COST, reserve):
                return None
            fits = full_fits(
                self._image, self._camera, self._ring, start, self._response.response, clips=clips
            )
            has_ring = bool(fits) and is_ours(self._image, self._camera, self._ring, fits[0])
            if has_ring or not fits or fits[0].is_told is None:
                break
        return fits, has_ring

    def _reported(self, one: _Try, fits: list[RingFit]) -> bool:
        """Report the fits of a candidate, or refuse its place if there are none; always True."""
        if not fits or not self._report(fits, one.level):
            self._work.refuse(one.place)
        return True

    def _try_edges(self, one: _Try) -> bool:
        """Fit a candidate's edges only; False: no work is left for it."""
        if not self._work.affords(EDGE_COST):
            return False
        rays = one.level.camera.rays(one.candidate.outline.points())
        starts = poses_through(rays, self._ring.radius_m)
        fits = edge_fits(self._image, self._camera, self._ring, starts or [], self._vouches)
        return self._reported(one, fits)

    def _clearly_hidden(self, place: Place, fits: list[RingFit]) -> list[RingFit]:
        """Return the fits of a clear but poorly fitted candidate behind a response or by edges.

        Only for the first such candidate of an image. Which of both is tried depends on what
        explained the last rings (`CameraResponse`); empty: it does not explain this one.
        """
        self._has_tried_hidden = True
        if not self._response.pictures_by_edges:
            return self._behind_response(fits[0])
        if not self._work.affords(EDGE_COST):
            return []
        by_edges = explained(self._image, self._camera, self._ring, fits, self._vouches)
        if by_edges is None:
            self._work.leave_unexplained(place)
        return [] if by_edges is None else by_edges.fits


def _place(level: Level, candidate: Candidate) -> Place:
    """Return the place of a level's candidate in the whole image."""
    outline = candidate.outline
    k = level.reduction
    (a, b), (c, d) = outline.axes.tolist()
    size = 2.0 * k * math.sqrt(abs(a * d - b * c))
    return Place((outline.centre + 0.5) * k - 0.5 + level.corner, size, k)


def _may_be_toned(one: _Doubtful) -> bool:
    """Tell whether a response or edges may explain what the plain fit does not."""
    return one.share >= _EDGE_SHARE and may_have_edges(one.fits[0], one.share)


def _is_near(position: F64, plate: F64) -> bool:
    """Tell whether a ring is near the place that its plate's outline tells, (3,) each, m."""
    return float(np.linalg.norm(position - plate)) < _OFF_PLATE * float(np.linalg.norm(plate))


def _covers(sighting: MarkerSighting, camera: CameraModel, position: F64) -> bool:
    """Tell whether a ring's centre (3,), camera frame, m, lies inside a ring already found."""
    polygon = np.array(sighting.outline_px, dtype=np.float32)
    x, y = camera.pixels(position[None])[0]
    return cv2.pointPolygonTest(polygon, (float(x), float(y)), False) >= 0
