"""The search of one image for a pad's ring: what is clear first, what is hidden last."""

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

Refusal = Callable[[MarkerSighting], bool]  # tells that a ring is another's
_Find = Callable[[Sequence[Look], float], list[list[Candidate]]]

# Share of the spokes from which an outline is fitted before all levels are searched: plain rings
# gave 1.0, and 0.1 of the outlines in a photograph of the ground.
_CLEAR_SHARE = 0.9
# Up to such a reduction a clear outline is within a pixel or so of the image's, where the full fit
# may start: a rough one takes half as long again. 1200 pictures showed as many rings as with it.
_EXACT_REDUCTION = 4.0
# Of the smallest ring wanted: what is smaller is not fitted. Of 254 rings of 10 to 16 px in all
# kinds of light all had an outline of 0.91 and more of what the fit has in the end.
_SMALLEST_SHARE = 0.85
_CLEAR_PX = 9.0  # least diameter of it, but in the finest level: another shows it better
# Share from which shadow and motion are tried at once, not in the next image: four of ten of the
# doubtful ones in photographs of the ground, and rings but those with a shadow's edge across them.
_HARD_SHARE, _CONTINUED_HARD_SHARE = 0.9, 0.7  # at once, and in the next image
_EDGE_SHARE = 0.5  # from which edges are looked at
# Of a level's pixels, those at which dark and bright meet: of 250 tiles of photographs below it
# nine in ten have less than 0.03 of them in the finest level, the fullest of all have 0.19.
_MAX_EDGE_SHARE = 0.05
_OFF_PLATE = 0.12  # of the range: what a fit may be off the place that its plate's outline tells
_MOST_MATCHED = 2  # places that are looked at for a ring that is like one on the whole
_MOST_CUT = 2  # rings that the image's edge may cut


@dataclass(frozen=True)
class Beside:
    """What lies beside a ring: whether it speaks against it, or for it where its edges do not."""

    refuses: Refusal | None = None
    vouches: Vouches | None = None
    plate: PlateSearch | None = None  # tells where to look for a ring that shows nothing round
    on_plate: PlateRing | None = None  # finds one on level ground that only its plate shows


@dataclass(frozen=True)
class _Try:
    """A candidate that is worth a fit."""

    level: Level
    candidate: Candidate
    place: Place


@dataclass(frozen=True)
class _Doubtful:
    """Fits that may be those of a ring behind a response, in shadow or motion."""

    place: Place
    share: float  # of the candidate's spokes
    fits: list[RingFit]
    is_linear: bool = False  # no response explains it


class RingSearch:
    """The search of one image: what was found, what is left to try and what was doubtful."""

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
        self._later: list[_Try] = []
        self._doubtful: list[_Doubtful] = []
        self._level_found: Level | None = None
        self._darks: dict[tuple[float, Segmentation], U8] = {}  # of levels, by their reduction
        self._has_tried_hidden = False
        self.found: list[MarkerSighting] = []

    @property
    def is_level_known(self) -> bool:
        """Whether it can look for rings on level ground that only their plates show."""
        return self._on_plate is not None and self._down is not None

    def nearest_first(self) -> list[MarkerSighting]:
        """Return what was found."""
        return sorted(self.found, key=lambda s: s.solutions[0].position[2])

    def find_clear(self, looks: Sequence[tuple[Level, Segmentation]]) -> bool:
        """Fit what is clearly bright, dark and bright in the first of some looks that shows any.

        The rest is left for later.
        """
        return self._find_clear_by(looks, ring_candidates)

    def find_holes(self, looks: Sequence[tuple[Level, Segmentation]]) -> bool:
        """Do the same with what may be the hole of a ring whose outer edge is broken."""
        return self._find_clear_by(looks, hole_candidates)

    def _find_clear_by(self, looks: Sequence[tuple[Level, Segmentation]], find: _Find) -> bool:
        ratio = self._ring.inner_ratio
        looks = [(v, s) for v, s in looks if cv2.hasNonZero(self._dark(v, s))]  # not in the sky
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
        """Return what is dark in a level, worked out once."""
        key = level.reduction, segment
        if key not in self._darks:
            self._darks[key] = segment(level.image)
        return self._darks[key]

    def is_textured(self, level: Level, segment: Segmentation) -> bool:
        """Tell whether a level is so full of what is dark that to label the next finer is dear.

        What is counted is the same on any machine.
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
        """Fit the edges of what is dark and the edge of a level of the whole image cuts.

        Once in a search: it goes on in the next image with what else there is.
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
        """Fit edges where the outline of the pad's plate tells that the ring is.

        Once in a search, as `find_cut`.
        """
        if self._plate is None or self._work.is_continued:
            return False
        pose = self._plate.find(self._image, levels, self._camera)
        if pose is None or not self._work.affords(EDGE_COST):
            return False
        other = mirrored(*pose, self._ring.radius_m)
        starts = [pose] if other is None else [pose, other]
        # Where there is more than the ring on it, the plate itself vouches.
        vouches = None if self._vouches is None else lambda *_: True
        fits = edge_fits(self._image, self._camera, self._ring, starts, vouches)
        if not fits and self._work.affords(FULL_COST):
            grey = full_fits(self._image, self._camera, self._ring, start_at_pose(pose))
            grey = [f for f in grey if _is_near(f.position, pose[0])]
            fits = vouched_grey(self._camera, self._ring, grey, self._vouches) if grey else []
        return bool(fits) and self._report(fits)

    def find_matched(self, sizes: Sequence[float]) -> bool:
        """Fit edges, or else the pad's plate, to what is likest a level ring of some sizes, px.

        Once in a search, as `find_cut`.
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
        """Fit what was left, the likeliest first, until a level shows a ring or work is over."""
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
        """Fit the best doubtful with a response and to edges, then with shadow and motion."""
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
        """Take the first ring that a tone curve hides; return what edges alone may vouch for."""
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
        """Return the fits behind a response, where that is worth its cost; empty: none."""
        if not may_be_behind(fit) or not self._work.affords(RESPONSE_COST):
            return []
        return fits_behind_response(self._image, self._camera, self._ring, fit)

    def _report(self, fits: list[RingFit], level: Level | None = None) -> bool:
        """Take a ring, seen in a level, for found unless it is another's; tell whether it was."""
        sighting = ring_sighting(fits, self._ring, self._camera, self._down)
        if self._refuses is not None and self._refuses(sighting):
            return False
        remember(self._response, fits[0])
        self.found.append(sighting)
        self._level_found = level or self._level_found
        return True

    def _find_shaded_or_moving(self, *, has_edges: bool) -> None:
        """Fit the best doubtful one with shadow and motion, now or in a later image.

        In texture at once only if there is one with a ring's edges, whatever it costs.
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
        """Return the doubtful ones that may be tried with shadow and motion in this image."""
        least = _CONTINUED_HARD_SHARE if self._work.is_continued else _HARD_SHARE
        return [d for d in self._doubtful if d.share >= least and is_poor(d.fits[0])]

    def _is_known(self, place: Place) -> bool:
        """Tell whether a place was tried and showed no ring by a plain fit."""
        return self._work.is_refused(place) or any(d.place.is_same(place) for d in self._doubtful)

    def _try_of_level(self, one: _Try) -> bool:
        """Fit a candidate if none was found in another level; False: there is no work left."""
        is_wanted = self._level_found is None or self._level_found is one.level
        return self._try(one) if is_wanted else True

    def _reserve(self) -> int:
        """Return what is kept to explain the best of what was doubtful, if that is still left."""
        toned = [
            d for d in self._doubtful if _may_be_toned(d) and not self._work.is_unexplained(d.place)
        ]
        cost = EDGE_COST * bool(toned) + RESPONSE_COST * any(not d.is_linear for d in toned)
        hard_cost = cost + HARD_COST * bool(self._hard_now())
        return next((c for c in (hard_cost, cost) if self._work.has(c)), 0)

    def _try(self, one: _Try) -> bool:
        """Fit a candidate; False: there is no work left for it."""
        if one.candidate.is_bloomed:
            return self._try_edges(one)
        reserve = self._reserve()
        if not self._work.affords_search(ROUGH_COST, reserve):
            return False
        is_clear = one.candidate.share >= _CLEAR_SHARE
        is_exact = is_clear and one.level.reduction <= _EXACT_REDUCTION
        find_start = start_at_outline if is_exact else start_by_rough_fit
        start = find_start(one.level, one.candidate, self._ring)
        if start is None and is_clear:
            return self._try_edges(one)
        if start is None or any(_covers(s, self._camera, start.pose[0]) for s in self.found):
            self._work.refuse(one.place)
            return True
        if not self._work.affords_search(FULL_COST, reserve):
            return False
        response = self._response.response
        fits = full_fits(self._image, self._camera, self._ring, start, response)
        if fits and is_ours(self._image, self._camera, self._ring, fits[0]):
            fits = explained_fits(self._image, self._camera, self._ring, fits, self._vouches)
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

    def _reported(self, one: _Try, fits: list[RingFit]) -> bool:
        """Report what is the ring of a candidate, if it is one; always True."""
        if not fits or not self._report(fits, one.level):
            self._work.refuse(one.place)
        return True

    def _try_edges(self, one: _Try) -> bool:
        """Fit nothing but the edges of a candidate; False: there is no work left for it."""
        if not self._work.affords(EDGE_COST):
            return False
        rays = one.level.camera.rays(one.candidate.outline.points())
        starts = poses_through(rays, self._ring.radius_m)
        fits = edge_fits(self._image, self._camera, self._ring, starts or [], self._vouches)
        return self._reported(one, fits)

    def _clearly_hidden(self, place: Place, fits: list[RingFit]) -> list[RingFit]:
        """Return the fits of the first that is clearly bright, dark and bright; empty: no ring."""
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
    """Return where in the whole image a candidate of a level is."""
    outline = candidate.outline
    k = level.reduction
    (a, b), (c, d) = outline.axes.tolist()
    size = 2.0 * k * math.sqrt(abs(a * d - b * c))
    return Place((outline.centre + 0.5) * k - 0.5 + level.corner, size, k)


def _may_be_toned(one: _Doubtful) -> bool:
    """Tell whether a response or edges may explain what a plain fit does not."""
    return one.share >= _EDGE_SHARE and may_have_edges(one.fits[0], one.share)


def _is_near(position: F64, plate: F64) -> bool:
    """Tell whether a ring is where its plate's outline tells, (3,) both, m."""
    return float(np.linalg.norm(position - plate)) < _OFF_PLATE * float(np.linalg.norm(plate))


def _covers(sighting: MarkerSighting, camera: CameraModel, position: F64) -> bool:
    """Tell whether a centre lies inside a ring already found."""
    polygon = np.array(sighting.outline_px, dtype=np.float32)
    x, y = camera.pixels(position[None])[0]
    return cv2.pointPolygonTest(polygon, (float(x), float(y)), False) >= 0
