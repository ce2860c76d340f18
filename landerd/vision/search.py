"""The search of a frame for a pad's rings and squares.

`search_policy` decides what is looked for and how often. This module knows where: markers are
tracked, that is fitted, where they are expected, or else detected in a window there; rings are
searched in the whole image; squares round the rings that were found. The pixels are left to
`Detectors`. WhyCodes have a finder of their own (`whycode.py`).
"""

import math
from collections.abc import Sequence

import numpy as np

from landerd.camera_model import F64, CameraModel, Window
from landerd.geometry import Vec3, dot
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring, Square
from landerd.vision import search_policy as policy
from landerd.vision.arrays import Image
from landerd.vision.choice import same_outline
from landerd.vision.detectors import Detectors
from landerd.vision.expected import Expected
from landerd.vision.linear import inverse, length, trace
from landerd.vision.patch import is_any_in_picture, whole_in_picture
from landerd.vision.pose import MIN_DEPTH_M, Pose, box, circle, rotation_2d, rotation_from
from landerd.vision.print_edges import EdgeFit
from landerd.vision.ring_search import Refusal
from landerd.vision.ring_work import RingWork
from landerd.vision.search_policy import ExpectedRings, RingSearch, Seen, SquareSearch
from landerd.vision.square import FoundSquare
from landerd.vision.square_pose import shortest_side, square_points

# How many sightings are kept for one ring of the pad, the nearest: look-alikes may be nearer.
_RINGS_KEPT = 3

# ---- squares -----------------------------------------------------------------------------------
# A window in which squares of known size are expected is scaled so that their side is about the
# first of these, px, chosen for speed (it was 40); detected or tracked squares have at least the
# second.
_SEARCH_SIDE_PX, _MIN_SIDE_PX = 28.0, 14.0
# Enlargement from which on squares are not looked for: of less than 6.2 px. Of 60 tags of 6 to 8 px
# in exact pictures 36 are read, with 3.5 (8 px) 9; in the field world none of 139 of less than 8 px
# was, and of 61 of 8 to 10 px 21.
_MAX_SCALE = 4.5
# If that shows no square, the window is searched once more with its light evened over a surrounding
# of the second of these, px, and scaled so that the side is about the first. Of tags with a
# shadow's edge across them, to 0.2 of the light, no other way showed any, this one all from 26 px
# on.
_EVENED_SIDE_PX, _EVENED_PX = 40.0, 13
_MAX_EVENED_SCALE = 1.4  # enlargement from which on a square is too small for that
# Scale at which the whole of a textured image is looked at before the next one is searched at its
# full size: in less than half of the time it shows all of 93 tags of the thesis's pad at 0.7 to 2 m
# and half of those at 5 m, in exact pictures.
_GLANCE_SCALE = 0.5
# The least foreshortening by which the enlargement allows for an oblique view: the cosine of the
# angle between line of sight and normal.
_MIN_SLANT = 0.35
# A square tells the pose as well as all markers do if its sigma over its range is less than this:
# what disturbs a square (dirt, leaf shade) disturbs a ring less.
_TELLING_SHARE = 0.005

# ---- rings -------------------------------------------------------------------------------------
# Sigma over range of a ring below which its plate's sides are not needed to tell its place.
_SURE_SHARE = 0.06

# ---- windows -----------------------------------------------------------------------------------
# Margin of a window round what is expected: a share of its extent, plus sigmas of its place.
_WINDOW_MARGIN, _WINDOW_SIGMAS = 0.2, 3.0
# The window round a ring holds all the pad's squares whatever the heading; its margin is a share of
# its extent, plus px.
_ROUND_MARGIN, _SQUARE_MARGIN_PX = 0.05, 4.0
_HEADINGS = 32  # at which a square beside a ring is tested for lying wholly in the picture

FoundRing = tuple[Ring, MarkerSighting]


class Search:
    """Looks for the rings and squares of one pad in the images of one camera.

    From frame to frame it remembers `search_policy.SearchState`, and for each ring how far the
    search of the whole image has come (`RingWork`).
    """

    def __init__(
        self,
        layout: PadLayout,
        camera: CameraModel,
        min_ring_px: float,
        detectors: Detectors,
    ) -> None:
        """Prepare the search; rings smaller than min_ring_px across are not reported."""
        self._layout = layout
        self._camera = camera
        self._min_ring_px = min_ring_px
        self._detectors = detectors
        self._state = policy.SearchState()
        self._saw_bare = False  # a ring was refused in this image as it has no plate about it
        self._vouched = False  # see `find`
        # Squares decoded round each ring of this image.
        self._round: dict[MarkerSighting, list[FoundSquare]] = {}
        self._ring_work = {r: RingWork(smallest_px=min_ring_px) for r in layout.rings}

    @property
    def was_cut(self) -> bool:
        """Whether the search of the last image goes on in the next."""
        return self._state.was_cut or self._state.squares_wait

    def find(
        self,
        t: float,
        image: Image,
        expected: Expected | None,
        down: Vec3 | None,
        *,
        ring_only_frames: int,
        vouched: bool = False,
    ) -> tuple[list[FoundRing], list[FoundSquare]]:
        """Return what may be the pad's rings (the nearest few for each), and its squares.

        Args:
            t: the image's time, s.
            image: grey image (height, width).
            expected: where the pad should be; None: anywhere.
            down: unit vector of gravity, camera frame.
            ring_only_frames: for how many frames in a row a ring is enough
                (`search_policy.ring_only_frames`).
            vouched: whether a ring where the pad is expected is the pad's even if the plate with
                the other markers is not seen about it. A ring without plate elsewhere is refused,
                and the search goes on.
        """
        self._saw_bare, self._vouched = False, vouched
        self._round = {}
        rings: list[FoundRing] = []
        squares: list[FoundSquare] = []
        ring_only = False
        if expected is not None:
            if policy.is_ring_enough(self._state, ring_only_frames):
                rings = self._rings_expected(image, expected, down, ExpectedRings.ALL)
                ring_only = bool(rings)
            if not ring_only:
                squares = self._squares_expected(image, expected)
                which = policy.rings_beside([_telling_side_px(s) for s in squares])
                rings = self._rings_expected(image, expected, down, which)
        seen = Seen(bool(rings), bool(squares), ring_only)
        if not (rings or squares) and self._detectors.is_blank(image):
            self._end_rings()
            self._state = policy.SearchState()
            return [], []
        layout = self._layout
        elsewhere = policy.elsewhere(
            self._state, t, seen, is_expected=expected is not None, has_rings=bool(layout.rings)
        )
        if elsewhere.rings is not RingSearch.NONE:
            rings = self._rings_anywhere(image, down, elsewhere.rings)
        if rings or squares:
            self._end_rings()
        was_cut = any(w.was_cut for w in self._ring_work.values())
        squares_wait = elsewhere.squares_wait and not rings and self._may_squares_wait(image)
        self._state = policy.after(self._state, t, seen, was_cut=was_cut, squares_wait=squares_wait)
        if squares_wait:
            return rings, self._large_squares(image)
        where = SquareSearch.ANYWHERE if elsewhere.squares_wait else elsewhere.squares
        if where is not SquareSearch.NONE and layout.squares:
            squares = self._squares_elsewhere(image, rings, where)
        return rings, squares

    def _end_rings(self) -> None:
        """Let the next search of the whole image for rings start from its first part."""
        for work in self._ring_work.values():
            work.end()

    def _may_squares_wait(self, image: Image) -> bool:
        """Tell whether the search of the whole image for squares is left for the next frame.

        It is in a textured image, where it costs much, unless a ring was refused for lack of a
        plate: that ring may be a pad's.
        """
        has_squares = bool(self._layout.squares)
        return has_squares and not self._saw_bare and self._detectors.is_textured(image)

    def _large_squares(self, image: Image) -> list[FoundSquare]:
        """Return the squares seen in the whole image as it is reduced by `_GLANCE_SCALE`."""
        h, w = image.shape
        return self._detectors.find_squares(image, Window(0, 0, w, h), _GLANCE_SCALE)

    def _rings_expected(
        self, image: Image, expected: Expected, down: Vec3 | None, which: ExpectedRings
    ) -> list[FoundRing]:
        """Return the rings seen where they are expected; `which` tells which are looked for.

        Just over the pad a ring is cut by the image and only the square tells the pose: looking for
        the ring there would cost ten times as much as finding the square. See `ExpectedRings`.
        """
        rings: list[FoundRing] = []
        for ring in self._layout.rings if which is not ExpectedRings.NONE else ():
            points = expected.points(ring.position_m, circle(ring.radius_m))
            if points is None:
                continue
            if which is ExpectedRings.WHOLE and whole_in_picture(self._camera, points) is None:
                continue
            found = self._ring_expected(image, ring, points, expected, down)
            rings += [(ring, s) for s in self._large_enough(found)]
        return rings

    def _ring_expected(
        self, image: Image, ring: Ring, points: F64, expected: Expected, down: Vec3 | None
    ) -> list[MarkerSighting]:
        """Return what is seen of a ring where its outline (n, 3), camera frame, is expected.

        By a fit that starts there, else by detection in a window round it. If its place is still
        uncertain and gravity is known, by the four sides of the plate about it.
        """
        found = self._ring_or_window(image, ring, points, expected, down)
        centre = expected.centre(ring)
        if down is None or centre is None or any(_is_sure(s) for s in found):
            return found
        on_plate = self._detectors.ring_on_plate(image, ring, centre, down)
        return found if on_plate is None else [on_plate]

    def _ring_or_window(
        self, image: Image, ring: Ring, points: F64, expected: Expected, down: Vec3 | None
    ) -> list[MarkerSighting]:
        """Return a ring as tracked or else as detected in a window; arguments as there."""
        for start in expected.starts(ring):
            centre = start.centre(ring)
            assert centre is not None
            tracked = self._detectors.track_ring(
                image, ring, centre, start.normal, down, vouched=self._vouched
            )
            if tracked is not None:
                return [tracked]
        window = self._window(points, expected)
        if window is None:
            return []
        size = self._camera.focal * ring.outer_diameter_m / float(points[:, 2].mean())
        return self._detectors.find_rings(
            image,
            ring,
            window=window,
            down=down,
            expected_diameter_px=size,
            refuses=None if self._vouched else self._refusal(image, ring),
            vouched=self._vouched,
        )

    def _refusal(self, image: Image, ring: Ring, found: Sequence[MarkerSighting] = ()) -> Refusal:
        """Return the test by which a search refuses rings that lack the pad's plate.

        And those with the outline of one found already: the search is to go on to other outlines.
        """

        def is_refused(sighting: MarkerSighting) -> bool:
            if any(same_outline(sighting, other) for other in found):
                return True
            # Squares first: they are looked for in any case, and take less time than the plate.
            if self._squares_round(image, ring, sighting):
                return False
            if not self._detectors.lacks_plate(image, ring, sighting):
                return False
            # On ground as bright as the plate its outline is not seen, but a square's print is.
            if self._detectors.squares_beside(image, ring, sighting):
                return False
            self._saw_bare = True
            return True

        return is_refused

    def _rings_anywhere(self, image: Image, down: Vec3 | None, how: RingSearch) -> list[FoundRing]:
        """Return the rings seen in the whole image, or in the part of the search that is due."""
        thorough = how is RingSearch.THOROUGH
        rings: list[FoundRing] = []
        for ring in self._layout.rings:
            work = self._ring_work[ring]
            found = self._detectors.find_rings(
                image,
                ring,
                down=down,
                thorough=thorough,
                work=work,
                refuses=self._refusal(image, ring, [s for _, s in rings]),
            )
            rings += [(ring, s) for s in self._large_enough(found)]
        return rings + self._as_others(image, rings, down)

    def _as_others(
        self, image: Image, rings: list[FoundRing], down: Vec3 | None
    ) -> list[FoundRing]:
        """Return each ring found as each other ring of the pad that it may be instead.

        Rings that differ only in size look alike: `choice` takes those that agree with each other.
        """
        as_others = []
        for ring, sighting in rings:
            pose = sighting.solutions[0]
            for other in self._layout.rings:
                if other == ring:
                    continue
                at = np.array(pose.position) * (other.radius_m / ring.radius_m)
                seen = self._detectors.track_ring(image, other, at, np.array(pose.normal), down)
                if seen is not None and not self._refusal(image, other)(seen):
                    as_others.append((other, seen))
        return as_others

    def _large_enough(self, rings: list[MarkerSighting]) -> list[MarkerSighting]:
        """Return the first `_RINGS_KEPT` of the rings that are at least min_ring_px across."""
        large = [r for r in rings if max(box(r.outline_px)[2:]) >= self._min_ring_px]
        return large[:_RINGS_KEPT]

    def _squares_expected(self, image: Image, expected: Expected) -> list[FoundSquare]:
        """Return the squares seen where they are expected.

        By a fit that starts there. If none so tracked tells the pose well enough, those that were
        not tracked are looked for with the detector in a window.
        """
        found = []
        missed: dict[float, list[F64]] = {}  # outlines (4, 3) of squares not tracked, by size, m
        for s in self._layout.squares:
            outline = _turned(square_points(s.size_m), s.heading_deg)
            points = expected.points(s.position_m, outline)
            if points is None:
                continue
            tracked = self._tracked(image, s, outline, expected)
            if tracked is not None:
                found.append(tracked)
            else:
                missed.setdefault(s.size_m, []).append(points)
        if policy.is_square_enough([_telling_side_px(f) for f in found]):
            return found
        known = {f.square for f in found}
        for size, outlines in missed.items():
            points = np.concatenate(outlines)
            window = self._window(points, expected)
            detected = self._detected(image, window, size, points.mean(axis=0), expected.normal)
            found += [f for f in detected if f.square not in known]
        return found

    def _tracked(
        self, image: Image, square: Square, outline: F64, expected: Expected
    ) -> FoundSquare | None:
        """Return a square if a fit finds it where it is expected; None: it is not there.

        `outline` are its corners about its centre in the pad's axes, (4, 2), m.
        """
        for start in expected.starts(square):
            corners = start.points(square.position_m, outline)
            found = None if corners is None else self._fit_at(image, square, corners, start)
            if found is not None:
                return found
        return None

    def _fit_at(
        self, image: Image, square: Square, corners: F64, expected: Expected
    ) -> FoundSquare | None:
        """Return a square if it is where its corners (4, 3), camera frame, are expected."""
        if expected.north is None or float(corners[:, 2].min()) < MIN_DEPTH_M:
            return None
        px = self._camera.pixels(corners)
        out_of_sight = (px.max(axis=0) < 0).any() or (
            px.min(axis=0) > (self._camera.width, self._camera.height)
        ).any()
        if out_of_sight or shortest_side(px) < _MIN_SIDE_PX:
            return None
        north = corners[:2].sum(axis=0) - corners[2:].sum(axis=0)
        start = Pose(
            rotation_from(expected.normal, north), corners.mean(axis=0), np.zeros((6, 6)), 0.0
        )
        fit = self._detectors.track_square(image, square, start)
        if fit is None:
            return None
        at = fit.pose.points(square_points(square.size_m))
        return FoundSquare(square, self._camera.pixels(at), fit)

    def _squares_elsewhere(
        self, image: Image, rings: list[FoundRing], where: SquareSearch
    ) -> list[FoundSquare]:
        """Return the squares round the first ring that has any, or those in the whole image.

        In the whole image only if `where` says so and no ring was found.
        """
        for ring, sighting in rings:
            found = self._squares_round(image, ring, sighting)
            found = found or self._detectors.squares_beside(image, ring, sighting)
            if found:
                return found
        is_wanted = where is SquareSearch.ANYWHERE and not rings
        return self._detectors.find_squares(image) if is_wanted else []

    def _squares_round(
        self, image: Image, ring: Ring, sighting: MarkerSighting
    ) -> list[FoundSquare]:
        """Return the squares decoded round a ring at any heading; decoded once in an image."""
        if sighting not in self._round:
            self._round[sighting] = self._decoded_round(image, ring, sighting)
        return self._round[sighting]

    def _decoded_round(
        self, image: Image, ring: Ring, sighting: MarkerSighting
    ) -> list[FoundSquare]:
        pose = sighting.solutions[0]
        position, normal = np.array(pose.position), np.array(pose.normal)
        about = Expected(position, normal, None, 0.0, _SQUARE_MARGIN_PX)
        found = []
        for size in sorted({s.size_m for s in self._layout.squares}):
            reach = max(
                math.dist(s.position_m, ring.position_m)
                for s in self._layout.squares
                if s.size_m == size
            )
            # A circle that encloses a square at all headings.
            points = about.points((0.0, 0.0), circle(reach + 0.75 * size))
            assert points is not None
            window = self._window(points, about, _ROUND_MARGIN)
            if not self._is_whole(window):
                # Its outer ends at each heading.
                ends = about.points((0.0, 0.0), circle(reach + 0.5 * size, _HEADINGS))
                assert ends is not None
                if not is_any_in_picture(self._camera, ends):
                    continue
            found += self._detected(image, window, size, position, normal)
        return found

    def _is_whole(self, window: Window | None) -> bool:
        """Tell whether a window about something is not cut by the picture's edge."""
        if window is None:
            return False
        x0, y0, x1, y1 = window
        return min(x0, y0) > 0 and x1 < self._camera.width and y1 < self._camera.height

    def _detected(
        self, image: Image, window: Window | None, size: float, position: F64, normal: F64
    ) -> list[FoundSquare]:
        """Return the squares of one size (m) in a window, scaled for their pose (3,), (3,)."""
        if window is None:
            return []
        scale = self._search_scale(size, position, normal)
        if scale >= _MAX_SCALE:
            return []
        found = self._detectors.find_squares(image, window, scale, _MIN_SIDE_PX)
        if not found and scale < _MAX_EVENED_SCALE:
            scale *= _EVENED_SIDE_PX / _SEARCH_SIDE_PX
            found = self._detectors.find_squares(
                image, window, scale, _MIN_SIDE_PX, evened_px=_EVENED_PX
            )
        return [f for f in found if f.square.size_m == size]

    def _search_scale(self, size: float, position: F64, normal: F64) -> float:
        """Return the enlargement at which a square of this size has `_SEARCH_SIDE_PX`."""
        distance = length(position)
        slant = max(_MIN_SLANT, abs(float(position @ normal)) / distance)
        return min(_MAX_SCALE, _SEARCH_SIDE_PX * distance / (self._camera.focal * size * slant))

    def _window(
        self, points: F64, expected: Expected, share: float = _WINDOW_MARGIN
    ) -> Window | None:
        """Return the window round points (n, 3), camera frame; None: out of the image.

        Its margin is a share of their extent plus the uncertainty of the place.
        """
        camera = self._camera
        nearest = float(points[:, 2].min())
        if nearest < MIN_DEPTH_M:
            return Window(0, 0, camera.width, camera.height)
        px = camera.pixels(points)
        low, high = px.min(axis=0), px.max(axis=0)
        margin = (
            share * (high - low)
            + expected.margin_px
            + _WINDOW_SIGMAS * expected.sigma_m * self._camera.focal / nearest
        )
        x0, y0 = np.maximum(np.floor(low - margin), 0.0)
        x1, y1 = np.minimum(np.ceil(high + margin) + 1, (camera.width, camera.height))
        if not (x1 - x0 >= 4 and y1 - y0 >= 4):
            return None
        return Window(int(x0), int(y0), int(x1), int(y1))


def _is_sure(sighting: MarkerSighting) -> bool:
    """Tell whether a ring's position is known better than its plate's sides would tell it."""
    pose = sighting.solutions[0]
    (xx, _, _), (_, yy, _), (_, _, zz) = pose.covariance
    return xx + yy + zz < _SURE_SHARE**2 * dot(pose.position, pose.position)


def _telling_side_px(found: FoundSquare) -> float:
    """Return the shortest side of a square in the image, px; 0 if its pose is too uncertain.

    Also 0 if only its edges could be fitted: whatever spoilt its grey levels disturbs a ring less.
    """
    if isinstance(found.fit, EdgeFit):
        return 0.0
    if found.fit is not None:
        pose = found.fit.pose
        covariance = inverse(pose.information)[:3, :3]
        if trace(covariance) > _TELLING_SHARE**2 * float(pose.t @ pose.t):
            return 0.0
    return shortest_side(found.corners)


def _turned(points: F64, heading_deg: float) -> F64:
    """Return points (n, 2) of a marker in the pad's axes."""
    turned: F64 = points @ rotation_2d(math.radians(heading_deg)).T
    return turned
