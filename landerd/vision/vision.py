"""The entry to sight: takes camera images, returns sightings of the pad.

What happens to a frame, and which module does it:

1. `veil` spreads the levels of a picture taken in fog. `expected` tells where the pad should be;
   `Search` finds the rings and squares there or elsewhere, as often as `search_policy` allows;
   `WhyCodeFinder` finds the WhyCodes.
2. Every marker found becomes a candidate: its pose or poses, corrected for a rolling shutter.
3. As long as no marker with an id of the pad was read, rings may be look-alikes. Those without the
   pad's plate about them, or with another pad's marker beside them, are dropped; the others get the
   heading that the plate's outline shows.
4. `choice` keeps the candidates that agree on one pad, and `pad_pose` solves for its pose.
"""

import math
from collections import deque
from dataclasses import replace

import numpy as np

from landerd.camera_model import F64, CameraModel, Window, used_part
from landerd.config.models import VisionSection
from landerd.geometry import Vec3, dot
from landerd.messages import (
    BESIDE,
    GREY,
    PLATE,
    Frame,
    MarkerSighting,
    PoseSolution,
    Prior,
    Sightings,
)
from landerd.pad import Marker, PadLayout, Ring, Square, WhyCode
from landerd.vision.arrays import Image
from landerd.vision.choice import Candidate, choose, distinct
from landerd.vision.detectors import Detectors, PixelDetectors, keep_freed_memory
from landerd.vision.disagreement import Disagreement, disagreement
from landerd.vision.expected import Expected, SeenPad, expected_pad
from landerd.vision.marker_errors import MarkerErrors
from landerd.vision.other_markers import other_markers, rings_without_plate
from landerd.vision.pad_pose import Measurement, learn, ring_measurement, with_gravity, with_north
from landerd.vision.pose import (
    SAME_SOLUTION_COS,
    Pose,
    box,
    circle,
    rotation_2d,
    rotation_from,
    solution,
    turned_about_normal,
    vec3,
)
from landerd.vision.rolling_shutter import RollingShutter
from landerd.vision.search import FoundRing, Search
from landerd.vision.search_policy import ring_only_frames
from landerd.vision.square import FoundSquare
from landerd.vision.square_pose import pose_beside, square_points
from landerd.vision.veil import spread
from landerd.vision.whycode import FoundCode

# Age up to which the pad's last normal tells the right one of two mirrored poses, s: by then the
# pad has not turned from one solution to the other (`SAME_SOLUTION_COS`).
_SAME_VIEW_S = 0.15
# A pad's plate counts as seen if more than this share of the looks in this time, s, showed it:
# glare, leaf shade and blur hide it. On field days 1 look in 100 at 19 pads did not show it, in
# fine leaf shade 55; at look-alikes that had passed one look, 20 to 90 in 100 did not.
_PLATE_LOOKS_S, _LEAST_LOOKS = 1.0, 1.0 / 3.0
# How long a ring counts as another pad's after that pad's id was read beside it, s: until the
# estimator has forgotten it.
_OTHER_HELD_S = 2.5
# Number of searches of a still without a pad: at least, and at most while the search of the whole
# image goes on. Squares in the whole image are searched for with the thresholds in turn, and in its
# quarters in turn (landerd.vision.square); if the pad has rings, only by every fifth search. The
# least number is enough for all thresholds in the whole image, and for the first in all quarters.
_LEAST_SEARCHES, _MOST_SEARCHES = 37, 54
# The same of searches for all squares of a still. Two sightings are of one square if their middles
# are nearer than this, in widths.
_SQUARE_SEARCHES, _SAME_SQUARE = 16, 0.35
# A ring's mirrored pose is ruled out if its chi-square is larger by more: odds of 1 to 400.
_AMBIGUOUS_CHI2 = 12.0


class Vision:
    """Finds the pad's markers in frames.

    Deterministic, without clock, random numbers or files: the same frames and priors in the same
    order give the same sightings. From frame to frame it remembers

    - the last sighting of the pad, which tells where to look next, and how far its markers were
      from where they were expected;
    - the counts of `search_policy`: for how many frames a ring is enough, and how many frames in a
      row showed nothing where the pad was expected;
    - how far the search of the whole image for rings has come (`RingWork`), and the camera's
      response as fitted rings showed it (`CameraResponse`);
    - for each square and WhyCode the blur of its last fit, with which the next one starts, and its
      print blurred by as much;
    - how fast the pad moves in the image (`RollingShutter`);
    - how markers lie relative to one another where that differs from the pad file (`MarkerErrors`);
    - whether the pad's plate was seen lately, and which other pad's id was read beside a ring.
    """

    def __init__(
        self,
        layout: PadLayout,
        camera: CameraModel,
        options: VisionSection,
        *,
        meters: bool = False,
        detectors: Detectors | None = None,
    ) -> None:
        """Prepare to find one pad with one camera.

        Args:
            layout: the pad.
            camera: the lens.
            options: how images are searched.
            meters: measure the brightness of every frame, too.
            detectors: find markers in the pixels; None: `PixelDetectors`.
        """
        keep_freed_memory()
        self._layout = layout
        self._whole = camera
        # A simulator's detectors see no pixels: there is no unused part to cut off.
        part = Window(0, 0, camera.width, camera.height) if detectors else used_part(camera)
        self._part, self._camera = part, camera.seeing(part)
        self._options = options
        self._meters = meters
        self._detectors = detectors or PixelDetectors(layout, self._camera)
        self._search = Search(layout, self._camera, options.min_ring_px, self._detectors)
        self._errors = MarkerErrors(layout, options.focal_sigma)
        self._shutter = RollingShutter(camera, options.readout_s)
        self._last: SeenPad | None = None
        self._drift: dict[Marker, F64] = {}  # see `Expected`
        # Looks for the pad's plate about rings: time, s, and whether it was seen.
        self._plate_looks: deque[tuple[float, bool]] = deque()
        # Another pad's id that was last read beside a ring: time, s, and number.
        self._other: tuple[float, int] | None = None
        self._was_read = False  # a marker with an id was read of the pad that is tracked
        self._found: list[Measurement] = []  # of the last frame, at most one of each marker

    def process(self, frame: Frame, prior: Prior | None = None) -> Sightings:
        """Return the pad's markers in a frame, and the pad's pose from them.

        Without `prior.pad` the search starts where the pad was last seen. It covers the whole image
        if the pad was not seen lately or is not found there.

        Raises:
            ValueError: the image is not an 8-bit grey image of the camera's size.
        """
        x0, y0, x1, y1 = self._part
        shown = _checked(frame.image, self._whole)[y0:y1, x0:x1]
        image = spread(shown)
        prior = prior or Prior()
        expected = expected_pad(frame.t, prior, self._last, self._camera.focal, self._drift)
        if prior.pad is None and prior.maybe is None:
            self._was_read = False
        vouched = self._is_vouched(frame.t, prior)
        rings, squares = self._search.find(
            frame.t,
            image,
            expected,
            prior.down,
            ring_only_frames=ring_only_frames(
                is_pad_known=prior.pad is not None,
                is_heading_known=prior.pad is not None and prior.pad.north is not None,
            ),
            vouched=vouched,
        )
        candidates = [self._ring(frame.t, ring, sighting) for ring, sighting in rings]
        normal = self._last_normal(frame.t)
        beside = _unambiguous(rings)
        for found in squares:
            candidate = self._square(frame.t, image, found, prior, normal, beside)
            if candidate is not None:
                candidates.append(candidate)
        codes = self._detectors.find_codes(image, expected, normal)
        candidates += [c for found in codes if (c := self._code(frame.t, found, prior)) is not None]
        other_id = None
        if self._is_unread(prior) and all(c.sighting.id is None for c in candidates):
            candidates = self._with_plate(frame.t, image, candidates, expected, vouched=vouched)
            candidates, other_id = self._of_no_other(frame.t, image, candidates, expected)
            known = None if expected is None else expected.north
            candidates = [self._turned_by_plate(image, c, known) for c in candidates]
        where = None if expected is None else expected.position
        chosen, poses = choose(candidates, self._layout, self._camera, self._errors, prior, where)
        own = {(c.marker, c.sighting) for c in chosen}
        # `chosen` may have information reduced for a bent picture; `candidates` still have it as
        # each was measured. Those of the pad come first.
        candidates.sort(key=lambda c: (c.marker, c.sighting) not in own)
        others = [c for c in candidates[len(own) :] if c.sighting.id is not None]
        markers = tuple(self._in_whole(c.sighting) for c in chosen + others)
        pad = tuple(s for s in poses if self._is_certain(s))
        self._found = _placed(distinct(candidates)) if pad else []
        if pad:
            self._last = SeenPad(frame.t, pad[0])
            self._shutter.saw(frame.t, np.array(pad[0].position))
            self._drift = _drift(chosen, expected)
            self._was_read = self._was_read or any(c.sighting.id is not None for c in chosen)
            learn(_placed(chosen), self._errors, frame.t, pad[0])
        seen = pad[0] if pad else None
        light = self._detectors.light(shown, seen, prior.down) if self._meters else None
        may_be_another = bool(pad) and all(c.may_be_another for c in chosen)
        return Sightings(
            frame.t,
            frame.seq,
            markers,
            pad,
            light,
            other_id=other_id,
            may_be_another=may_be_another,
        )

    @property
    def was_cut(self) -> bool:
        """Whether the last frame's search was cut short by its cost and goes on in the next."""
        return self._search.was_cut

    def search_still(self, frame: Frame) -> Sightings:
        """Search a still repeatedly, and return what the first search that finds the pad sees.

        In a video a thorough search is spread over several frames; here the same frame is searched
        again instead. If no search finds the pad, the sightings of the last one are returned.

        Raises:
            ValueError: as `process`.
        """
        sightings = self.process(frame)
        for searches in range(1, _MOST_SEARCHES):
            is_over = searches >= _LEAST_SEARCHES and not self.was_cut
            if sightings.pad or is_over:
                break
            sightings = self.process(frame)
        return sightings

    def other_squares(self, image: Image, sightings: Sightings) -> list[MarkerSighting]:
        """Return the squares in a still that the search which found its pad did not show.

        Each search looks in another way (`SquareFinder._whole_looks`), so some squares are seen
        only by some. Several of one id may lie about.

        Args:
            image: grey image (height, width) of the camera's size.
            sightings: in that image, searched as a still.
        """
        squares = self._layout.squares
        if not squares:
            return []
        only = self._layout.model_copy(update={"markers": squares})
        vision = Vision(only, self._whole, self._options)
        found = list(sightings.markers)
        for k in range(_SQUARE_SEARCHES):
            # So late that the search before tells nothing: the whole image is searched.
            seen = vision.process(Frame(float(k), k, image)).markers
            found += [m for m in seen if not any(_is_same(m, other) for other in found)]
        return found[len(sightings.markers) :]

    def rings_without_plate(self, frame: Frame, sightings: Sightings) -> list[MarkerSighting]:
        """Return rings that are not taken for the pad's, as its plate is not seen about them.

        None if a marker of the pad was found.

        Args:
            frame: of the camera's size.
            sightings: in that frame, searched as a still.
        """
        if sightings.markers or sightings.other_id is not None:
            return []
        found = rings_without_plate(self._searched(frame.image), self._layout, self._camera)
        return [self._in_whole(self._ring(frame.t, ring, s).sighting) for ring, s in found]

    def other_markers(self, image: Image, sightings: Sightings) -> list[str]:
        """Return in words which markers an image shows that differ from the pad file's.

        Args:
            image: grey image (height, width) of the camera's size.
            sightings: in that image.
        """
        if sightings.other_id is not None:
            return []  # that tells it
        x0, y0, *_ = self._part
        seen = [
            replace(m, outline_px=tuple((x - x0, y - y0) for x, y in m.outline_px))
            for m in sightings.markers
        ]
        return other_markers(self._searched(image), self._layout, self._camera, seen)

    def _searched(self, image: Image) -> Image:
        """Return the part of an image that is searched, its grey levels spread."""
        x0, y0, x1, y1 = self._part
        return spread(_checked(image, self._whole)[y0:y1, x0:x1])

    def disagreement(self) -> Disagreement | None:
        """Return how the markers of the last frame contradict each other; None: they do not."""
        return disagreement(self._found, self._errors, self._layout)

    def _last_normal(self, t: float) -> Vec3 | None:
        """Return the pad's normal as last seen; None: that is more than `_SAME_VIEW_S` ago."""
        if self._last is None or not 0.0 < t - self._last.t < _SAME_VIEW_S:
            return None
        return self._last.pose.normal

    def _ring(self, t: float, ring: Ring, sighting: MarkerSighting) -> Candidate:
        number = self._layout.markers.index(ring)
        sighting, shared = self._shutter.of_ring(t, ring, sighting)
        measured = ring_measurement(number, ring.position_m, sighting.solutions, shared)
        return Candidate(ring, sighting, measured)

    def _is_unread(self, prior: Prior) -> bool:
        """Tell whether no marker has shown the pad's heading yet, so that rings may be look-alikes.

        A heading that came from the plate's outline does not count.
        """
        return not self._was_read or prior.pad is None or prior.pad.north is None

    def _is_vouched(self, t: float, prior: Prior) -> bool:
        """Tell whether a ring where the pad is expected is the pad's even if it shows no plate.

        It is if a marker with an id of that pad was read, or the pad is known and its plate was
        seen lately.
        """
        looks = self._plate_looks
        while looks and not t - looks[0][0] < _PLATE_LOOKS_S:
            looks.popleft()
        is_seen = sum(seen for _, seen in looks) > _LEAST_LOOKS * len(looks)
        return self._was_read or (prior.pad is not None and is_seen)

    def _with_plate(
        self,
        t: float,
        image: Image,
        candidates: list[Candidate],
        expected: Expected | None,
        *,
        vouched: bool,
    ) -> list[Candidate]:
        """Return the candidates except rings that lack the pad's plate about them.

        A ring without it is kept where the pad is expected if it is `vouched` for (`_is_vouched`).
        """
        kept = []
        for c in candidates:
            ring = c.marker
            if isinstance(ring, Ring):
                has_shown = c.sighting.stage == PLATE
                lacks = not has_shown and self._detectors.lacks_plate(image, ring, c.sighting)
                has = has_shown or self._detectors.has_plate(image, ring, c.sighting)
                self._plate_looks.append((t, has))
                if lacks and not (vouched and _is_at(expected, ring, c.sighting)):
                    continue
                is_told = vouched or has_shown
                is_told = is_told or self._detectors.shows_plate(image, ring, c.sighting)
                kept.append(replace(c, may_be_another=not is_told))
            else:
                kept.append(c)
        return kept

    def _of_no_other(
        self, t: float, image: Image, candidates: list[Candidate], expected: Expected | None
    ) -> tuple[list[Candidate], int | None]:
        """Return the candidates except rings of another pad, and the id that shows they are.

        The id is not readable in every frame: a ring at the expected place counts as the other
        pad's for `_OTHER_HELD_S` after it was read.
        """
        kept, other_id = [], None
        for c in candidates:
            ring = c.marker
            if isinstance(ring, Ring):
                number = self._detectors.other_id(image, ring, c.sighting)
                if number is not None:
                    self._other = t, number
                elif self._other is not None and _is_at(expected, ring, c.sighting):
                    since, number = self._other
                    number = number if t - since < _OTHER_HELD_S else None
                if number is not None:
                    other_id = number
                    continue
            kept.append(c)
        return kept, other_id

    def _turned_by_plate(self, image: Image, c: Candidate, known: F64 | None) -> Candidate:
        """Return a ring with the pad's north added if its plate shows it.

        Args:
            image: grey image (height, width).
            c: the ring; other markers are returned as they are.
            known: the pad's north as expected, (3,), camera frame; None: not known.
        """
        if not isinstance(c.marker, Ring):
            return c
        plate = self._detectors.plate_north(image, c.marker, c.sighting, known)
        if plate is None:
            return c
        solutions = tuple(
            replace(
                s,
                north=vec3(rotation_from(np.array(s.normal), plate.north)[:, 0]),
                sigma_yaw=plate.sigma,
            )
            for s in c.sighting.solutions
        )
        return replace(
            c,
            sighting=replace(c.sighting, solutions=solutions),
            measurement=with_north(c.measurement, plate.north, plate.sigma),
        )

    def _square(
        self,
        t: float,
        image: Image,
        found: FoundSquare,
        prior: Prior,
        normal: Vec3 | None,
        beside: tuple[Ring, PoseSolution] | None,
    ) -> Candidate | None:
        """Return a square with its pose; None if that is too uncertain.

        Args:
            t: of the exposure, s.
            image: grey image (height, width).
            found: the square.
            prior: gravity.
            normal: the pad's as last seen, camera frame; None: not seen lately.
            beside: a ring of the pad with its pose, if it has only one.
        """
        square, start = found.square, None
        if beside is not None:
            ring, pose = beside
            normal = normal or pose.normal
            start = self._start(found, ring, pose) if found.fit is None else None
        poses, stage = self._detectors.square_poses(image, found, prior.down, normal, start)
        return self._decoded(t, square, poses, square_points(square.size_m), prior, stage)

    def _start(self, found: FoundSquare, ring: Ring, pose: PoseSolution) -> Pose | None:
        """Return the pose of a square as a ring's pose and its corners tell; None: they do not."""
        square = found.square
        arm = np.array(ring.position_m) - np.array(square.position_m)
        centre = rotation_2d(-math.radians(square.heading_deg)) @ arm
        rays = self._camera.rays(found.corners)
        at = np.array(pose.position), np.array(pose.normal)
        return pose_beside(rays, square.size_m, at, centre)

    def _code(self, t: float, found: FoundCode, prior: Prior) -> Candidate | None:
        """Return a WhyCode with its pose; None if that is too uncertain."""
        outline = circle(found.code.radius_m)
        return self._decoded(t, found.code, list(found.poses), outline, prior, found.stage)

    def _decoded(
        self,
        t: float,
        marker: Square | WhyCode,
        poses: list[Pose],
        outline: F64,
        prior: Prior,
        stage: str = GREY,
    ) -> Candidate | None:
        """Return the candidate for a marker with id and heading; None: its pose is too uncertain.

        Args:
            t: of the exposure, s.
            marker: the marker that was read.
            poses: of its centre, camera frame.
            outline: its outline about its centre, (n, 2), m.
            prior: gravity.
            stage: how it was fitted, as the sighting reports it.
        """
        place, heading = np.array([*marker.position_m, 0.0]), math.radians(marker.heading_deg)
        origins = (p.t - turned_about_normal(p.R, -heading) @ place for p in poses)
        poses = [
            self._shutter.of_pose(t, p, outline, o) for p, o in zip(poses, origins, strict=True)
        ]
        level = sorted((with_gravity(p, prior.down) for p in poses), key=lambda p: p.cost)
        solutions = tuple(s for p in level if (s := solution(p)) and self._is_certain(s))
        if not solutions:
            return None
        points = level[0].points(outline)
        polygon = tuple((x, y) for x, y in self._camera.pixels(points).tolist())
        sighting = MarkerSighting(marker.kind, marker.id, solutions, polygon, stage)
        number = self._layout.markers.index(marker)
        return Candidate(marker, sighting, Measurement(number, place, heading, tuple(poses)))

    def _in_whole(self, sighting: MarkerSighting) -> MarkerSighting:
        """Return a sighting with its outline in pixels of the whole image, not of the used part."""
        x0, y0, _, _ = self._part
        if x0 == y0 == 0:
            return sighting
        outline = tuple((x + x0, y + y0) for x, y in sighting.outline_px)
        return replace(sighting, outline_px=outline)

    def _is_certain(self, s: PoseSolution) -> bool:
        """Tell whether sigma of the position is at most max_sigma_m in every direction."""
        (a, _, _), (_, b, _), (_, _, c) = s.covariance
        most = self._options.max_sigma_m**2
        # The largest eigenvalue is at most the trace, which nearly always settles it.
        return a + b + c <= most or bool(np.linalg.eigvalsh(np.array(s.covariance))[-1] <= most)


def _drift(seen: list[Candidate], expected: Expected | None) -> dict[Marker, F64]:
    """Return the offset of each marker from where it was expected, (3,), m, camera frame."""
    drift: dict[Marker, F64] = {}
    for c in seen:
        centre = None if expected is None else expected.centre(c.marker)
        if centre is not None:
            drift[c.marker] = np.array(c.sighting.solutions[0].position) - centre
    return drift


def _placed(candidates: list[Candidate]) -> list[Measurement]:
    """Return the measurements that are independent of each other.

    The pose of a square that was found by its print beside a ring (stage BESIDE) is left out: its
    position is the ring's.
    """
    return [c.measurement for c in candidates if c.sighting.stage != BESIDE]


def _checked(image: Image, camera: CameraModel) -> Image:
    """Return the image.

    Raises:
        ValueError: it is not an 8-bit grey image of the camera's size.
    """
    if image.ndim != 2 or image.dtype != np.uint8:
        raise ValueError(f"image is {image.ndim}-dimensional {image.dtype}, not 8-bit grey")
    if image.shape != (camera.height, camera.width):
        raise ValueError(
            f"image is {image.shape[1]}x{image.shape[0]}, "
            f"the camera is calibrated for {camera.width}x{camera.height}"
        )
    return image


def _is_same(a: MarkerSighting, b: MarkerSighting) -> bool:
    """Tell whether two sightings in one image are of the same marker."""
    (x, y, w, h), (u, v, *_) = box(a.outline_px), box(b.outline_px)
    return a.id == b.id and math.hypot(x - u, y - v) < _SAME_SQUARE * max(w, h)


def _is_at(expected: Expected | None, ring: Ring, sighting: MarkerSighting) -> bool:
    """Tell whether a ring is within its own radius of where it is expected, across the sight."""
    centre = None if expected is None else expected.centre(ring)
    if centre is None:
        return False
    at = np.array(sighting.solutions[0].position)
    # Moved to the expected depth first: the range of a small ring errs by more than its radius.
    off = at * (centre[2] / at[2]) - centre
    return bool(np.linalg.norm(off) < ring.radius_m)


def _unambiguous(rings: list[FoundRing]) -> tuple[Ring, PoseSolution] | None:
    """Return the only ring with its pose if the mirrored one is ruled out; else None."""
    if len(rings) != 1:
        return None
    ring, sighting = rings[0]
    best, *others = sighting.solutions
    is_unambiguous = all(
        s.cost > best.cost + _AMBIGUOUS_CHI2 or dot(s.normal, best.normal) > SAME_SOLUTION_COS
        for s in others
    )
    return (ring, best) if is_unambiguous else None
