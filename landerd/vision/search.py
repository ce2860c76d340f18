"""Where in an image a pad's markers are looked for."""

import math
from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring, Square
from landerd.vision.pose import Pose, circle, rotation_from
from landerd.vision.square import FoundSquare, Image, SquareFinder
from landerd.vision.square_fit import SquarePrint
from landerd.vision.square_pose import square_points
from landerd.vision.whycon import find_rings, track_ring
from landerd.vision.window import Window

_MOST_ALIKE = 3  # rings looked at for one ring of the pad
_SEARCH_SIDE_PX = 28.0  # squares whose size in the image is known are searched at about this
_SMALLEST_SIDE_PX = 14.0  # and at least this size
_LARGEST_SCALE = 4.0
_THOROUGH_EVERY = 5  # frames in which nothing is found: the search is thorough in every fifth
_SQUARES_WAIT = 4  # frames after one in which small squares were looked for beside a ring
_LARGE_SIDE_PX = 40.0  # a square this large tells the pose as well as any ring does

FoundRing = tuple[Ring, MarkerSighting]


@dataclass(frozen=True)
class Expected:
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


class Search:
    """Looks for the markers of one pad in the images of one camera."""

    def __init__(
        self,
        layout: PadLayout,
        camera: CameraModel,
        min_ring_px: float,
        prints: dict[Square, SquarePrint],
    ) -> None:
        """Prepare the search; rings smaller than min_ring_px across are not reported.

        Raises:
            ValueError: the pad has a square that OpenCV's dictionaries lack.
        """
        self._layout = layout
        self._camera = camera
        self._focal = 0.5 * (camera.fx + camera.fy)
        self._min_ring_px = min_ring_px
        self._finder = SquareFinder(layout)
        self._prints = prints
        self._squares_wait = 0  # frames in which a ring is enough
        self._lost_frames = 0  # in which nothing was found where it was expected

    def find(
        self, image: Image, expected: Expected | None, down: Vec3 | None, *, sparing: bool
    ) -> tuple[list[FoundRing], list[FoundSquare]]:
        """Return what may be the pad's rings, of each the nearest few, and its squares.

        First where the pad is expected; what is not found there, everywhere. But one square tells
        where the rings are, and a large one all that they could; and squares are beside the rings
        of their pad or, if none is seen, anywhere. While nothing is found the search is thorough in
        every fifth frame only, the first one included: of the whole image although the pad is
        expected in a part of it, with a second threshold for rings, and for squares too.

        Args:
            image: grey image (height, width).
            expected: where the pad should be.
            down: unit vector of gravity, camera frame.
            sparing: look for small squares beside a ring in every fifth frame only: they tell the
                heading, which changes slowly.
        """
        rings: list[FoundRing] = []
        squares: list[FoundSquare] = []
        waiting = False
        if expected is not None:
            if sparing and self._squares_wait > 0:
                rings = self._rings_expected(image, expected, down, whole_only=False)
            waiting = bool(rings)
            if not waiting:
                squares = self._squares_expected(image, expected)
                if not any(_side_px(s.corners) > _LARGE_SIDE_PX for s in squares):
                    rings = self._rings_expected(image, expected, down, whole_only=bool(squares))
        self._squares_wait = _SQUARES_WAIT if rings and not waiting else self._squares_wait - 1
        if waiting:
            return rings, squares
        thorough = self._lost_frames % _THOROUGH_EVERY == 0
        if not rings and not squares:
            self._lost_frames += 1
            if expected is None or thorough:
                rings = self._rings_anywhere(image, down, thorough=thorough)
        if not squares and self._layout.squares:
            squares = self._squares_unexpected(image, rings, whole_image=thorough)
        return rings, squares

    def _rings_anywhere(
        self, image: Image, down: Vec3 | None, *, thorough: bool
    ) -> list[FoundRing]:
        rings: list[FoundRing] = []
        for ring in self._layout.rings:
            found = find_rings(image, ring, self._camera, down=down, thorough=thorough)
            rings += [(ring, s) for s in self._likely(found)]
        return rings

    def _rings_expected(
        self, image: Image, expected: Expected, down: Vec3 | None, *, whole_only: bool
    ) -> list[FoundRing]:
        """Look for rings where they should be; whole_only: not for those that the image cuts.

        Just over the pad the ring fills the image and only the square tells the pose: looking for
        the ring there would cost ten times what finding the square does.
        """
        rings: list[FoundRing] = []
        for ring in self._layout.rings:
            points = expected.points(ring.position_m, circle(0.5 * ring.outer_diameter_m))
            if points is None or (whole_only and not self._is_whole(points)):
                continue
            tracked = track_ring(
                image, ring, self._camera, points.mean(axis=0), expected.normal, down=down
            )
            if tracked is not None:
                rings += [(ring, s) for s in self._likely([tracked])]
                continue
            window = self._window(points, expected)
            if window is None:
                continue
            size = self._focal * ring.outer_diameter_m / float(points[:, 2].mean())
            found = find_rings(
                image, ring, self._camera, window=window, down=down, expected_diameter_px=size
            )
            rings += [(ring, s) for s in self._likely(found)]
        return rings

    def _likely(self, rings: list[MarkerSighting]) -> list[MarkerSighting]:
        large = [
            r for r in rings if np.ptp(np.array(r.outline_px), axis=0).max() >= self._min_ring_px
        ]
        return large[:_MOST_ALIKE]

    def _squares_unexpected(
        self, image: Image, rings: list[FoundRing], *, whole_image: bool
    ) -> list[FoundSquare]:
        """Look for squares round the rings, without rings in the whole image if asked to."""
        for ring, sighting in rings:
            found = self._squares_near(image, ring, sighting)
            if found:
                return found
        return self._finder.find(image) if whole_image and not rings else []

    def _squares_expected(self, image: Image, expected: Expected) -> list[FoundSquare]:
        """Look for squares where they should be: a fit that starts there, else the detector."""
        found = []
        by_size: dict[float, list[F64]] = {}
        for s in self._layout.squares:
            points = expected.points(s.position_m, _turned(square_points(s.size_m), s.heading_deg))
            if points is None:
                continue
            tracked = self._tracked(image, s, points, expected)
            if tracked is not None:
                found.append(tracked)
            else:
                by_size.setdefault(s.size_m, []).append(points)
        if any(_side_px(s.corners) > _LARGE_SIDE_PX for s in found):
            return found
        known = {f.square for f in found}
        for size, outlines in by_size.items():
            points = np.concatenate(outlines)
            window = self._window(points, expected)
            if window is not None:
                scale = self._search_scale(size, points.mean(axis=0), expected.normal)
                found += [
                    f
                    for f in self._finder.find(image, window, scale, _SMALLEST_SIDE_PX)
                    if f.square.size_m == size and f.square not in known
                ]
        return found

    def _tracked(
        self, image: Image, square: Square, corners: F64, expected: Expected
    ) -> FoundSquare | None:
        """Return a square if it is where its corners (4, 3), camera frame, are expected."""
        if expected.north is None or float(corners[:, 2].min()) < 0.05:
            return None
        px = self._camera.pixels(corners)
        out_of_sight = (px.max(axis=0) < 0).any() or (
            px.min(axis=0) > (self._camera.width, self._camera.height)
        ).any()
        if out_of_sight or _side_px(px) < _SMALLEST_SIDE_PX:
            return None
        north = corners[:2].sum(axis=0) - corners[2:].sum(axis=0)
        start = Pose(
            rotation_from(expected.normal, north), corners.mean(axis=0), np.zeros((6, 6)), 0.0
        )
        fit = self._prints[square].track(image, self._camera, start)
        if fit is None:
            return None
        at = fit.pose.t + square_points(square.size_m) @ fit.pose.R[:, :2].T
        return FoundSquare(square, self._camera.pixels(at), fit)

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
            about = Expected(position, normal, None, 0.0, 4.0)
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

    def _search_scale(self, size: float, position: F64, normal: F64) -> float:
        distance = float(np.linalg.norm(position))
        slant = max(0.35, abs(float(position @ normal)) / distance)
        return min(_LARGEST_SCALE, _SEARCH_SIDE_PX * distance / (self._focal * size * slant))

    def _is_whole(self, points: F64) -> bool:
        """Tell whether points (n, 3) all lie in the image."""
        if float(points[:, 2].min()) < 0.05:
            return False
        px = self._camera.pixels(points)
        size = (self._camera.width - 1, self._camera.height - 1)
        return bool((px >= 0.0).all() and (px <= size).all())

    def _window(self, points: F64, expected: Expected) -> Window | None:
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


def _side_px(corners: F64) -> float:
    """Return the shortest side of a square with corners (4, 2) in the image."""
    return float(np.sqrt(((corners - np.roll(corners, 1, axis=0)) ** 2).sum(axis=1)).min())


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
