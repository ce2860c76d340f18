"""Camera intrinsics and lens distortion, as ROS `camera_info` YAML describes them.

Pixel (0, 0) is the centre of the top-left pixel. Rays are (x, y) on the plane z = 1 of the camera
frame (x right, y down, z forward).
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

F64 = NDArray[np.float64]


class CalibrationError(Exception):
    """A calibration file cannot be used; the text names file, key and what was expected."""


@dataclass(frozen=True)
class CameraModel:
    """Pinhole camera with plumb_bob (5), rational (8) or no distortion."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()  # k1 k2 p1 p2 k3 [k4 k5 k6]

    @property
    def K(self) -> F64:  # noqa: N802 - the field's name for it
        """Intrinsic matrix, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def D(self) -> F64:  # noqa: N802
        """Distortion coefficients in OpenCV's order, (n,)."""
        return np.array(self.distortion, dtype=np.float64)

    def rays(self, pixels: F64) -> F64:
        """Return undistorted rays (n, 2) on z = 1 for distorted pixels (n, 2)."""
        points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        undistorted = cv2.undistortPoints(points, self.K, self.D)
        return cast(F64, undistorted).reshape(-1, 2)

    def pixels(self, points: F64) -> F64:
        """Return distorted pixels (n, 2) of points (n, 3) in the camera frame, z > 0."""
        p = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 1, 3)
        projected, _ = cv2.projectPoints(p, np.zeros(3), np.zeros(3), self.K, self.D)
        return cast(F64, projected).reshape(-1, 2)

    def scaled(self, width: int, height: int) -> "CameraModel":
        """Return the same lens read out at another size of the same aspect.

        Raises:
            CalibrationError: the aspect differs.
        """
        if width * self.height != height * self.width:
            raise CalibrationError(
                f"calibrated for {self.width}x{self.height}, images are {width}x{height}: "
                "another aspect, calibrate for this size"
            )
        k = width / self.width
        return CameraModel(
            width,
            height,
            self.fx * k,
            self.fy * k,
            # Pixel centres, not edges, are whole numbers.
            (self.cx + 0.5) * k - 0.5,
            (self.cy + 0.5) * k - 0.5,
            self.distortion,
        )


def load_camera(path: Path) -> CameraModel:
    """Read a ROS `camera_info` YAML file.

    Raises:
        CalibrationError: unreadable, a key missing or of another shape, unknown distortion model.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as e:
        reason = e.strerror if isinstance(e, OSError) else "not text"
        raise CalibrationError(f"{path}: cannot be read: {reason}") from None
    except yaml.YAMLError as e:
        mark = getattr(e, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        raise CalibrationError(f"{path}{line}: not YAML") from None
    if not isinstance(data, dict):
        raise CalibrationError(f"{path}: expected a ROS camera_info mapping")
    width = _whole(path, data, "image_width")
    height = _whole(path, data, "image_height")
    k = _numbers(path, data, "camera_matrix", {9})
    model = data.get("distortion_model", "plumb_bob")
    lengths = {"plumb_bob": {0, 4, 5}, "rational_polynomial": {8}}.get(str(model))
    if lengths is None:
        raise CalibrationError(
            f"{path}: distortion_model: found {model!r}, expected plumb_bob or rational_polynomial"
        )
    d = _numbers(path, data, "distortion_coefficients", lengths)
    if k[0] <= 0 or k[4] <= 0:
        raise CalibrationError(f"{path}: camera_matrix: focal lengths must be above 0")
    if k[1] or k[3] or k[6:] != (0.0, 0.0, 1.0):
        raise CalibrationError(f"{path}: camera_matrix: expected [fx 0 cx; 0 fy cy; 0 0 1]")
    return CameraModel(width, height, k[0], k[4], k[2], k[5], d)


def _whole(path: Path, data: dict[str, Any], key: str) -> int:
    value = data.get(key)
    if not isinstance(value, int) or isinstance(value, bool) or value <= 0:
        raise CalibrationError(f"{path}: {key}: found {value!r}, expected pixels, a whole number")
    return value


def _numbers(path: Path, data: dict[str, Any], key: str, lengths: set[int]) -> tuple[float, ...]:
    block = data.get(key)
    values = block.get("data") if isinstance(block, dict) else None
    ok = isinstance(values, list) and all(
        isinstance(v, (int, float)) and not isinstance(v, bool) and math.isfinite(v) for v in values
    )
    if not ok or len(cast(list[float], values)) not in lengths:
        wanted = " or ".join(str(n) for n in sorted(lengths))
        raise CalibrationError(f"{path}: {key}.data: expected a list of {wanted} finite numbers")
    return tuple(float(v) for v in cast(list[float], values))
