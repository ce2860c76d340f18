"""Images in, sightings of the pad out."""

import math
from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.config import VisionSection
from landerd.messages import Frame, MarkerSighting, PoseSolution, Prior, Sightings
from landerd.pad import PadLayout, Ring
from landerd.vision.choice import Candidate, choose
from landerd.vision.pad_pose import Measured, measured_ring, with_gravity
from landerd.vision.pose import circle, rotation_from, solution
from landerd.vision.square import FoundSquare, Image, SquareFinder, printed_cells
from landerd.vision.square_fit import SquarePrint
from landerd.vision.square_pose import square_points
from landerd.vision.whycon import find_rings
from landerd.vision.window import Window

_MEMORY_S = 0.5  # a sighting older than this says nothing about the next frame
_SEARCH_SIDE_PX = 40.0  # squares whose size in the image is known are searched at about this
_SMALLEST_SIDE_PX = 14.0  # and at least this size
_SMALLEST_FULL_PX = 10.0  # smaller ones are not found in the whole image
_MOST_ALIKE = 3  # rings looked at for one ring of the pad
_LARGEST_SCALE = 4.0
_TURN_RATE = 1.0  # rad/s: how fast a pad may cross the image between frames
_CREEP_MPS = 2.0  # and how fast its distance may change


@dataclass(frozen=True)
class _Expected:
    """Where the pad should be, camera frame."""

    position: F64  # landing point, m
    normal: F64
    north: F64 | None
    sigma_m: float
    margin_px: float  # of image motion that sigma_m does not tell

    def points(self, place: tuple[float, float], outline: F64) -> F64 | None:
        """Return a marker's outline (n, 2) about its centre as points (n, 3); None: no heading."""
        centred = place == (0.0, 0.0)
        if self.north is None and not centred:
            return None
        north = self.north if self.north is not None else _any_across(self.normal)
        R = rotation_from(self.normal, north)
        points: F64 = self.position + (outline + np.array(place)) @ R[:, :2].T
        return points


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
        self._finder = SquareFinder(layout)
        self._prints = {s: SquarePrint(s, printed_cells(s)) for s in layout.squares}
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
        rings = self._rings(image, prior, expected)
        candidates = [
            Candidate(ring, s, measured_ring(ring.position_m, s.solutions)) for ring, s in rings
        ]
        for found in self._squares(image, rings, expected):
            candidate = self._square(image, found, prior)
            if candidate is not None:
                candidates.append(candidate)
        where = None if expected is None else expected.position
        chosen, poses = choose(candidates, self._layout, self._camera, prior, where)
        others = [c for c in candidates if c.sighting.id is not None and c not in chosen]
        markers = tuple(c.sighting for c in chosen + others)
        pad = tuple(s for s in poses if self._is_certain(s))
        if pad:
            self._last = (frame.t, pad[0])
        return Sightings(frame.t, frame.seq, markers, pad)

    def _expectation(self, t: float, prior: Prior) -> _Expected | None:
        last = self._last
        if last is not None and not 0.0 <= t - last[0] <= _MEMORY_S:
            last = None
        if prior.pad is not None:
            position = np.array(prior.pad.position)
            if prior.down is not None:
                normal = np.array(prior.down)
            elif last is not None:
                normal = np.array(last[1].normal)
            else:
                normal = position / np.linalg.norm(position)
            north = None if prior.pad.north is None else np.array(prior.pad.north)
            return _Expected(position, normal, north, prior.pad.sigma_m, 4.0)
        if last is None:
            return None
        dt, pad = t - last[0], last[1]
        return _Expected(
            np.array(pad.position),
            np.array(pad.normal),
            None if pad.north is None else np.array(pad.north),
            _CREEP_MPS * dt,
            _TURN_RATE * dt * self._focal,
        )

    def _rings(
        self, image: Image, prior: Prior, expected: _Expected | None
    ) -> list[tuple[Ring, MarkerSighting]]:
        """Return what may be the pad's rings, of each the nearest few."""
        found: list[tuple[Ring, MarkerSighting]] = []
        for ring in self._layout.rings:
            r = 0.5 * ring.outer_diameter_m
            points = None
            if expected is not None:
                points = expected.points(ring.position_m, circle(r))
            sightings: list[MarkerSighting] = []
            if expected is not None and points is not None:
                window = self._window(points, expected)
                if window is not None:
                    size = self._focal * 2.0 * r / float(points[:, 2].mean())
                    sightings = find_rings(
                        image,
                        ring,
                        self._camera,
                        window=window,
                        down=prior.down,
                        expected_diameter_px=size,
                    )
            if not sightings:
                sightings = find_rings(
                    image,
                    ring,
                    self._camera,
                    window=None,
                    down=prior.down,
                    expected_diameter_px=None,
                )
            found += [(ring, s) for s in sightings[:_MOST_ALIKE]]
        return found

    def _squares(
        self,
        image: Image,
        rings: list[tuple[Ring, MarkerSighting]],
        expected: _Expected | None,
    ) -> list[FoundSquare]:
        """Look for squares where the pad is expected, else round a ring, else everywhere."""
        squares = self._layout.squares
        if not squares:
            return []
        if expected is not None:
            found = self._squares_expected(image, expected)
            if found:
                return found
        for ring, sighting in rings:
            found = self._squares_near(image, ring, sighting)
            if found:
                return found
        if any(self._is_far(s, expected) for _, s in rings):
            return []
        return self._finder.find(image)

    def _squares_expected(self, image: Image, expected: _Expected) -> list[FoundSquare]:
        by_size: dict[float, list[F64]] = {}
        for s in self._layout.squares:
            points = expected.points(s.position_m, _turned(square_points(s.size_m), s.heading_deg))
            if points is not None:
                by_size.setdefault(s.size_m, []).append(points)
        found = []
        for size, outlines in by_size.items():
            points = np.concatenate(outlines)
            window = self._window(points, expected)
            if window is not None:
                scale = self._search_scale(size, expected.position, expected.normal)
                found += [
                    f
                    for f in self._finder.find(image, window, scale, _SMALLEST_SIDE_PX)
                    if f.square.size_m == size
                ]
        return found

    def _squares_near(
        self, image: Image, ring: Ring, sighting: MarkerSighting
    ) -> list[FoundSquare]:
        """Look for squares round a ring; nothing is known of the heading."""
        pose = sighting.solutions[0]
        position, normal = np.array(pose.position), np.array(pose.normal)
        found = []
        for size in sorted({s.size_m for s in self._layout.squares}):
            reach = max(
                math.dist(s.position_m, ring.position_m)
                for s in self._layout.squares
                if s.size_m == size
            )
            about = _Expected(position, normal, None, 0.0, 4.0)
            points = about.points((0.0, 0.0), circle(reach + 0.75 * size))
            assert points is not None
            window = self._window(points, about)
            if window is not None:
                scale = self._search_scale(size, position, normal)
                found += [
                    f
                    for f in self._finder.find(image, window, scale, _SMALLEST_SIDE_PX)
                    if f.square.size_m == size
                ]
        return found

    def _is_far(self, ring: MarkerSighting, expected: _Expected | None) -> bool:
        """Tell whether a ring is where it is expected, too far off for squares to be found."""
        if expected is None:
            return False
        position = np.array(ring.solutions[0].position)
        off = float(np.linalg.norm(position - expected.position))
        size = max(s.size_m for s in self._layout.squares)
        side_px = self._focal * size / float(position[2])
        return off < 0.3 * float(position[2]) and side_px < _SMALLEST_FULL_PX

    def _search_scale(self, size: float, position: F64, normal: F64) -> float:
        distance = float(np.linalg.norm(position))
        slant = max(0.35, abs(float(position @ normal)) / distance)
        return min(_LARGEST_SCALE, _SEARCH_SIDE_PX * distance / (self._focal * size * slant))

    def _window(self, points: F64, expected: _Expected) -> Window | None:
        """Return the window that holds points (n, 3) and the margin; None: out of the image."""
        camera = self._camera
        nearest = float(points[:, 2].min())
        if nearest < 0.05:
            return Window(0, 0, camera.width, camera.height)
        px = camera.pixels(points)
        low, high = px.min(axis=0), px.max(axis=0)
        margin = (
            0.2 * (high - low) + expected.margin_px + 3.0 * expected.sigma_m * self._focal / nearest
        )
        x0, y0 = np.maximum(np.floor(low - margin), 0.0)
        x1, y1 = np.minimum(np.ceil(high + margin) + 1, (camera.width, camera.height))
        if not (x1 - x0 >= 4 and y1 - y0 >= 4):
            return None
        return Window(int(x0), int(y0), int(x1), int(y1))

    def _square(self, image: Image, found: FoundSquare, prior: Prior) -> Candidate | None:
        """Return a square with its pose; None if that is too uncertain."""
        square = found.square
        poses = self._prints[square].poses(image, self._camera, found.corners)
        poses = sorted((with_gravity(p, prior.down) for p in poses), key=lambda p: p.cost)
        solutions = tuple(s for p in poses if (s := solution(p)) and self._is_certain(s))
        if not solutions:
            return None
        corners = poses[0].t + square_points(square.size_m) @ poses[0].R[:, :2].T
        outline = tuple((float(x), float(y)) for x, y in self._camera.pixels(corners))
        sighting = MarkerSighting(square.kind, square.id, solutions, outline)
        place = np.array([*square.position_m, 0.0])
        return Candidate(
            square, sighting, Measured(place, math.radians(square.heading_deg), tuple(poses))
        )

    def _is_certain(self, s: PoseSolution) -> bool:
        variance = np.linalg.eigvalsh(np.array(s.covariance))[-1]
        return bool(variance <= self._options.max_sigma_m**2)


def _any_across(normal: F64) -> F64:
    """Return some direction that is not along the normal."""
    across: F64 = np.eye(3)[int(np.argmin(np.abs(normal)))]
    return across


def _turned(points: F64, heading_deg: float) -> F64:
    """Return points (n, 2) of a marker in the pad's axes."""
    a = math.radians(heading_deg)
    turn = np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]])
    turned: F64 = points @ turn.T
    return turned
