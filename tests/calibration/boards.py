"""Pictures of boards by a camera with a known lens, drawn ray by ray."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel

SQUARE_M = 0.03
MARKER_M = 0.022
_TEXTURE = 48  # pixels a square
_FINE = 3  # rays a pixel, each way


@dataclass(frozen=True)
class Pose:
    """Where the board's middle is, and how it is turned, camera frame."""

    x: float  # m
    y: float
    z: float
    pitch_deg: float
    yaw_deg: float
    roll_deg: float


def chessboard(columns: int, rows: int) -> NDArray[np.uint8]:
    """Return a picture of a chessboard with this many inner corners and a margin of one square."""
    board = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2 * 255
    board = np.pad(board, 1, constant_values=255).astype(np.uint8)
    return np.asarray(np.kron(board, np.ones((_TEXTURE, _TEXTURE), np.uint8)))


def charuco(columns: int, rows: int) -> NDArray[np.uint8]:
    """Return a picture of a ChArUco board with this many squares and a margin of one square."""
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((columns, rows), SQUARE_M, MARKER_M, markers)
    image = board.generateImage((columns * _TEXTURE, rows * _TEXTURE))
    return np.pad(np.asarray(image, np.uint8), _TEXTURE, constant_values=255)


@cache
def _rays(camera: CameraModel) -> NDArray[np.float32]:
    """Return a camera's rays, a column each, row by row of a finer picture."""
    shape = (camera.height * _FINE, camera.width * _FINE)
    v, u = np.mgrid[: shape[0], : shape[1]]
    pixels = (np.stack([u, v], axis=-1).reshape(-1, 2) + 0.5) / _FINE - 0.5
    return np.vstack([camera.rays(pixels).T, np.ones(len(pixels))]).astype(np.float32)


class Photographer:
    """Takes pictures with one camera."""

    def __init__(self, camera: CameraModel) -> None:
        self._shape = (camera.height * _FINE, camera.width * _FINE)
        self._rays = _rays(camera)
        self._noise = np.random.default_rng(1)

    def shoot(self, texture: NDArray[np.uint8], pose: Pose) -> NDArray[np.uint8]:
        """Return a picture of the board with a little noise."""
        R = rotation(pose)
        centre = np.array([pose.x, pose.y, pose.z])
        x, y, z = (R.T.astype(np.float32) @ self._rays).reshape(3, *self._shape)
        middle_x, middle_y, distance = centre @ R
        scale = _TEXTURE / SQUARE_M
        with np.errstate(divide="ignore", invalid="ignore"):
            k = np.float32(scale * distance) / z  # pixels of the board's a metre of the ray
            u = x * k + np.float32(0.5 * texture.shape[1] - 0.5 - scale * middle_x)
            v = y * k + np.float32(0.5 * texture.shape[0] - 0.5 - scale * middle_y)
        u[k <= 0.0] = -1.0
        fine = np.asarray(cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderValue=128))
        height, width = self._shape[0] // _FINE, self._shape[1] // _FINE
        image = fine.reshape(height, _FINE, width, _FINE).mean(axis=(1, 3))
        image = 20.0 + 0.8 * image + self._noise.normal(0.0, 2.0, image.shape)
        return np.asarray(np.clip(np.rint(image), 0, 255), np.uint8)


def wide_views(distance_m: float, most_deg: float) -> list[Pose]:
    """Return poses of a board at a distance, all over a wide picture, facing the camera, tilted."""
    poses = []
    directions = [(across, down) for down in (-1.0, 0.0, 1.0) for across in (-1.0, 0.0, 1.0)]
    for i, (across, down) in enumerate([*directions, (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)]):
        a, e = math.radians(most_deg * across), math.radians(0.75 * most_deg * down)
        x, y, z = math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)
        tilt = (20.0, -20.0)[i % 2]
        pose = Pose(
            distance_m * x,
            distance_m * y,
            distance_m * z,
            -0.75 * most_deg * down + tilt,
            most_deg * across - tilt,
            10.0 * (i % 3 - 1),
        )
        poses.append(pose)
    return poses


def shoot(
    folder: Path, camera: CameraModel, texture: NDArray[np.uint8], poses: Sequence[Pose]
) -> None:
    """Fill a folder with pictures of a board."""
    photographer = Photographer(camera)
    folder.mkdir(exist_ok=True)
    for i, pose in enumerate(poses):
        cv2.imwrite(str(folder / f"{i:02}.png"), photographer.shoot(texture, pose))


def rotation(pose: Pose) -> NDArray[np.float64]:
    """Return R_camera_board."""
    axes = ((1, 0, 0), pose.pitch_deg), ((0, 1, 0), pose.yaw_deg), ((0, 0, 1), pose.roll_deg)
    R = np.eye(3)
    for axis, angle in axes:
        R = R @ np.asarray(cv2.Rodrigues(np.array(axis) * math.radians(angle))[0])
    return R


def good_views(camera: CameraModel, width_m: float, height_m: float) -> list[Pose]:
    """Return poses that bring the board to all edges of the picture, tilted to all sides."""
    z = 1.0 * max(width_m * camera.fx / camera.width, height_m * camera.fy / camera.height) / 0.55
    poses = []
    grid = [(across, down) for down in (-1, 0, 1) for across in (-1, 0, 1)]
    for i, (across, down) in enumerate([*grid, (0, 0), (0, 0), (0, 0)]):
        pitch = (-30.0, 0.0, 30.0)[i % 3] if i < 9 else (20.0, -35.0, 8.0)[i - 9]
        yaw = (25.0, -30.0, 10.0, -15.0)[i % 4]
        free_x = 0.5 * z * camera.width / camera.fx - 0.5 * width_m
        free_y = 0.5 * z * camera.height / camera.fy - 0.5 * height_m
        poses.append(
            Pose(0.75 * across * free_x, 0.75 * down * free_y, z, pitch, yaw, 15.0 * (i % 3 - 1))
        )
    return poses
