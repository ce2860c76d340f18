"""How bright a picture shows the pad, or else the ground: what its exposure goes by."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.messages import CLIPPED_LEVEL, Light, PoseSolution
from landerd.pad import Plate
from landerd.vision.expected import any_across
from landerd.vision.pose import MIN_DEPTH_M, circle, rotation_from

# Of the levels on the plate. White covers more than half of any pad, so this is white even where
# a third of it lies in shadow, and below a spot of glare.
_WHITE_PERCENTILE = 90.0
_SAMPLES = 64  # a side
_LEAST_SAMPLES = 30  # on the plate
_LEAST_DIP = 0.05  # sine of the angle below the horizon from which on the ground is seen
_LEAST_GROUND = 0.1  # share of the picture


class Meter:
    """Measures the brightness of one camera's pictures of one pad and what lies round it."""

    def __init__(self, camera: CameraModel, plate: Plate) -> None:
        """Prepare a grid of samples, and the lines of sight through them."""
        self._camera, self._plate = camera, plate
        self._step = max(1, min(camera.width, camera.height) // _SAMPLES)
        self._columns = np.arange(self._step // 2, camera.width, self._step)
        self._rows = np.arange(self._step // 2, camera.height, self._step)
        at = np.stack(np.meshgrid(self._columns, self._rows), axis=-1).reshape(-1, 2)
        rays = np.column_stack([camera.rays(at.astype(np.float64)), np.ones(len(at))])
        self._rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def light(self, image: NDArray[np.uint8], pad: PoseSolution | None, down: Vec3 | None) -> Light:
        """Return the brightness of the plate's white, or without a pad that of the ground.

        Args:
            image: (height, width).
            pad: its pose, camera frame; None: not seen.
            down: unit vector of gravity, camera frame: tells the ground from the sky.
        """
        if pad is not None:
            white = _white(image, self._camera, _outline(self._plate, pad))
            if white is not None:
                return Light(white, on_pad=True)
        ground = self._ground(down)
        levels = image[np.ix_(self._rows, self._columns)].ravel()[ground]
        # Every pixel counts: a far pad covers no more than a few samples.
        full = cv2.threshold(image, CLIPPED_LEVEL - 1.0, 255.0, cv2.THRESH_BINARY)[1]
        size = (len(self._columns), len(self._rows))
        cells = cv2.resize(full, size, interpolation=cv2.INTER_AREA).ravel()[ground]
        return Light(float(np.median(levels)), False, float(cells.mean()) / 255.0)

    def _ground(self, down: Vec3 | None) -> NDArray[np.bool_]:
        """Tell which samples (n,) show the ground: all, if little of it is in sight."""
        everywhere = np.ones(len(self._rays), dtype=np.bool_)
        if down is None:
            return everywhere
        below: NDArray[np.bool_] = self._rays @ np.array(down) > _LEAST_DIP
        return below if float(below.mean()) > _LEAST_GROUND else everywhere


def _outline(plate: Plate, pad: PoseSolution) -> F64:
    """Return points (n, 3) round the plate, without north round what is surely on it."""
    normal = np.array(pad.normal)
    if pad.north is None:
        reach = min(plate.north_m, plate.south_m, plate.east_m, plate.west_m)
        R, flat = rotation_from(normal, any_across(normal)), circle(reach)
    else:
        n, s, e, w = plate.north_m, -plate.south_m, plate.east_m, -plate.west_m
        R, flat = (
            rotation_from(normal, np.array(pad.north)),
            np.array([[n, w], [n, e], [s, e], [s, w]]),
        )
    points: F64 = np.array(pad.position) + flat @ R[:, :2].T
    return points


def _white(image: NDArray[np.uint8], camera: CameraModel, outline: F64) -> float | None:
    """Return the level of white within an outline (n, 3); None: too little of it is in sight."""
    if float(outline[:, 2].min()) < MIN_DEPTH_M:
        return None
    px = camera.pixels(outline)
    if not np.isfinite(px).all():
        return None
    low = np.maximum(np.floor(px.min(axis=0)), 0.0).astype(int)
    high = np.minimum(np.ceil(px.max(axis=0)) + 1, (camera.width, camera.height)).astype(int)
    if (high - low < 1).any():
        return None
    step = max(1, math.ceil(int((high - low).max()) / _SAMPLES))
    part = image[low[1] : high[1] : step, low[0] : high[0] : step]
    corners = np.clip((px - low) / step, -1e4, 1e4)
    mask = np.zeros(part.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint(corners).astype(np.int32), 1)
    levels = part[mask > 0]
    if levels.size < _LEAST_SAMPLES:
        return None
    return float(np.percentile(levels, _WHITE_PERCENTILE))
