"""Camera intrinsics and lens distortion, as ROS, OpenCV and Kalibr describe them in YAML.

Pixel (0, 0) is the centre of the top-left pixel. Rays are (x, y) on the plane z = 1 of the camera
frame (x right, y down, z forward).
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from landerd.section import read_mapping

F64 = NDArray[np.float64]

_FISHEYE = ("equidistant", "fisheye")  # ROS's name, and the one that is used too
_LENGTHS = {  # of distortion_coefficients
    "plumb_bob": {0, 4, 5},
    "rational_polynomial": {8},
    **{name: {4} for name in _FISHEYE},
}
# Ends the search for a ray: OpenCV's own five rounds leave up to a hundred pixels with wide lenses.
_INVERSE = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-6)  # rounds, px
_HARD = 0.95  # of an iteration's error is left by the next
_NEWTON_ROUNDS, _NEWTON_STEP = 8, 0.1  # and how far a ray is moved at most
_FOUND_PX = 1e-3  # within it a pixel's ray comes back to it if it was found
_MOST_BAD = 0.02  # share of the image: far corners, where boards seldom were, are left out
_MOST_PX, _MOST = 65_535, 1e9  # of a picture's side; and of any other number
# Of a side: how far off the middle the principal point may lie. Of 112 public calibrations five are
# of another size than they say, four of them beyond; all others lie within 0.19.
_MOST_ASIDE = 0.22
# Of the longer side, and of one another: focal lengths, from a lens of 160 degrees to one of 3.
_FOCAL, _UNLIKE = (0.12, 20.0), 1.5
_GRID = (65, 49)  # columns and rows of pixels that are tried
_CUTS = 200  # a side of what is used moves inwards by this part of the image at a time
_WIDEST = 20.0  # tangent of the angle up to which it is looked for where a distortion folds
_BEYOND_FOLD = 0.25  # pixels to a focal length and a tangent, outwards
# What programs that save with OpenCV's FileStorage call ROS's keys, in small letters.
_OPENCV_KEYS = {
    "camera_matrix": ("cameramatrix", "camera_matrix", "k", "intrinsic_matrix"),
    "distortion_coefficients": (
        "distcoeffs",
        "dist_coeff",
        "dist_coeffs",
        "distortion_coefficients",
        "distortion_coeffs",
        "distcoeff",
        "d",
    ),
    "image_width": ("image_width", "imagewidth", "width"),
    "image_height": ("image_height", "imageheight", "height"),
}


def _distorted(k: tuple[float, ...], fisheye: bool, x: F64, y: F64) -> tuple[F64, F64]:
    """Return what a lens with coefficients k makes of rays x and y (n,) on z = 1.

    Formulas of OpenCV's `projectPoints`, which works out all derivatives besides: with it
    projecting took a fifth of the time of a search.
    """
    if not k:
        return x, y
    xx, yy = x * x, y * y
    square = xx + yy
    if fisheye:
        tangent = np.sqrt(square)
        angle = np.arctan(tangent)
        s = angle * angle
        bent = angle * (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))))
        scale = bent / np.maximum(tangent, 1e-12)
        return np.where(tangent > 1e-8, x * scale, x), np.where(tangent > 1e-8, y * scale, y)
    k1, k2, p1, p2, k3, k4, k5, k6 = (*k, *(0.0,) * (8 - len(k)))
    radial = 1.0 + square * (k1 + square * (k2 + square * k3 if k3 else k2))
    if len(k) > 5:
        radial /= 1.0 + square * (k4 + square * (k5 + square * k6))
    both = 2.0 * x * y
    return (
        x * radial + p1 * both + p2 * (square + 2.0 * xx),
        y * radial + p2 * both + p1 * (square + 2.0 * yy),
    )


@lru_cache
def _fold(k: tuple[float, ...], fisheye: bool) -> float:
    """Return the tangent of the angle from the axis beyond which a lens turns back, or inf."""
    if not k:
        return math.inf
    tangent = np.geomspace(1e-2, _WIDEST, 400)
    fold = math.inf
    for angle in np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False):
        x, y = _distorted(k, fisheye, tangent * math.cos(angle), tangent * math.sin(angle))
        turns = np.flatnonzero(~(np.diff(np.hypot(x, y)) > 0.0))
        fold = min(fold, float(tangent[turns[0]]) if len(turns) else math.inf)
    return fold


@lru_cache
def _hard(k: tuple[float, ...], fisheye: bool) -> float:
    """Return the tangent of the angle beyond which OpenCV may not find the ray, or inf.

    Its iteration divides by the radial factor g of the ray before: that converges while
    |r g'(r)| < g(r).
    """
    if fisheye:
        return math.inf
    k1, k2, _, _, k3, k4, k5, k6 = (*k, *([0.0] * 8))[:8]
    r = np.linspace(0.01, _WIDEST, 4000)
    g = np.polyval([k3, k2, k1, 1.0], r * r) / np.polyval([k6, k5, k4, 1.0], r * r)
    hard = np.abs(r * np.gradient(g, r)) > _HARD * np.abs(g)
    return float(r[np.argmax(hard)]) if hard.any() else math.inf


class Window(NamedTuple):
    """Pixels of an image: columns x0 to x1 and rows y0 to y1, the ends not included."""

    x0: int
    y0: int
    x1: int
    y1: int

    def within(self, width: int, height: int) -> "Window":
        """Return the part of the window that lies in an image; may be empty."""
        x0, y0 = min(max(self.x0, 0), width), min(max(self.y0, 0), height)
        return Window(x0, y0, min(max(self.x1, x0), width), min(max(self.y1, y0), height))


class CalibrationError(Exception):
    """A calibration file cannot be used; the text names file, key and what was expected."""


@dataclass(frozen=True)
class CameraModel:
    """Pinhole camera with plumb_bob (5), rational (8) or no distortion; or a fisheye (4).

    The fisheye is Kannala and Brandt's, ROS's "equidistant": an angle a from the axis is imaged at
    the radius f (a + k1 a^3 + k2 a^5 + k3 a^7 + k4 a^9).
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()  # k1 k2 p1 p2 k3 [k4 k5 k6]; fisheye: k1 k2 k3 k4
    fisheye: bool = False

    # Both are made once, as every call of `rays` needs them.
    @cached_property
    def K(self) -> F64:  # noqa: N802 - the field's name for it
        """Intrinsic matrix, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @cached_property
    def D(self) -> F64:  # noqa: N802
        """Distortion coefficients in OpenCV's order, (n,)."""
        return np.array(self.distortion, dtype=np.float64)

    @property
    def focal(self) -> float:
        """Focal length, px: the geometric mean of both."""
        return math.sqrt(self.fx * self.fy)

    def rays(self, pixels: F64) -> F64:
        """Return undistorted rays (n, 2) on z = 1 for distorted pixels (n, 2)."""
        points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        undistort = cv2.fisheye.undistortPoints if self.fisheye else cv2.undistortPoints
        undistorted = undistort(points, self.K, self.D, criteria=_INVERSE)
        rays = cast(F64, undistorted).reshape(-1, 2)
        x, y = rays.T
        hard = x * x + y * y > _hard(self.distortion, self.fisheye) ** 2
        if hard.any():
            rays[hard] = self._by_newton(rays[hard], points.reshape(-1, 2)[hard])
        return rays

    def _by_newton(self, rays: F64, pixels: F64) -> F64:
        """Return rays (n, 2) of pixels (n, 2) by Newton's iteration from nearby ones."""
        for _ in range(_NEWTON_ROUNDS):
            p = np.column_stack([rays, np.ones(len(rays))])
            at, J = cv2.projectPoints(p, np.zeros(3), np.zeros(3), self.K, self.D)
            # A shift at the distance 1 is one of the ray.
            a, b, c, d = J[:, 3:5].reshape(-1, 4).T
            e, f = (pixels - cast(F64, at).reshape(-1, 2)).T
            det = a * d - b * c
            step = (
                np.stack([d * e - b * f, a * f - c * e], axis=1) / np.where(det, det, 1.0)[:, None]
            )
            rays = rays + np.clip(step, -_NEWTON_STEP, _NEWTON_STEP)
        return rays

    def pixels(self, points: F64) -> F64:
        """Return distorted pixels (n, 2) of points (n, 3) in the camera frame, z > 0.

        Far outside of the picture a distortion turns back: its polynomial would put what lies
        there into the picture. From there on pixels go outwards all the same.
        """
        p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
        fold = _fold(self.distortion, self.fisheye)
        square = x * x + y * y
        if not (square > fold * fold).any():
            return self._imaged(*_distorted(self.distortion, self.fisheye, x, y))
        beyond = np.maximum(np.sqrt(square) / fold, 1.0)
        x, y = x / beyond, y / beyond
        on_fold = self._imaged(*_distorted(self.distortion, self.fisheye, x, y))
        out = np.column_stack([self.fx * x, self.fy * y]) * (_BEYOND_FOLD * (beyond - 1.0))[:, None]
        pixels: F64 = on_fold + out
        return pixels

    def _imaged(self, x: F64, y: F64) -> F64:
        """Return the pixels (n, 2) of distorted rays (n,) each."""
        pixels = np.empty((len(x), 2))
        np.add(x * self.fx, self.cx, out=pixels[:, 0])
        np.add(y * self.fy, self.cy, out=pixels[:, 1])
        return pixels

    def seeing(self, window: Window) -> "CameraModel":
        """Return the camera that sees no more than a window of the image."""
        x0, y0, x1, y1 = window
        return replace(self, width=x1 - x0, height=y1 - y0, cx=self.cx - x0, cy=self.cy - y0)

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
        return self.resized(width, height, width / self.width)

    def resized(self, width: int, height: int, k: float) -> "CameraModel":
        """Return the same lens before pixels that are k times as many along a line."""
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * k,
            fy=self.fy * k,
            # Pixel centres, not edges, are whole numbers.
            cx=(self.cx + 0.5) * k - 0.5,
            cy=(self.cy + 0.5) * k - 0.5,
        )


def load_camera(path: Path) -> CameraModel:
    """Read a calibration: ROS `camera_info`, OpenCV's FileStorage or Kalibr's camchain, all YAML.

    Raises:
        CalibrationError: unreadable, a key missing or of another shape, unknown distortion model,
            or no lens: its principal point or the inverse of its distortion not in the image.
    """
    expected = "a calibration: ROS camera_info, OpenCV's FileStorage or Kalibr's camchain"
    if path.suffix.lower() == ".xml":
        raise CalibrationError(f"{path}: XML is not read; expected {expected}, as YAML")
    data = read_mapping(path, CalibrationError, expected)
    ros = _in_ros_words(path, data)
    if not data.keys() & {"cam0"} and not ros.keys() & {"image_width", "camera_matrix"}:
        raise CalibrationError(f"{path}: expected {expected}")
    camera = _of_kalibr(path, data) if "cam0" in data else _of_ros(path, ros)
    _check_lens(path, camera)
    return camera


def _of_ros(path: Path, data: dict[str, Any]) -> CameraModel:
    width = _whole(path, data, "image_width")
    height = _whole(path, data, "image_height")
    k = _numbers(path, data, "camera_matrix", {9})
    model = data.get("distortion_model", "plumb_bob")
    lengths = _LENGTHS.get(str(model))
    if lengths is None:
        raise CalibrationError(
            f"{path}: distortion_model: found {model!r}, expected one of {', '.join(_LENGTHS)}"
        )
    d = _numbers(path, data, "distortion_coefficients", lengths)
    if k[0] <= 0 or k[4] <= 0:
        raise CalibrationError(f"{path}: camera_matrix: focal lengths must be above 0")
    if k[1] or k[3] or k[6:] != (0.0, 0.0, 1.0):
        raise CalibrationError(f"{path}: camera_matrix: expected [fx 0 cx; 0 fy cy; 0 0 1]")
    return CameraModel(width, height, k[0], k[4], k[2], k[5], d, str(model) in _FISHEYE)


def _in_ros_words(path: Path, data: dict[str, Any]) -> dict[str, Any]:
    """Return OpenCV's FileStorage with the keys of ROS; what has them already as it is.

    OpenCV writes the coefficients in a row or a column, zeros at the end included (12 or 14, then,
    whatever the model is called), and calls the keys as the program that called it liked.

    Raises:
        CalibrationError: one thing is given twice, or four coefficients of an unnamed model.
    """
    words = {name: key for key, names in _OPENCV_KEYS.items() for name in names}
    given, data = data, {}
    for said, value in given.items():
        key = words.get(str(said).lower(), said)
        if data.get(key, value) != value:
            raise CalibrationError(f"{path}: {said}: {key} is given already, otherwise")
        data[key] = value
    for key in ("camera_matrix", "distortion_coefficients"):
        if isinstance(data.get(key), list):  # a ROS message, or written without OpenCV
            data[key] = {"data": _flat(data[key])}
    block = data.get("distortion_coefficients")
    values = block.get("data") if isinstance(block, dict) else None
    if not isinstance(values, list):
        return data
    if "distortion_model" in data and (
        len(values) <= max(_LENGTHS["rational_polynomial"])
        or str(data["distortion_model"]) in _FISHEYE
    ):
        return data
    if data.get("fisheye_model") in (1, True):
        return {**data, "distortion_model": _FISHEYE[0]}
    while len(values) > 5 and values[-1] == 0:
        values = values[:-1]
    if len(values) in (6, 7):
        values = values + [0.0] * (8 - len(values))
    if len(values) == 4 and any(values):  # OpenCV's fisheye lenses have four, and some others
        named = ", ".join(name for name, lengths in _LENGTHS.items() if 4 in lengths)
        raise CalibrationError(f"{path}: four coefficients; add distortion_model: one of {named}")
    model = "rational_polynomial" if len(values) == 8 else "plumb_bob"
    return {**data, "distortion_coefficients": {"data": values}, "distortion_model": model}


def _flat(values: list[Any]) -> list[Any]:
    """Return the numbers of a list, or of its rows."""
    return [v for row in values for v in (row if isinstance(row, list) else [row])]


def _of_kalibr(path: Path, data: dict[str, Any]) -> CameraModel:
    """Return the only camera of Kalibr's camchain.

    Its radtan is plumb_bob without k3.
    """
    if "cam1" in data:
        raise CalibrationError(f"{path}: holds several cameras; keep the block of one, as cam0")
    block = data["cam0"]
    block = block if isinstance(block, dict) else {}
    models = {"radtan": "plumb_bob", "equidistant": _FISHEYE[0], "none": "plumb_bob"}
    kind, distortion = block.get("camera_model"), block.get("distortion_model")
    if kind != "pinhole" or not isinstance(distortion, str) or distortion not in models:
        raise CalibrationError(
            f"{path}: cam0: found {kind!r} with {distortion!r}, "
            f"expected pinhole with one of {', '.join(models)}"
        )
    size, inner = block.get("resolution"), block.get("intrinsics")
    if not (isinstance(size, list) and len(size) == 2):
        raise CalibrationError(f"{path}: cam0.resolution: expected [width, height]")
    if not (isinstance(inner, list) and len(inner) == 4):
        raise CalibrationError(f"{path}: cam0.intrinsics: expected [fx, fy, cx, cy]")
    fx, fy, cx, cy = inner
    ros = {
        "image_width": size[0],
        "image_height": size[1],
        "camera_matrix": {"data": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]},
        "distortion_model": models[distortion],
        "distortion_coefficients": {"data": block.get("distortion_coeffs", [])},
    }
    return _of_ros(path, ros)


def _check_lens(path: Path, camera: CameraModel) -> None:
    """Refuse a calibration whose rays are not those of its pixels.

    Raises:
        CalibrationError: principal point or focal lengths are none of a lens before an image of
            that size, or too many pixels have no ray of their own: the distortion folds.
    """
    size = f"{camera.width}x{camera.height}"
    aside = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
    if aside > _MOST_ASIDE:
        raise CalibrationError(
            f"{path}: principal point {camera.cx:.0f}, {camera.cy:.0f} is {aside:.0%} of a side "
            f"off the middle of the image of {size}: is it calibrated for another size?"
        )
    least, most = (share * max(camera.width, camera.height) for share in _FOCAL)
    fx, fy = camera.fx, camera.fy
    if not (least < fx < most and least < fy < most and 1.0 / _UNLIKE < fx / fy < _UNLIKE):
        raise CalibrationError(
            f"{path}: focal lengths {fx:.4g}, {fy:.4g} are no lens's before an image of {size}: "
            f"expected two of {least:.0f} to {most:.0f} px that are alike"
        )
    across = np.linspace(0.0, camera.width - 1.0, _GRID[0])
    down = np.linspace(0.0, camera.height - 1.0, _GRID[1])
    bad = _without_ray(camera, across, down[:, None])
    if bad > _MOST_BAD:
        other = "a lens of at most 160 degrees" if camera.fisheye else "the fisheye model"
        raise CalibrationError(
            f"{path}: distortion has no inverse in {bad:.1%} of the image: calibrate "
            f"with the board in its corners too, or with {other}"
        )


@lru_cache
def used_part(camera: CameraModel) -> Window:
    """Return the part of the image in which the ray of every pixel comes back to it.

    What a distortion folds reaches the image's edge. So a rectangle without such a pixel on its
    sides has none inside; the side with the largest share of them moves inwards until none is.
    """
    x0, y0, x1, y1 = 0, 0, camera.width, camera.height
    step = max(1, max(x1, y1) // _CUTS)
    while x1 - x0 > step and y1 - y0 > step:
        x, y = np.arange(x0, x1), np.arange(y0, y1)
        sides = ((x0, y), (x, y0), (x1 - 1, y), (x, y1 - 1))
        bad = [_without_ray(camera, *side) for side in sides]
        worst = bad.index(max(bad))
        if bad[worst] == 0.0:
            break
        cut = [step if worst == side else 0 for side in range(4)]
        x0, y0, x1, y1 = x0 + cut[0], y0 + cut[1], x1 - cut[2], y1 - cut[3]
    return Window(x0, y0, x1, y1)


def left_out(camera: CameraModel) -> str | None:
    """Return what is to be said of the part of the image that is not used; None: all of it is."""
    x0, y0, x1, y1 = used_part(camera)
    cuts = {"left": x0, "upper": y0, "right": camera.width - x1, "lower": camera.height - y1}
    edges = ", ".join(edge for edge, px in cuts.items() if px > 0)
    if not edges:
        return None
    share = 1.0 - (x1 - x0) * (y1 - y0) / (camera.width * camera.height)
    return (
        f"distortion has no inverse everywhere at the image's edge ({edges}): {share:.1%} of it "
        "there are left out, what they show is not believed"
    )


def _without_ray(camera: CameraModel, x: ArrayLike, y: ArrayLike) -> float:
    """Return the share of pixels, x and y broadcast, whose ray does not come back to them."""
    at = np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2).astype(np.float64)
    rays = camera.rays(at)
    back = camera.pixels(np.column_stack([rays, np.ones(len(rays))]))
    return float(np.mean(~(np.hypot(*(back - at).T) < _FOUND_PX)))


def camera_info(camera: CameraModel, name: str) -> str:
    """Return a calibration as the text of a ROS `camera_info` YAML file."""
    model = "plumb_bob"
    if camera.fisheye:
        model = _FISHEYE[0]
    elif len(camera.distortion) > 5:
        model = "rational_polynomial"
    focal_x, focal_y, x, y = map(_in_yaml, (camera.fx, camera.fy, camera.cx, camera.cy))
    distortion = ", ".join(map(_in_yaml, camera.distortion))
    return f"""\
image_width: {camera.width}
image_height: {camera.height}
camera_name: {name}
camera_matrix:
  rows: 3
  cols: 3
  data: [{focal_x}, 0.0, {x}, 0.0, {focal_y}, {y}, 0.0, 0.0, 1.0]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {len(camera.distortion)}
  data: [{distortion}]
"""


def _in_yaml(value: float) -> str:
    text = f"{value:.8g}"
    # To YAML a number without a point is none when it has an exponent.
    return text if "." in text else text.replace("e", ".0e")


def _whole(path: Path, data: dict[str, Any], key: str) -> int:
    value = data.get(key)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 < value <= _MOST_PX:
        found = "missing" if value is None else f"found {value!r:.40}"
        raise CalibrationError(
            f"{path}: {key}: {found}, expected pixels, a whole number of at most {_MOST_PX}"
        )
    return value


def _numbers(path: Path, data: dict[str, Any], key: str, lengths: set[int]) -> tuple[float, ...]:
    block = data.get(key)
    values = block.get("data") if isinstance(block, dict) else None
    ok = isinstance(values, list) and all(
        isinstance(v, (int, float)) and not isinstance(v, bool) and abs(v) < _MOST for v in values
    )
    if not ok or len(cast(list[float], values)) not in lengths:
        wanted = " or ".join(str(n) for n in sorted(lengths))
        raise CalibrationError(f"{path}: {key}.data: expected a list of {wanted} finite numbers")
    return tuple(float(v) for v in cast(list[float], values))
