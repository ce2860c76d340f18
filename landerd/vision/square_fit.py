"""Poses of a square marker from its pixels, both solutions of the planar ambiguity."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3, rotation_vector
from landerd.pad import Square
from landerd.vision.patch import Image
from landerd.vision.pose import EQUAL_NORMALS_COS, SAME_SOLUTION_COS, Pose
from landerd.vision.print_fit import MIN_EXPLAINED, Fit, MarkerPrint
from landerd.vision.square_pose import planar_poses, poses_from_corners

_PER_CELL = 6  # samples of the print along a cell
_MARGIN_CELLS = 2  # white round the print
_USED_MARGIN_CELLS = 0.9  # of it, what is compared with the image

# Between two solutions the errors of light, blur and motion in the model tell as much as the pixels
# do: their difference in chi-square is worth a sixth, and less where neighbouring residuals are
# alike. Gravity decides where that is not enough.
AMBIGUITY_CHI2 = 6.0
# Of the corners, rms, from those of the first fit: a solution that is farther off needs no fit to
# its pixels to be told from the first.
_MAX_RIVAL_ERROR_PX = 0.5
_CORNER_SIGMA_PX = 0.7  # of corners as OpenCV finds them, where the pixels cannot be fitted
# Share of the pixels' variance. More than `MIN_EXPLAINED`, because nothing decoded what is tracked.
_MIN_TRACKED_EXPLAINED = 0.93
# A robust fit explains another code's tag as well, but for the cells that differ: of its pixels.
_MAX_CONTRADICTED = 0.05
# Where the print is hidden in part: of the whole, below which what is left is not sought; of what
# is left; and the share of black, of white and of the code that must be left. A tag with glare and
# a shadow's edge had 0.89 and 0.7, texture never both so much.
_MIN_HIDDEN_EXPLAINED, _MIN_LEFT_EXPLAINED, _MIN_SHOWN = 0.3, 0.86, 0.6
# What no residual shows of such a fit: what hides the print is not cut out to its very edge. And of
# how far it moved the pose: what does not fit may be no foreign piece, but white that is blown out.
_HIDDEN_VARIANCE, _HIDDEN_SHARE = 2.0, 0.5
# Gravity alone tells two solutions apart where one is so level and the other leans so much: pads
# lean by 15 degrees at most.
_LEVEL_COS = math.cos(math.radians(6.0))
_TILTED_COS = math.cos(math.radians(17.0))


class SquarePrint(MarkerPrint):
    """The print of one square marker, ready to be compared with images."""

    def __init__(self, square: Square, cells: NDArray[np.bool_]) -> None:
        """Prepare from the print's cells (n, n): True is white, top row first, border included."""
        count, size = cells.shape[0], square.size_m
        padded = np.pad(cells.astype(np.float64), _MARGIN_CELLS, constant_values=1.0)
        fine = np.kron(padded, np.ones((_PER_CELL, _PER_CELL)))
        reach = 0.5 * size * (1.0 + 2.0 * _USED_MARGIN_CELLS / count)
        self._code_reach = size * (0.5 - 1.0 / count)
        super().__init__(fine, size, count * _PER_CELL / size, reach)

    def poses(
        self,
        image: Image,
        camera: CameraModel,
        corners: F64,
        down: Vec3 | None = None,
        known_normal: Vec3 | None = None,
        first: Fit | None = None,
    ) -> list[Pose]:
        """Return the one or two poses that explain the pixels, best first.

        The cost of the best is 0, that of the other how much worse it explains them. Where the
        print is too disturbed to be fitted, the poses that explain the corners alone.

        Args:
            image: grey image (height, width).
            camera: the lens.
            corners: (4, 2) pixels, top left first, clockwise as printed.
            down: unit vector of gravity, camera frame; a second solution far from level is not
                worth its fit.
            known_normal: into the pad as the frame before or a ring told it, camera frame; a pose
                that agrees needs no second one beside it.
            first: a fit that found the square; None: it is made from the corners.
        """
        if first is None:
            starts = planar_poses(camera.rays(corners), self._size)
            first = self.fit(image, camera, starts[0][0]) if starts else None
        if first is None or first.explained < MIN_EXPLAINED:
            return poses_from_corners(corners, self._size, camera, _CORNER_SIGMA_PX)
        if (
            known_normal is not None
            and first.pose.normal @ np.array(known_normal) > SAME_SOLUTION_COS
        ):
            self.remember(first)
            return [first.pose]
        fits = [first, *self._rivals(image, camera, first, down)]
        self.remember(min(fits, key=lambda f: f.squares))
        return _ranked(fits)

    def track(self, image: Image, camera: CameraModel, expected: Pose) -> Fit | None:
        """Return the fit of the square where it is expected, to a cell; None: it is not there.

        The whole print must be explained, or most of it where something hides the rest, so that
        nothing else is taken for it.
        """
        fit = self.fit(image, camera, expected, has_rival=False)
        if fit is None or fit.explained < _MIN_HIDDEN_EXPLAINED:
            return None
        if fit.contradicted > _MAX_CONTRADICTED:
            return None
        if fit.explained > _MIN_TRACKED_EXPLAINED:
            return fit
        left = self.fit(image, camera, fit.pose, has_rival=False, is_hidden=True)
        if left is None or left.shown is None or left.shown < _MIN_SHOWN:
            return None
        if left.explained < _MIN_LEFT_EXPLAINED or left.contradicted > _MAX_CONTRADICTED:
            return None
        return replace(left, pose=_less_certain(left.pose, fit.pose))

    def _is_telling(self, north: F64, east: F64) -> NDArray[np.bool_]:
        reach = self._code_reach
        telling: NDArray[np.bool_] = (np.abs(north) < reach) & (np.abs(east) < reach)
        return telling

    def _rivals(
        self, image: Image, camera: CameraModel, first: Fit, down: Vec3 | None
    ) -> list[Fit]:
        """Return fits of the other solution, of the corners as a first fit has them."""
        pose, is_hidden = first.pose, first.shown is not None
        focal = 0.5 * (camera.fx + camera.fy)
        rivals = []
        for start, error in planar_poses(self.corner_rays(pose), self._size):
            if down is not None and _is_settled_by_gravity(pose, start, np.array(down)):
                continue
            if (
                float(start.normal @ pose.normal) < EQUAL_NORMALS_COS
                and error * focal < _MAX_RIVAL_ERROR_PX
            ):
                fit = self.fit(image, camera, start, is_hidden=is_hidden)
                if fit is not None and fit.pose.normal @ pose.normal < EQUAL_NORMALS_COS:
                    rivals.append(fit)
        return rivals


def _less_certain(pose: Pose, whole: Pose) -> Pose:
    """Return a pose by what is left of a print, as certain as the fit to the whole lets it be."""
    way = np.concatenate([pose.t - whole.t, rotation_vector((pose.R @ whole.R.T).tolist())])
    covariance = _HIDDEN_VARIANCE * np.linalg.inv(pose.information)
    covariance += _HIDDEN_SHARE**2 * np.outer(way, way)
    information: F64 = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    return replace(pose, information=information)


def _ranked(fits: list[Fit]) -> list[Pose]:
    """Return the poses, best first; its cost is 0, another's how much worse it explains them."""
    fits = sorted(fits, key=lambda f: f.squares)
    # Of residuals that correlate so, n tell as much as n (1 - c) / (1 + c) independent ones.
    c = fits[0].correlation
    unit = AMBIGUITY_CHI2 * fits[0].variance * (1.0 + c) / (1.0 - c)
    return [
        Pose(f.pose.R, f.pose.t, f.pose.information, (f.squares - fits[0].squares) / unit)
        for f in fits
    ]


def _is_settled_by_gravity(pose: Pose, other: Pose, down: F64) -> bool:
    return float(pose.normal @ down) > _LEVEL_COS and float(other.normal @ down) < _TILTED_COS
