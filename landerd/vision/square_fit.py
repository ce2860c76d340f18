"""Poses of a square marker from its pixels, both solutions of the planar ambiguity.

A detected square is fitted from its corners, an expected one from where it is expected (tracking).
The fit is to grey levels (`print_fit`); if these are not explained, to the edges between cells
(`print_edges`); if neither works for a detected square, to its corners alone (`square_pose`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.messages import EDGES, GREY
from landerd.pad import Square
from landerd.vision.arrays import Image
from landerd.vision.pose import EQUAL_NORMALS_COS, MIN_DEPTH_M, SAME_SOLUTION_COS, Pose
from landerd.vision.print_edges import EdgeFit, best_supported, ranked_by_edges
from landerd.vision.print_fit import MIN_EXPLAINED, Fit, MarkerPrint, per_pixel, ranked
from landerd.vision.square_edges import square_edges
from landerd.vision.square_pose import planar_poses, poses_from_corners

_PER_CELL = 12  # samples of the print along a cell
_MARGIN_CELLS = 2  # width of the white round the print
# Width of it that is compared with the image, in cells, but no more than this share of the white
# that the plate leaves: blur mixes the rest with the ground beyond.
_USED_MARGIN_CELLS, _USED_WHITE = 0.9, 0.5

# ---- two solutions -----------------------------------------------------------------------------
# Largest distance of a corner found in the picture from that of the fit to grey levels. If it is
# larger, something as dark as the border lies across it, a leg or a shadow, and the edges tell
# more: of 40 such squares they were off by a third as much, and two fits to grey levels were
# mirrored. Motion by 15 px leaves 5 px at most.
_MOST_OFF_PX = 6.0
# The same of the pose that a ring beside it tells, if the fit is to start there.
_MOST_START_OFF_PX = 3.0
# Largest rms distance of a second solution's corners from those of the first fit: one that is
# farther off is ruled out without a fit to its pixels.
_MAX_RIVAL_ERROR_PX = 0.5
# Nor is it if a corner lies within this of the picture's edge, px: the tip that is cut off there
# may have led the first fit to the wrong solution.
_CUT_PX = 2.0
# Gravity alone rules out a second solution if the first leans by less than the one angle and the
# second by more than the other: pads lean by 15 degrees at most.
_LEVEL_COS = math.cos(math.radians(6.0))
_TILTED_COS = math.cos(math.radians(17.0))
_CORNER_SIGMA_PX = 0.7  # of corners as OpenCV finds them, where the pixels cannot be fitted

# ---- tracking ----------------------------------------------------------------------------------
# Least share of the pixels' variance that a fit explains. More than `MIN_EXPLAINED`, as a tracked
# square was not decoded.
_MIN_TRACKED_EXPLAINED = 0.93
# Largest share of pixels that contradict the print (`Fit.contradicted`): a robust fit explains
# another code's tag as well, except for the cells that differ.
_MAX_CONTRADICTED = 0.05
# Share of the variance below which a fit is not even near the pose, with light or something foreign
# on the print.
_MIN_NEAR_EXPLAINED = 0.3
# Share of the code's cells that must be in the picture: by chance twelve of 36 are as printed once
# in 4096 times, and a border alone may be that of anything dark and straight.
_MIN_IN_VIEW = 1.0 / 3.0

# ---- what edges must show to be the print's ----------------------------------------------------
# Least share of all edges that are in place, least share of the code's that are, and largest share
# of the code's that are white for black. Of 300 tags in their vehicle's shadow all but a few had
# 0.65, 0.53 and none; another code's tag in its place 0.7, 0.42 and 0.07, texture none.
_MIN_SUPPORT, _MIN_CODE_SUPPORT, _MAX_TURNED = 0.6, 0.5, 0.05
# The same of the border and of the code for a print that is hidden in part, say by dirt, and
# contradicted nowhere.
_MIN_OUTLINE_SUPPORT, _MIN_SHOWN_SUPPORT = 0.85, 0.15


class SquarePrint(MarkerPrint):
    """The print of one square marker, ready to be compared with images."""

    def __init__(self, square: Square, cells: NDArray[np.bool_], white_m: float = math.inf) -> None:
        """Prepare the print.

        Args:
            square: its size.
            cells: of its print (n, n): True is white, top row first, border included.
            white_m: least width of the white round it.
        """
        count, size = cells.shape[0], square.size_m
        padded = np.pad(cells.astype(np.float64), _MARGIN_CELLS, constant_values=1.0)
        fine = np.kron(padded, np.ones((_PER_CELL, _PER_CELL)))
        used = min(_USED_MARGIN_CELLS * size / count, _USED_WHITE * white_m)
        self._code_reach = size * (0.5 - 1.0 / count)
        rows = size * ((np.arange(1, count - 1) + 0.5) / count - 0.5)  # within the border
        self._code_cells = np.stack(np.meshgrid(rows, rows), axis=-1).reshape(-1, 2)
        super().__init__(fine, size, count * _PER_CELL / size, 0.5 * size + used, white_m - used)
        self._edges = square_edges(cells, size)

    def poses(
        self,
        image: Image,
        camera: CameraModel,
        corners: F64,
        down: Vec3 | None = None,
        known_normal: Vec3 | None = None,
        start: Pose | None = None,
        first: Fit | EdgeFit | None = None,
    ) -> tuple[list[Pose], str]:
        """Return the one or two poses that explain the pixels, best first, and the fit's stage.

        The best has cost 0, the other the excess of its chi-square. If the print is too disturbed
        to be fitted, these are the poses that explain its edges, else its corners alone.

        Args:
            image: grey image (height, width).
            camera: the lens.
            corners: (4, 2) pixels, top left first, clockwise as printed.
            down: unit vector of gravity, camera frame; a second solution far from level is not
                fitted.
            known_normal: into the pad, from the last frame or a ring, camera frame; if the first
                pose agrees with it, no second one is fitted.
            start: pose that a ring beside it tells; the fit starts there if the corners agree.
            first: the fit that found the square; None: it is made from the corners.
        """
        first = first or self._first(image, camera, corners, start)
        if first is None:
            return poses_from_corners(corners, self._size, camera, _CORNER_SIGMA_PX), GREY
        rivals = self._rivals(camera, first, corners, known_normal, down)
        if isinstance(first, EdgeFit):
            found = (self._edges.fit(image, camera, start) for start in rivals)
            return ranked_by_edges([first, *(f for f in found if f is not None)]), EDGES
        others = (self.fit_rival(image, camera, start, first) for start in rivals)
        fits = [first, *(fit for fit in others if fit is not None)]
        self.remember(min(fits, key=per_pixel))
        return ranked(fits), GREY

    def _first(
        self, image: Image, camera: CameraModel, corners: F64, start: Pose | None
    ) -> Fit | EdgeFit | None:
        """Return the fit from a start that corners agree with, else from them.

        None: only the corners can be used.
        """
        rays = camera.rays(corners)
        if start is None or self._off_px(camera, start, rays) > _MOST_START_OFF_PX:
            starts = planar_poses(rays, self._size)
            if not starts:
                return None
            start, _ = starts[0]
        fit = self.fit(image, camera, start)
        if fit is None or fit.explained < MIN_EXPLAINED:
            return self._by_edges(image, camera, start)
        if self._off_px(camera, fit.pose, rays) < _MOST_OFF_PX and not fit.is_shaded:
            return fit
        return self._by_edges(image, camera, fit.pose, may_be_hidden=True) or fit

    def _off_px(self, camera: CameraModel, pose: Pose, rays: F64) -> float:
        """Return how far the corners of a pose are from others, of which these are the rays, px."""
        return float(np.abs(self.corner_rays(pose) - rays).max()) * camera.focal

    def track(self, image: Image, camera: CameraModel, expected: Pose) -> Fit | EdgeFit | None:
        """Return the fit of the square within a cell of where it is expected; None: it is absent.

        So that nothing else is taken for it, the whole print must be explained, or most of its
        edges if something hides the rest or light is uneven; and enough of its code must be in the
        picture.
        """
        fit = self._tracked(image, camera, expected)
        return fit if fit is not None and self._is_in_view(camera, fit.pose) else None

    def _is_in_view(self, camera: CameraModel, pose: Pose) -> bool:
        """Tell whether enough of the code is in the picture."""
        cells = pose.points(self._code_cells)
        if cells[:, 2].min() < MIN_DEPTH_M:
            return False
        px = camera.pixels(cells)
        inside = ((px > 0.0) & (px < (camera.width - 1, camera.height - 1))).all(axis=1)
        return bool(inside.mean() > _MIN_IN_VIEW)

    def _tracked(self, image: Image, camera: CameraModel, expected: Pose) -> Fit | EdgeFit | None:
        """Return the fit that explains what is in the picture, however little that is."""
        fit = self.fit(image, camera, expected, has_rival=False)
        if fit is None or fit.explained < _MIN_NEAR_EXPLAINED:
            return self._by_edges(image, camera, expected)
        if fit.contradicted > _MAX_CONTRADICTED:  # by another's cells, or by glare
            return self._edges.fit_hidden(image, camera, expected)
        is_explained = fit.explained > _MIN_TRACKED_EXPLAINED
        if is_explained and not fit.darkens:  # else dirt moves it
            return fit
        # No other print contradicts it: what is not as printed may be hidden.
        by_edges = best_supported(
            self._by_edges(image, camera, start, may_be_hidden=True)
            for start in (fit.pose, expected)
        )
        return by_edges or (fit if is_explained else None)

    def _by_edges(
        self, image: Image, camera: CameraModel, start: Pose, *, may_be_hidden: bool = False
    ) -> EdgeFit | None:
        """Return the fit to edges near a start; None: they are not the print's.

        If part of it may be hidden, its border and some of its code are enough.
        """
        fit = self._edges.fit(image, camera, start)
        if fit is None:
            return None
        is_print = fit.support > _MIN_SUPPORT and fit.code_support > _MIN_CODE_SUPPORT
        is_border = fit.outline_support > _MIN_OUTLINE_SUPPORT
        is_shown = is_border and fit.code_support > _MIN_SHOWN_SUPPORT
        if fit.turned < _MAX_TURNED and (is_print or (may_be_hidden and is_shown)):
            return fit
        # Dirt darker than faded ink makes edges white for black, too.
        return fit if self._edges.is_own(image, camera, fit) else None

    def _is_telling(self, north: F64, east: F64) -> NDArray[np.bool_]:
        reach = self._code_reach
        telling: NDArray[np.bool_] = (np.abs(north) < reach) & (np.abs(east) < reach)
        return telling

    def _rivals(
        self,
        camera: CameraModel,
        first: Fit | EdgeFit,
        corners: F64,
        known_normal: Vec3 | None,
        down: Vec3 | None,
    ) -> list[Pose]:
        """Return starts for other solutions, from the corners that the first fit implies.

        `corners` are those found in the picture.
        """
        pose, focal = first.pose, camera.focal
        if known_normal is not None and pose.normal @ np.array(known_normal) > SAME_SOLUTION_COS:
            return []
        # If the first pose is doubtful (the normal is known to be another, or no pad lies so), the
        # other is fitted however far blur or bloom put its corners. So it is if only edges could be
        # fitted: what spoils the grey levels leads edges aside, too.
        is_steep = down is not None and float(pose.normal @ np.array(down)) < _TILTED_COS
        size = camera.width - 1, camera.height - 1
        is_cut = bool(((corners < _CUT_PX) | (corners > np.subtract(size, _CUT_PX))).any())
        is_by_edges = isinstance(first, EdgeFit)
        is_doubtful = known_normal is not None or is_steep or is_cut or is_by_edges
        most_px = math.inf if is_doubtful else _MAX_RIVAL_ERROR_PX
        rivals = []
        for start, error in planar_poses(self.corner_rays(pose), self._size):
            if down is not None and _is_settled_by_gravity(pose, start, np.array(down)):
                continue
            if float(start.normal @ pose.normal) < EQUAL_NORMALS_COS and error * focal < most_px:
                rivals.append(start)
        return rivals


def _is_settled_by_gravity(pose: Pose, other: Pose, down: F64) -> bool:
    return float(pose.normal @ down) > _LEVEL_COS and float(other.normal @ down) < _TILTED_COS
