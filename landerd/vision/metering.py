"""Measures how bright a picture shows the pad, or else the ground.

The camera's exposure is controlled by it (`vision` reports it with the sightings).
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.messages import CLIPPED_LEVEL, Light, PoseSolution
from landerd.pad import Plate
from landerd.vision.patch import on_plate, whole_in_picture
from landerd.vision.plate_outline import plate_corners
from landerd.vision.pose import circle, rotation_from

# Percentile of the grey levels on the plate that counts as its white. White covers more than half
# of any pad, so that this is white even if a third of the pad lies in shadow, and is not that of a
# spot of glare.
_WHITE_PERCENTILE = 90.0
_SAMPLES = 64  # samples along a side, about
_LEAST_SAMPLES = 30  # samples on the plate, below which the ground is measured instead
_LEAST_DIP = 0.05  # sine of the angle below the horizon from which on a ray shows the ground
_LEAST_GROUND = 0.1  # share of the samples below the horizon, under which all samples are used


class Meter:
    """Measures the brightness of one camera's pictures of one pad and the ground about it."""

    def __init__(self, camera: CameraModel, plate: Plate) -> None:
        """Prepare a grid of sampled pixels, and their rays.

        Args:
            camera: the lens.
            plate: of the pad.
        """
        self._camera, self._plate = camera, plate
        self._step = max(1, min(camera.width, camera.height) // _SAMPLES)
        self._columns = np.arange(self._step // 2, camera.width, self._step)
        self._rows = np.arange(self._step // 2, camera.height, self._step)
        at = np.stack(np.meshgrid(self._columns, self._rows), axis=-1).reshape(-1, 2)
        rays = np.column_stack([camera.rays(at.astype(np.float64)), np.ones(len(at))])
        self._rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def light(self, image: NDArray[np.uint8], pad: PoseSolution | None, down: Vec3 | None) -> Light:
        """Return the brightness of the plate's white; of the ground, if too little plate is seen.

        Args:
            image: grey image (height, width).
            pad: pose of the pad, camera frame; None: it is not seen.
            down: unit vector of gravity, camera frame, which distinguishes ground from sky; None:
                unknown, all of the picture counts as ground.
        """
        if pad is not None:
            white = self._plate_levels(image, pad)
            if white.size >= _LEAST_SAMPLES:
                return Light(float(np.percentile(white, _WHITE_PERCENTILE)), on_pad=True)
        ground = self._ground(down)
        levels = image[np.ix_(self._rows, self._columns)].ravel()[ground]
        # Every pixel counts here, as a distant pad covers only a few samples.
        full = cv2.threshold(image, CLIPPED_LEVEL - 1.0, 255.0, cv2.THRESH_BINARY)[1]
        size = (len(self._columns), len(self._rows))
        cells = cv2.resize(full, size, interpolation=cv2.INTER_AREA).ravel()[ground]
        return Light(float(np.median(levels)), False, float(cells.mean()) / 255.0)

    def _plate_levels(self, image: NDArray[np.uint8], pad: PoseSolution) -> NDArray[np.uint8]:
        """Return grey levels (n,) of pixels that show the plate."""
        outline = whole_in_picture(self._camera, _outline(self._plate, pad))
        if outline is not None:
            return _within(image, outline)
        # A corner outside the picture may be behind the lens, and distortion bends the plate's
        # sides. The rays of the picture's own pixels are known.
        levels: NDArray[np.uint8] = image[np.ix_(self._rows, self._columns)].ravel()
        return levels[self._meets_plate(pad)]

    def _meets_plate(self, pad: PoseSolution) -> NDArray[np.bool_]:
        """Tell which samples (n,) show the plate.

        If its heading is unknown, only those that are on the plate under any heading.
        """
        normal, position = np.array(pad.normal), np.array(pad.position)
        across = self._rays @ normal
        is_ahead = across * float(position @ normal) > 0.0
        distance = float(position @ normal) / np.where(is_ahead, across, 1.0)
        offset = distance[:, None] * self._rays - position
        if pad.north is None:
            is_on = np.linalg.norm(offset, axis=1) < _sure_reach(self._plate)
        else:
            R = rotation_from(normal, np.array(pad.north))
            is_on = on_plate(self._plate, offset @ R[:, :2])
        meets: NDArray[np.bool_] = is_ahead & is_on
        return meets

    def _ground(self, down: Vec3 | None) -> NDArray[np.bool_]:
        """Tell which samples (n,) show the ground; all, if few do or gravity is unknown."""
        everywhere = np.ones(len(self._rays), dtype=np.bool_)
        if down is None:
            return everywhere
        below: NDArray[np.bool_] = self._rays @ np.array(down) > _LEAST_DIP
        return below if float(below.mean()) > _LEAST_GROUND else everywhere


def _sure_reach(plate: Plate) -> float:
    """Return the radius of the largest circle about the landing point on the plate, m."""
    return min(plate.north_m, plate.south_m, plate.east_m, plate.west_m)


def _outline(plate: Plate, pad: PoseSolution) -> F64:
    """Return points (n, 3), camera frame, m, on the outline of the plate.

    If its heading is unknown, on the largest circle that is on the plate under any heading.
    """
    normal = np.array(pad.normal)
    if pad.north is None:
        R, flat = rotation_from(normal), circle(_sure_reach(plate))
    else:
        R, flat = rotation_from(normal, np.array(pad.north)), plate_corners(plate)
    points: F64 = np.array(pad.position) + flat @ R[:, :2].T
    return points


def _within(image: NDArray[np.uint8], outline: F64) -> NDArray[np.uint8]:
    """Return grey levels (n,) within a convex outline (m, 2), px, that is all in the picture.

    Of a large outline only every few pixels are taken.
    """
    low = np.floor(outline.min(axis=0)).astype(int)
    high = np.ceil(outline.max(axis=0)).astype(int) + 1
    step = max(1, math.ceil(int((high - low).max()) / _SAMPLES))
    part = image[low[1] : high[1] : step, low[0] : high[0] : step]
    mask = np.zeros(part.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint((outline - low) / step).astype(np.int32), 1)
    levels: NDArray[np.uint8] = part[mask > 0]
    return levels
