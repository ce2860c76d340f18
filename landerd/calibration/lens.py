"""Calibrates a camera's intrinsics and distortion from views of a board, and judges the result.

The method is Zhang's (A Flexible New Technique for Camera Calibration, 2000), by OpenCV. A small
reprojection error alone is no proof: views from straight ahead, or of the middle of the picture
only, fit well and give a wrong focal length. Therefore coverage of the picture, tilt of the board
and stated uncertainty are judged as well.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.calibration.board import Board, View
from landerd.camera_model import CameraModel

Lens = Literal["plumb_bob", "rational", "fisheye"]

FEWEST_VIEWS = 10  # least number of views
GRID = (4, 4)  # number of cells of the picture, across and down
_FEWEST_CELLS = 13  # least number of the 16 cells that contain corners
_TILTED_DEG = 15.0  # least tilt of a view that helps to determine the focal length
_FEWEST_TILTED = 4  # least number of such views
_LARGEST_ERROR_PX = 1.0  # largest rms reprojection error over all corners
_LARGEST_FOCAL_SIGMA = 0.003  # largest sigma of the focal length, relative
_UNKNOWABLE = 1e12  # condition of the equations from which on views do not tell the focal length
_OUTLIER_RATIO = 3.0  # error over the median of all views above which a view is an outlier


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera, and how well the views determine it."""

    camera: CameraModel
    error_px: float  # rms reprojection error over all corners
    errors_px: tuple[float, ...]  # rms reprojection error of each view
    tilts_deg: tuple[float, ...]  # of each view: angle of the optical axis to the board's normal
    focal_sigma: float  # of the focal length, relative


def coverage(views: Sequence[View], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Tell which cells of the picture contain corners, (rows, columns) of GRID.

    Args:
        views: of the board.
        size: width and height of the pictures, px.
    """
    covered = np.zeros((GRID[1], GRID[0]), np.bool_)
    for view in views:
        cells = np.floor((view.corners_px + 0.5) / size * GRID).astype(int)
        cells = np.clip(cells, 0, np.array(GRID) - 1)
        covered[cells[:, 1], cells[:, 0]] = True
    return covered


def calibrate(
    board: Board, views: Sequence[View], size: tuple[int, int], lens: Lens
) -> Calibration:
    """Return the camera that explains the views best.

    Args:
        board: of the views.
        views: at least three.
        size: width and height of the pictures, px.
        lens: plumb_bob (k1 k2 p1 p2 k3), rational (and k4 k5 k6) or fisheye (k1 k2 k3 k4).

    Raises:
        ValueError: no camera explains them; the text is one line.
    """
    places = [board.corners_m(view.ids).astype(np.float32) for view in views]
    pixels = [view.corners_px.astype(np.float32) for view in views]
    try:
        camera, rotations, translations, sigma = _solve(places, pixels, size, lens)
    except cv2.error:
        raise ValueError("no camera of this kind explains the views") from None
    errors, tilts, total, count = [], [], 0.0, 0
    for place, pixel, rotation, translation in zip(
        places, pixels, rotations, translations, strict=True
    ):
        R = np.asarray(cv2.Rodrigues(np.asarray(rotation, np.float64))[0])
        in_camera = place.astype(np.float64) @ R.T + np.asarray(translation).reshape(1, 3)
        squares = np.sum((camera.pixels(in_camera) - pixel) ** 2, axis=1)
        errors.append(math.sqrt(float(np.mean(squares))))
        tilts.append(math.degrees(math.acos(min(1.0, abs(float(R[2, 2]))))))
        total += float(np.sum(squares))
        count += len(squares)
    return Calibration(camera, math.sqrt(total / count), tuple(errors), tuple(tilts), sigma)


def _solve(
    places: list[NDArray[np.float32]],
    pixels: list[NDArray[np.float32]],
    size: tuple[int, int],
    lens: Lens,
) -> tuple[CameraModel, Sequence[Any], Sequence[Any], float]:
    """Return camera, rotation vectors and translations of the views, and `focal_sigma`.

    Args:
        places: corners on the board in each view, m, (n, 3).
        pixels: the same corners in the picture, px, (n, 2).
        size: width and height of the pictures, px.
        lens: model of the lens.

    Raises:
        cv2.error: no camera explains the views.
    """
    if lens == "fisheye":
        return _solve_fisheye(places, pixels, size)
    flags, count = (cv2.CALIB_RATIONAL_MODEL, 8) if lens == "rational" else (0, 5)
    _, K, D, rotations, translations, sigmas, _, _ = cv2.calibrateCameraExtended(
        places, pixels, size, np.eye(3), np.zeros(count), flags=flags
    )
    focal_sigma = max(float(sigmas.flat[0] / K[0, 0]), float(sigmas.flat[1] / K[1, 1]))
    return _camera(size, K, D, count), rotations, translations, focal_sigma


def _solve_fisheye(
    places: list[NDArray[np.float32]], pixels: list[NDArray[np.float32]], size: tuple[int, int]
) -> tuple[CameraModel, Sequence[Any], Sequence[Any], float]:
    """Return what `_solve` returns; OpenCV does not give the uncertainty of a fisheye."""
    points = [place.reshape(1, -1, 3).astype(np.float64) for place in places]
    seen = [pixel.reshape(1, -1, 2).astype(np.float64) for pixel in pixels]
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    rms, K, D, rotations, translations = cv2.fisheye.calibrate(
        points, seen, size, np.eye(3), np.zeros(4), flags=flags
    )
    # Linear error propagation; the columns of OpenCV's Jacobian: f, c, k of the lens (8), then
    # rotation and translation of the view (6), and skew.
    N = np.zeros((8 + 6 * len(points),) * 2)
    for i, (point, rotation, translation) in enumerate(
        zip(points, rotations, translations, strict=True)
    ):
        _, J = cv2.fisheye.projectPoints(point, rotation, translation, K, D)
        own = slice(8 + 6 * i, 14 + 6 * i)
        lens, view = J[:, :8], J[:, 8:14]
        N[:8, :8] += lens.T @ lens
        N[:8, own] = lens.T @ view
        N[own, :8] = N[:8, own].T
        N[own, own] = view.T @ view
    focal_sigma = 1.0  # all of it: the views do not tell
    scale = np.sqrt(np.diag(N))  # the units of focal lengths and coefficients differ by powers
    scaled = N / np.outer(scale, scale)
    if np.linalg.cond(scaled) < _UNKNOWABLE:
        sigmas = rms / math.sqrt(2.0) * np.sqrt(np.diag(np.linalg.inv(scaled))) / scale
        focal_sigma = max(float(sigmas[0] / K[0, 0]), float(sigmas[1] / K[1, 1]))
    return _camera(size, K, D, 4, fisheye=True), rotations, translations, focal_sigma


def _camera(
    size: tuple[int, int], K: Any, D: Any, count: int, *, fisheye: bool = False
) -> CameraModel:
    """Return a camera from OpenCV's matrices, with the first `count` distortion coefficients."""
    fx, fy, cx, cy = (float(K[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    distortion = tuple(float(k) for k in D.flat[:count])
    return CameraModel(*size, fx, fy, cx, cy, distortion, fisheye)


# ---- the verdict -------------------------------------------------------------------------------


def too_poor(views: Sequence[View], size: tuple[int, int]) -> list[str]:
    """Return what is missing in the views for a calibration, in lines; empty: nothing."""
    if len(views) < FEWEST_VIEWS:
        return [f"{len(views)} views of the board, at least {FEWEST_VIEWS} are needed"]
    covered = coverage(views, size)
    if covered.sum() < _FEWEST_CELLS:
        return [
            f"corners in {covered.sum()} of {covered.size} parts of the picture, at least "
            f"{_FEWEST_CELLS} are needed: bring the board into the {_where(~covered)} too"
        ]
    return []


def not_trusted(result: Calibration, views: Sequence[View]) -> list[str]:
    """Return the reasons not to fly with a calibration, in lines; empty: it is good."""
    reasons = []
    tilted = sum(tilt >= _TILTED_DEG for tilt in result.tilts_deg)
    if tilted < _FEWEST_TILTED:
        reasons.append(
            f"{tilted} views from aside (tilted by {_TILTED_DEG:.0f} degrees or more), at least "
            f"{_FEWEST_TILTED} are needed: from straight ahead focal length and distance look alike"
        )
    if result.error_px > _LARGEST_ERROR_PX:
        worst = max(range(len(views)), key=lambda i: result.errors_px[i])
        reasons.append(
            f"reprojection error {result.error_px:.2f} px, at most {_LARGEST_ERROR_PX:g} is "
            f"allowed; worst: {views[worst].name}, {result.errors_px[worst]:.2f} px. Is the board "
            "flat, its size right, the focus fixed, nothing blurred?"
        )
    if result.focal_sigma > _LARGEST_FOCAL_SIGMA:
        reasons.append(
            f"the focal length is only known to {100 * result.focal_sigma:.2f} % (1 sigma), "
            f"{100 * _LARGEST_FOCAL_SIGMA:g} % are needed: more views, more tilted, nearer"
        )
    return reasons


def outliers(result: Calibration) -> list[int]:
    """Return the indices of views that fit much worse than the others."""
    limit = _OUTLIER_RATIO * float(np.median(result.errors_px))
    return [i for i, error in enumerate(result.errors_px) if error > limit and error > 0.3]


def _where(cells: NDArray[np.bool_]) -> str:
    """Return in words where in the picture most of the marked cells (rows, columns) are."""
    rows, columns = np.nonzero(cells)
    down, across = rows.mean() / (GRID[1] - 1) - 0.5, columns.mean() / (GRID[0] - 1) - 0.5
    words = []
    if abs(down) > 0.15:
        words.append("top" if down < 0 else "bottom")
    if abs(across) > 0.15:
        words.append("left" if across < 0 else "right")
    return " ".join(words) or "edges and corners"
