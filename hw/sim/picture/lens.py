"""The true lens of the simulated camera: errors of its calibration, vignetting and dirt."""

from dataclasses import replace
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import CalibrationErrorOptions
from landerd.camera_model import CameraModel

F32 = NDArray[np.float32]

SPOTS = 10  # number of spots of dirt
# Least and largest radius of a spot, share of the image's width: a drop on a lens is far out of
# focus.
SPOT_RADII = (0.02, 0.12)


def true_camera(believed: CameraModel, error: CalibrationErrorOptions) -> CameraModel:
    """Return the true camera.

    Args:
        believed: the camera as it was calibrated.
        error: differences of the true camera from that.
    """
    right, down = error.principal_px
    return replace(
        believed,
        fx=believed.fx * (1.0 + error.focal),
        fy=believed.fy * (1.0 + error.focal),
        cx=believed.cx + right,
        cy=believed.cy + down,
        distortion=tuple(d * (1.0 + error.distortion) for d in believed.distortion),
    )


def vignetting(camera: CameraModel, loss: float) -> F32:
    """Return the share of light (height, width) that reaches each pixel through the lens.

    It follows the cosine-fourth law, 1 / (1 + r^2 / f^2)^2 at radius r.

    Args:
        camera: its size and principal point.
        loss: share of light lost in the corner farthest from the principal point, below 1, which
            determines f.
    """
    x = np.arange(camera.width) - camera.cx
    y = np.arange(camera.height) - camera.cy
    r2 = np.add.outer(y * y, x * x)
    k = (1.0 - loss) ** -0.5 - 1.0
    return cast(F32, ((1.0 + k * r2 / r2.max()) ** -2).astype(np.float32))


def dirt(width: int, height: int, loss: float, rng: np.random.Generator) -> F32:
    """Return the share of light (height, width) that passes soft round spots of dirt on the lens.

    Args:
        width: of the image, px.
        height: of the image, px.
        loss: share of light lost in the middle of the thickest spot, 0 to 1.
        rng: places and sizes of the spots.
    """
    passed = np.ones((height, width), np.float32)
    x, y = np.arange(width)[None, :], np.arange(height)[:, None]
    thickness = rng.uniform(0.2, 1.0, SPOTS)
    for share in thickness / thickness.max():
        radius = rng.uniform(*SPOT_RADII) * width
        r2 = (x - rng.uniform(0.0, width)) ** 2 + (y - rng.uniform(0.0, height)) ** 2
        spot = np.clip(1.5 - np.sqrt(r2) / radius, 0.0, 1.0)  # flat to half a radius
        cv2.min(passed, (1.0 - loss * share * spot).astype(np.float32), dst=passed)
    return passed
