"""How bright a picture shows the pad, or else the ground: what its exposure goes by."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.messages import Light, PoseSolution
from landerd.pad import Plate
from landerd.vision.expected import any_across
from landerd.vision.pose import MIN_DEPTH_M, circle, rotation_from

# Of the levels on the plate. White covers more than half of any pad, so this is white even where
# a third of it lies in shadow, and below a spot of glare.
_WHITE_PERCENTILE = 90.0
_SAMPLES = 64  # a side
_LEAST_SAMPLES = 30  # on the plate


def light(
    image: NDArray[np.uint8], camera: CameraModel, plate: Plate, pad: PoseSolution | None
) -> Light:
    """Return the brightness of the plate's white, or without a pad of the picture's ground.

    Args:
        image: (height, width).
        camera: the lens.
        plate: the pad's.
        pad: its pose, camera frame; None: not seen.
    """
    if pad is not None:
        white = _white(image, camera, _outline(plate, pad))
        if white is not None:
            return Light(white, on_pad=True)
    step = max(1, min(image.shape) // _SAMPLES)
    return Light(float(np.median(image[::step, ::step])), on_pad=False)


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
