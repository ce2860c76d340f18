"""Vision's detectors for flights with modelled sight: they make up what would have been found.

A picture's number leads to the true view (`numbered`). The edges of each marker are projected by
the true lens, get vision's noise, and are back-projected by the lens of landerd's calibration. The
poses that explain them are what is seen. The rest of vision is the real one.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from hw.sim.options import SimOptions
from hw.sim.picture.levels import Levels, Sensitivity
from hw.sim.picture.numbered import NumberedPictures, View
from landerd.camera_model import F64, CameraModel, Window
from landerd.geometry import Vec3, cross
from landerd.messages import CLIPPED_LEVEL, EDGES, GREY, Light, MarkerSighting, PoseSolution
from landerd.pad import Marker, PadLayout, Ring, Square, WhyCode, size_m
from landerd.simulation.sight import statistics
from landerd.simulation.sight.edge_fit import Across, SeenEdges, across, fitted
from landerd.simulation.sight.edges import Edges, edges_of
from landerd.simulation.sight.world_view import Seen, WorldView
from landerd.vision.arrays import Image
from landerd.vision.expected import Expected
from landerd.vision.plate_heading import PlateNorth
from landerd.vision.plate_outline import has_beside
from landerd.vision.pose import (
    EQUAL_NORMALS_COS,
    SAME_SOLUTION_COS,
    Pose,
    rotation_from,
    turned_about_normal,
    vec3,
)
from landerd.vision.print_fit import AMBIGUITY_CHI2, Fit
from landerd.vision.ring_covariance import frontal_inflation
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_fit_stages import MAX_TILT_COS, TRACKED_BAND_PX
from landerd.vision.ring_pose import tangents
from landerd.vision.ring_search import Refusal
from landerd.vision.ring_sighting import ring_sighting
from landerd.vision.ring_work import RingWork
from landerd.vision.square import MIN_SIDE_PX, FoundSquare
from landerd.vision.square_pose import corner_information, planar_poses, square_points
from landerd.vision.tone import LINEAR
from landerd.vision.whycode import FoundCode, mirrored_pose

_PLATE = 1  # part of the random seed of a ring's plate
_FAR_PAD = 0.001  # share of a picture covered by a pad that is too far away to be found
_SIZE_FACTOR = 2.0  # largest ratio of expected and actual size with which a ring is found


@dataclass(frozen=True, slots=True)
class _Sight:
    """One marker in one picture, as it would be measured."""

    px: F64  # places of its edges that are in the picture, (n, 2)
    shown: float  # share of its edges in the picture
    size_px: float  # its smaller width in the picture
    chance: float  # random number, 0 to 1: the marker is found if it is below `found`
    found: float  # share of such markers that are found
    pose: Pose  # that explains the marker, with the stated information
    edges: SeenEdges
    offset_px: F64  # random errors of the edges' places, see `fitted`
    weight: F64  # their inverse variances, see `fitted`
    blur_px: float  # sigma
    by_edges: bool  # whether a ring is fitted to its edges alone
    bias: F64  # standard normal random numbers for errors that residuals do not show, (6,)

    @property
    def is_found(self) -> bool:
        """Whether the marker is found."""
        return self.chance < self.found


class ModelledDetectors:
    """Implements landerd.vision.Detectors; images are those of `NumberedPictures`."""

    def __init__(
        self,
        layout: PadLayout,
        printed: PadLayout,
        believed: CameraModel,
        lens: CameraModel,
        options: SimOptions,
        pictures: NumberedPictures,
        seed: int,
    ) -> None:
        """Prepare the markers.

        Args:
            layout: of the pad in landerd's file.
            printed: of the pad in the world.
            believed: the camera by landerd's calibration.
            lens: the true camera.
            options: of the simulated world.
            pictures: know the view of each picture.
            seed: of what is found, and of errors.
        """
        self._layout, self._camera, self._options = layout, believed, options
        self._world = WorldView(printed, lens, options)
        self._pictures = pictures
        self._seed = seed
        self._sensitivity = Sensitivity(options.render, options.camera, options.pad)
        self._edges = [edges_of(m) for m in layout.markers]
        self._focal = believed.focal
        self._image: Image | None = None
        self._view: View | None = None
        self._sights: dict[int, _Sight | None] = {}

    # ---- landerd.vision.Detectors ----------------------------------------------------------------

    def track_ring(
        self,
        image: Image,
        ring: Ring,
        position: F64,
        normal: F64,
        down: Vec3 | None,
        *,
        vouched: bool = False,
    ) -> MarkerSighting | None:
        """Return the ring if its edges are near where they are expected."""
        sight = self._sight(image, ring)
        if sight is None or not sight.is_found:
            return None
        expected = Pose(rotation_from(normal, sight.pose.R[:, 0]), position, np.zeros((6, 6)), 0.0)
        lie = across(sight.edges.edges, expected, self._focal)
        off = self._focal * ((sight.edges.rays - lie.ray) * lie.normal).sum(axis=1)
        used = sight.weight > 0.0
        if not float(np.sqrt(np.mean(off[used] ** 2))) < TRACKED_BAND_PX:
            return None
        return self._ring_sighting(ring, sight, down, level_only=True)

    def find_rings(
        self,
        image: Image,
        ring: Ring,
        *,
        window: Window | None = None,
        down: Vec3 | None = None,
        expected_diameter_px: float | None = None,
        thorough: bool = True,
        work: RingWork | None = None,
        refuses: Refusal | None = None,
        vouched: bool = False,
    ) -> list[MarkerSighting]:
        """Return the ring if it is in the window, of about the expected size."""
        sight = self._sight(image, ring)
        if sight is None or not sight.is_found or not _holds(window, sight.px):
            return []
        if expected_diameter_px is not None:
            factor = sight.size_px / max(expected_diameter_px, 1e-9)
            if not 1.0 / _SIZE_FACTOR < factor < _SIZE_FACTOR:
                return []
        return [self._ring_sighting(ring, sight, down, level_only=False)]

    def ring_on_plate(
        self, image: Image, ring: Ring, expected: F64, down: Vec3
    ) -> MarkerSighting | None:
        """Return None: nothing that hides a ring is modelled."""
        return None

    def track_square(self, image: Image, square: Square, expected: Pose) -> Fit | None:
        """Return the square if its edges are within a cell of where they are expected."""
        sight = self._sight(image, square)
        if sight is None or not sight.is_found or sight.pose.normal @ expected.normal < 0.9:
            return None
        lie = across(sight.edges.edges, expected, self._focal)
        off = self._focal * np.abs(sight.edges.rays - lie.ray).max(axis=1)
        cell_px = sight.edges.edges.apart_m * self._focal / float(sight.pose.t[2])
        if not float(off[sight.weight > 0.0].max()) < cell_px:
            return None
        return Fit(
            pose=sight.pose,
            explained=1.0,
            squares=sight.pose.cost,
            variance=1.0,
            correlation=0.0,
            tone=LINEAR,
            blur=1.0,
            contradiction=lambda: 0.0,
            pixels=1.0,
            reduction=1,
        )

    def find_squares(
        self,
        image: Image,
        window: Window | None = None,
        scale: float = 1.0,
        smallest_px: float = MIN_SIDE_PX,
        *,
        evened_px: int | None = None,
    ) -> list[FoundSquare]:
        """Return the squares that are wholly in the window; evened light shows no others."""
        if evened_px is not None:
            return []
        found = []
        for square in self._layout.squares:
            sight = self._sight(image, square)
            if (
                sight is None
                or not sight.is_found
                or sight.shown < statistics.DETECTED_SHOWN
                or not _holds(window, sight.px)
            ):
                continue
            corners = sight.pose.points(square_points(square.size_m))
            found.append(FoundSquare(square, self._camera.pixels(corners)))
        return found

    def squares_beside(
        self, image: Image, ring: Ring, sighting: MarkerSighting
    ) -> list[FoundSquare]:
        """Return none: nothing that hides a square's code is modelled."""
        return []

    def other_id(self, image: Image, ring: Ring, sighting: MarkerSighting) -> int | None:
        """Return None: other pads are not modelled."""
        return None

    def square_poses(
        self,
        image: Image,
        found: FoundSquare,
        down: Vec3 | None,
        normal: Vec3 | None,
        start: Pose | None,
    ) -> tuple[list[Pose], str]:
        """Return the poses that explain a square, best first, and the stage that fitted them."""
        sight = self._sight(image, found.square)
        assert sight is not None
        best = sight.pose
        if normal is not None and best.normal @ np.array(normal) > SAME_SOLUTION_COS:
            return [_with_cost(best, 0.0)], GREY
        poses = [best]
        rays = best.rays(square_points(found.square.size_m))
        for start, _ in planar_poses(rays, found.square.size_m):
            if float(start.normal @ best.normal) < EQUAL_NORMALS_COS:
                other = self._fitted(found.square, sight, start)
                if other is not None and other.normal @ best.normal < EQUAL_NORMALS_COS:
                    poses.append(other)
        return _ranked(poses), GREY

    def find_codes(
        self, image: Image, expected: Expected | None, normal: Vec3 | None
    ) -> list[FoundCode]:
        """Return the pad's WhyCodes in the picture."""
        found = []
        for code in self._layout.whycodes:
            sight = self._sight(image, code)
            if sight is not None and sight.is_found:
                found.append(FoundCode(code, self._code_poses(code, sight, normal)))
        return found

    def is_blank(self, image: Image) -> bool:
        """Return False: modelled pictures are never blank."""
        return False

    def is_textured(self, image: Image) -> bool:
        """Return False: modelled searches take no time."""
        return False

    def lacks_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """Return False: there are no look-alikes."""
        return False

    def shows_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """Return True: there are no look-alikes."""
        return True

    def has_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """Return True: there are no look-alikes."""
        return True

    def plate_north(
        self, image: Image, ring: Ring, sighting: MarkerSighting, known: F64 | None
    ) -> PlateNorth | None:
        """Return the pad's north by the plate of a ring that has other markers beside it."""
        view, sight = self._look(image), self._sight(image, ring)
        if view is None or sight is None or not has_beside(self._layout, ring):
            return None
        number = self._layout.markers.index(ring)
        rng = np.random.default_rng([self._seed, view.number, number, _PLATE])
        if rng.random() > statistics.plate_north_share(sight.size_px):
            return None
        error, stated = statistics.plate_north_sigma(sight.size_px)
        R = turned_about_normal(sight.pose.R, error * float(rng.standard_normal()))
        return PlateNorth(R[:, 0], stated)

    def light(self, image: Image, pad: PoseSolution | None, down: Vec3 | None) -> Light:
        """Return the brightness of the pad's white; without a pad, of the ground, and clipping."""
        view = self._look(image)
        levels = self._sensitivity.levels(None if view is None else view.exposure)
        if pad is not None:
            return Light(levels.white, on_pad=True)
        is_clipped = levels.white >= CLIPPED_LEVEL
        return Light(levels.ground, on_pad=False, clipped=_FAR_PAD if is_clipped else 0.0)

    # ---- poses -----------------------------------------------------------------------------------

    def _ring_sighting(
        self, ring: Ring, sight: _Sight, down: Vec3 | None, *, level_only: bool
    ) -> MarkerSighting:
        """Return a ring with both its poses.

        If `level_only`, the mirrored pose is left out unless a pad could lie that way.
        """
        fits = [self._ring_fit(ring, sight, sight.pose)]
        start = mirrored_pose(sight.pose, ring.radius_m)
        if start is not None and (
            not level_only or down is None or start.normal @ np.array(down) > MAX_TILT_COS
        ):
            other = self._fitted(ring, sight, start)
            if other is not None:
                fits.append(self._ring_fit(ring, sight, other))
        fits.sort(key=lambda f: f.cost)
        return ring_sighting(fits, ring, self._camera, down)

    def _ring_fit(self, ring: Ring, sight: _Sight, pose: Pose) -> RingFit:
        """Return a pose of a ring as vision's fits give it, with position and tilt only."""
        e = np.array([*tangents(pose.normal), pose.normal])
        C = np.linalg.inv(pose.information)
        # A turn w moves the normal by w x n: along a tangent by w . (n x tangent), whichever
        # handedness the tangents have.
        to_axes = np.zeros((5, 6))
        to_axes[:3, :3] = e
        first, second, normal = (vec3(axis) for axis in e)
        to_axes[3, 3:], to_axes[4, 3:] = cross(normal, first), cross(normal, second)
        covariance = to_axes @ C @ to_axes.T
        covariance += frontal_inflation(covariance, e @ pose.t / np.linalg.norm(pose.t))
        of_position = e.T @ covariance[:3, :3] @ e
        if sight.by_edges:
            alike, aside = (px / self._focal for px in statistics.BY_EDGES_PX)
            distance = float(np.linalg.norm(pose.t))
            along = alike * distance / ring.radius_m * pose.t
            of_position += np.outer(along, along) + (aside * distance) ** 2 * np.eye(3)
        sigma_tilt = math.sqrt(float(np.trace(covariance[3:, 3:])) / 2.0)
        return RingFit(
            position=pose.t,
            normal=pose.normal,
            blur_px=1.0,
            motion_px=np.zeros(2),
            inside=0.0,
            black=0.0,
            outside=0.0,
            noise=0.0,
            cost=pose.cost,
            explained=lambda: 1.0,
            uncertainty=lambda: (of_position, sigma_tilt),
            ratio=1.0,
            sigma_ratio=0.0,
            stage=EDGES if sight.by_edges else GREY,
        )

    def _code_poses(self, code: WhyCode, sight: _Sight, normal: Vec3 | None) -> tuple[Pose, ...]:
        """Return the poses that explain a WhyCode, best first."""
        poses = [sight.pose]
        if normal is None or sight.pose.normal @ np.array(normal) < SAME_SOLUTION_COS:
            start = mirrored_pose(sight.pose, code.radius_m)
            if start is not None:
                other = self._fitted(code, sight, start)
                if other is not None and other.normal @ sight.pose.normal < EQUAL_NORMALS_COS:
                    poses.append(other)
        return tuple(_ranked(poses))

    # ---- one picture -----------------------------------------------------------------------------

    def _look(self, image: Image) -> View | None:
        """Return the view of a picture; random numbers for it are drawn only once."""
        if image is not self._image:
            self._image, self._view = image, self._pictures.view_of(image)
            self._sights.clear()
        return self._view

    def _sight(self, image: Image, marker: Marker) -> _Sight | None:
        """Return a marker as it would be measured; None: too little of it is in the picture."""
        view = self._look(image)
        number = self._layout.markers.index(marker)
        if view is None:
            return None
        if number not in self._sights:
            self._sights[number] = self._drawn(image, view, number)
        return self._sights[number]

    def _least_shown(self, marker: Marker, seen: Seen) -> float:
        """Return the share of a marker's edges that must be in the picture for it to be found."""
        if isinstance(marker, Square) and self._size_px(marker, seen) > self._camera.height:
            return statistics.LARGE_SQUARE_SHOWN
        return statistics.KINDS[marker.kind].least_shown

    def _drawn(self, image: Image, view: View, number: int) -> _Sight | None:
        """Draw random numbers for a marker in a picture, and return it; see `_sight`."""
        marker, edges = self._layout.markers[number], self._edges[number]
        seen = self._world.seen(image, view, number)
        kind = statistics.KINDS[marker.kind]
        if seen is None or seen.shown.mean() < self._least_shown(marker, seen):
            return None
        rng = np.random.default_rng([self._seed, view.number, number])
        levels = self._sensitivity.levels(view.exposure)
        chance = float(rng.random())
        size_px = self._size_px(marker, seen)
        found = statistics.found_share(kind, size_px, levels)
        if found < 1e-3:
            return None
        rays = self._rays(seen)
        seen_edges = SeenEdges(edges, rays, self._focal)
        lie = across(edges, seen.pose, self._focal)
        weight = self._weight(kind, size_px, edges, seen, lie, levels)
        offset = _offset(weight, rng)
        pose = fitted(seen_edges, seen.pose, offset, weight, lie)
        if pose is None:
            return None
        shown, blur_px = float(seen.shown.mean()), self._blur(seen.path_px)
        sight = _Sight(
            px=seen.px[seen.shown],
            shown=shown,
            size_px=size_px,
            chance=chance,
            found=found,
            pose=pose,
            edges=seen_edges,
            offset_px=offset,
            weight=weight,
            blur_px=float(blur_px),
            by_edges=statistics.is_by_edges(self._options, levels),
            bias=rng.standard_normal(6),
        )
        return replace(sight, pose=self._biased(marker, sight, pose))

    def _fitted(self, marker: Marker, sight: _Sight, start: Pose) -> Pose | None:
        """Return the pose near a start that explains the marker; None: there is none."""
        pose = fitted(sight.edges, start, sight.offset_px, sight.weight)
        return None if pose is None else self._biased(marker, sight, pose)

    def _biased(self, marker: Marker, sight: _Sight, pose: Pose) -> Pose:
        """Return a pose with random errors that residuals do not show.

        For squares and codes they are added to the stated information; for rings, `ring_sighting`
        does that.
        """
        if isinstance(marker, Ring):
            alike, *aside = statistics.ring_bias_px(
                sight.size_px, sight.bias[:3], by_edges=sight.by_edges
            ).tolist()
            k = float(np.linalg.norm(pose.t)) / self._focal
            step = alike * k / marker.radius_m * pose.t
            step[:2] += np.array(aside) * k
            return replace(pose, t=pose.t + step)
        bias = statistics.print_bias_px(sight.size_px, sight.blur_px) / self._focal
        corners = np.linalg.inv(corner_information(pose, size_m(marker), bias))
        information = np.linalg.inv(np.linalg.inv(pose.information) + corners)
        moved = pose.moved(np.linalg.cholesky(corners) @ sight.bias)
        return Pose(moved.R, moved.t, information, pose.cost)

    def _blur(self, along_px: F64) -> F64:
        """Return the blur (sigma) of edges, px.

        `along_px` (..., k) is the path during the exposure that counts for each edge.
        """
        still = math.hypot(self._options.render.defocus_px, statistics.PIXEL_BLUR)
        blur: F64 = np.sqrt(still**2 + (along_px * along_px).sum(axis=-1) / 12.0)
        return blur

    def _rays(self, seen: Seen) -> F64:
        """Return the rays of the edges by landerd's calibration, on z = 1, (n, 2)."""
        px = np.where(seen.shown[:, None], seen.px, (self._camera.cx, self._camera.cy))
        return self._camera.rays(px)

    def _weight(
        self,
        kind: statistics.Kind,
        size_px: float,
        edges: Edges,
        seen: Seen,
        lie: Across,
        levels: Levels,
    ) -> F64:
        """Return the inverse variances (n,) of the edges' places, 1/px^2; 0 if not shown."""
        apart_px = edges.apart_m * self._focal * _slant(seen.pose) / float(seen.pose.t[2])
        blur = self._blur((lie.normal @ seen.path_px)[:, None])
        variance = statistics.edge_variance(kind, size_px, blur, apart_px, levels)
        weight: F64 = np.where(seen.shown, lie.length_px / variance, 0.0)
        return weight

    def _size_px(self, marker: Marker, seen: Seen) -> float:
        """Return the marker's smaller width in the image."""
        return self._focal * size_m(marker) * _slant(seen.pose) / float(seen.pose.t[2])


def _offset(inverse_variance: F64, rng: np.random.Generator) -> F64:
    """Return random errors (n,) of the edges' places, px; 0 if an edge is not shown.

    Args:
        inverse_variance: of the edges' places, 1/px^2, (n,); 0 if an edge is not shown.
        rng: source of the errors.
    """
    noise = rng.standard_normal(len(inverse_variance)) / np.sqrt(np.maximum(inverse_variance, 1e-9))
    offset: F64 = np.where(inverse_variance > 0.0, noise, 0.0)
    return offset


def _slant(pose: Pose) -> float:
    """Return the cosine of the angle between a marker's normal and the line of sight."""
    return float(pose.normal @ pose.t) / float(np.linalg.norm(pose.t))


def _holds(window: Window | None, px: F64) -> bool:
    """Tell whether points (n, 2) lie in a window; None: the whole image."""
    if window is None:
        return True
    (x0, y0), (x1, y1) = px.min(axis=0), px.max(axis=0)
    return bool(x0 >= window.x0 and y0 >= window.y0 and x1 < window.x1 and y1 < window.y1)


def _ranked(poses: list[Pose]) -> list[Pose]:
    """Return poses, best first, with the differences of their costs as `print_fit` counts them."""
    poses = sorted(poses, key=lambda p: p.cost)
    return [_with_cost(p, (p.cost - poses[0].cost) / AMBIGUITY_CHI2) for p in poses]


def _with_cost(pose: Pose, cost: float) -> Pose:
    """Return a pose with another cost."""
    return Pose(pose.R, pose.t, pose.information, cost)
