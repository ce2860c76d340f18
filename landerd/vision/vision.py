"""Images in, sightings of the pad out."""

import math

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.config.models import VisionSection
from landerd.geometry import Vec3
from landerd.messages import Frame, MarkerSighting, PoseSolution, Prior, Sightings
from landerd.pad import PadLayout, Square, WhyCode
from landerd.vision.choice import Candidate, choose
from landerd.vision.pad_pose import Measured, measured_ring, with_gravity
from landerd.vision.pose import Pose, circle, solution
from landerd.vision.search import Expected, FoundRing, Search
from landerd.vision.square import FoundSquare, Image, printed_cells
from landerd.vision.square_fit import SquarePrint
from landerd.vision.square_pose import square_points
from landerd.vision.whycode import FoundCode, WhyCodeFinder

_SAME_VIEW_S = 0.15  # so soon after, the camera looks nearly the same way
_TOLD = 12.0  # chi-square by which a ring's mirrored pose is worse, and out of the question
_MEMORY_S = 0.5  # a sighting older than this says nothing about the next frame
_TURN_RATE = 1.0  # rad/s: how fast a pad may cross the image between frames
_CREEP_MPS = 2.0  # and how fast its distance may change


class Vision:
    """Finds the pad's markers in frames.

    Pure: keeps nothing but the last sighting of the pad, which tells where to look next.
    """

    def __init__(self, layout: PadLayout, camera: CameraModel, options: VisionSection) -> None:
        """Prepare to find one pad with one camera.

        Raises:
            ValueError: the pad has a square that OpenCV's dictionaries lack.
        """
        self._layout = layout
        self._camera = camera
        self._options = options
        self._focal = 0.5 * (camera.fx + camera.fy)
        self._prints = {s: SquarePrint(s, printed_cells(s)) for s in layout.squares}
        self._search = Search(layout, camera, options.min_ring_px, self._prints)
        self._codes = WhyCodeFinder(layout, camera)
        self._last: tuple[float, PoseSolution] | None = None

    def process(self, frame: Frame, prior: Prior | None = None) -> Sightings:
        """Return all that a frame shows of the pad.

        Without `prior.pad` the search starts where the pad was last seen, and over the whole
        image if it was not or is not found there.

        Raises:
            ValueError: the image is not an 8-bit grey image of the camera's size.
        """
        camera = self._camera
        image = frame.image
        if image.ndim != 2 or image.dtype != np.uint8:
            raise ValueError(f"image is {image.ndim}-dimensional {image.dtype}, not 8-bit grey")
        if image.shape != (camera.height, camera.width):
            raise ValueError(
                f"image is {image.shape[1]}x{image.shape[0]}, "
                f"the camera is calibrated for {camera.width}x{camera.height}"
            )
        prior = prior or Prior()
        expected = self._expectation(frame.t, prior)
        rings, squares = self._search.find(
            image, expected, prior.down, sparing=prior.pad is not None
        )
        candidates = [
            Candidate(ring, s, measured_ring(ring.position_m, s.solutions)) for ring, s in rings
        ]
        normal = self._last_normal(frame.t)
        for found in squares:
            candidate = self._square(image, found, prior, normal or _told_normal(rings))
            if candidate is not None:
                candidates.append(candidate)
        codes = self._codes.find(image, expected, normal)
        candidates += [c for found in codes if (c := self._code(found, prior)) is not None]
        where = None if expected is None else expected.position
        chosen, poses = choose(candidates, self._layout, self._camera, prior, where)
        others = [c for c in candidates if c.sighting.id is not None and c not in chosen]
        markers = tuple(c.sighting for c in chosen + others)
        pad = tuple(s for s in poses if self._is_certain(s))
        if pad:
            self._last = (frame.t, pad[0])
        return Sightings(frame.t, frame.seq, markers, pad)

    def _expectation(self, t: float, prior: Prior) -> Expected | None:
        last = self._last
        if last is not None and not 0.0 <= t - last[0] <= _MEMORY_S:
            last = None
        if prior.pad is not None:
            position = np.array(prior.pad.position)
            level = prior.pad.normal or prior.down
            if level is not None:
                normal = np.array(level)
            elif last is not None:
                normal = np.array(last[1].normal)
            else:
                normal = position / np.linalg.norm(position)
            known = prior.pad.north or (last[1].north if last is not None else None)
            north = None if known is None else np.array(known)
            return Expected(position, normal, north, prior.pad.sigma_m, 4.0)
        if last is None:
            return None
        dt, pad = t - last[0], last[1]
        return Expected(
            np.array(pad.position),
            np.array(pad.normal),
            None if pad.north is None else np.array(pad.north),
            _CREEP_MPS * dt,
            _TURN_RATE * dt * self._focal,
        )

    def _last_normal(self, t: float) -> Vec3 | None:
        """Return the pad's normal as just seen, None if that is too long ago."""
        if self._last is None or not 0.0 < t - self._last[0] < _SAME_VIEW_S:
            return None
        return self._last[1].normal

    def _square(
        self, image: Image, found: FoundSquare, prior: Prior, normal: Vec3 | None
    ) -> Candidate | None:
        """Return a square with its pose; None if that is too uncertain."""
        square = found.square
        poses = self._prints[square].poses(
            image, self._camera, found.corners, prior.down, normal, found.fit
        )
        return self._decoded(square, poses, square_points(square.size_m), prior)

    def _code(self, found: FoundCode, prior: Prior) -> Candidate | None:
        """Return a WhyCode with its pose; None if that is too uncertain."""
        outline = circle(0.5 * found.code.outer_diameter_m)
        return self._decoded(found.code, list(found.poses), outline, prior)

    def _decoded(
        self, marker: Square | WhyCode, poses: list[Pose], outline: F64, prior: Prior
    ) -> Candidate | None:
        """Return a marker that tells its id and heading; None if its pose is too uncertain."""
        level = sorted((with_gravity(p, prior.down) for p in poses), key=lambda p: p.cost)
        solutions = tuple(s for p in level if (s := solution(p)) and self._is_certain(s))
        if not solutions:
            return None
        points = level[0].t + outline @ level[0].R[:, :2].T
        polygon = tuple((float(x), float(y)) for x, y in self._camera.pixels(points))
        sighting = MarkerSighting(marker.kind, marker.id, solutions, polygon)
        place = np.array([*marker.position_m, 0.0])
        return Candidate(
            marker, sighting, Measured(place, math.radians(marker.heading_deg), tuple(poses))
        )

    def _is_certain(self, s: PoseSolution) -> bool:
        variance = np.linalg.eigvalsh(np.array(s.covariance))[-1]
        return bool(variance <= self._options.max_sigma_m**2)


def _told_normal(rings: list[FoundRing]) -> Vec3 | None:
    """Return the normal of the only ring if its image tells it from the mirrored one."""
    if len(rings) != 1:
        return None
    best, *others = rings[0][1].solutions
    return best.normal if all(s.cost > best.cost + _TOLD for s in others) else None
