"""The pixels of a planar marker, and where their rays meet its plane."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.pad import Plate
from landerd.vision.arrays import Image, Mask
from landerd.vision.linear import inverse
from landerd.vision.pose import MIN_DEPTH_M, Pose

_MAX_SIDE_PX = 30.0  # larger markers are fitted on a reduced image
_MIN_SIDE_PX = 4  # of the reduced box
_MIN_COUNT = 50  # pixels: a fit has 11 parameters
_LENS_NODES = 5
_NODES = np.linspace(0.0, 1.0, _LENS_NODES)
# Blur of a sharp lens, sigma 0.6 px, and of a pixel's own box: variances, px^2.
_LENS_BLUR, _BOX_BLUR = 0.36, 1.0 / 12.0
# What lens model, light and sampling leave out, as an error of the corners in fitted pixels, chosen
# so that the stated 95 % regions of `bench.vision_square` hold about 95 %.
_EDGE_BIAS_PX = 0.006
_REDUCED_BIAS_PX = 0.001  # and for each pixel of the image along a fitted one: no box is a Gaussian


@dataclass(frozen=True)
class Patch:
    """A marker's pixels, each perhaps the mean of a square of the image's."""

    grey: F64  # (n,)
    rays: F64  # homogeneous, (3, n)
    x: F64  # of the rays, from -0.5 to 0.5 or so about their mean, (n,)
    y: F64
    pixel: float  # width of one on the plane z = 1
    blur: float  # variance to start from, pixels^2: a sharp lens's spread and the pixel's box
    bias: float  # error of the corners that no residual shows, pixels, with a sharp lens
    reduction: int  # pixels of the image along one


def marker_patch(
    image: Image,
    camera: CameraModel,
    pose: Pose,
    reach: float,
    is_used: Callable[[F64, F64], Mask],
    reduction: int | None = None,
) -> Patch | None:
    """Return the marker's pixels under a pose, reduced if they are many; None if too few.

    Args:
        image: grey image (height, width).
        camera: the lens.
        pose: of the marker.
        reach: half the side of the square that holds all of interest, m.
        is_used: tells which points (north, east; (n,) each, m) of the plane are of interest.
        reduction: how many pixels along a side become one; None: as many as there should.
    """
    corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * reach
    outline = pose.points(corners)
    if outline[:, 2].min() < MIN_DEPTH_M:
        return None
    px = camera.pixels(outline)
    low = np.maximum(np.floor(px.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(px.max(axis=0)) + 1, (camera.width, camera.height)).astype(int)
    reduce = reduction or _reduction(px, low, high)
    size = (int(high[0] - low[0]) // reduce, int(high[1] - low[1]) // reduce)
    if min(size) < _MIN_SIDE_PX:
        return None
    crop = image[low[1] : low[1] + size[1] * reduce, low[0] : low[0] + size[0] * reduce]
    if reduce > 1:
        crop = np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    rays = lens_grid(camera, low, size, reduce)
    inside = is_used(*on_plane(rays, pose))
    if np.count_nonzero(inside) < _MIN_COUNT:
        return None
    rays = rays[:, inside]
    return Patch(
        grey=crop.reshape(-1)[inside].astype(np.float64),
        rays=rays,
        x=_normalised(rays[0]),
        y=_normalised(rays[1]),
        pixel=reduce / camera.focal,
        blur=_LENS_BLUR / reduce**2 + _BOX_BLUR,
        bias=math.hypot(_EDGE_BIAS_PX, _REDUCED_BIAS_PX * reduce),
        reduction=reduce,
    )


def _reduction(px: F64, low: NDArray[np.int_], high: NDArray[np.int_]) -> int:
    """Return how many pixels along a side become one, for an outline (4, 2) in a box."""
    in_image = float(np.prod(np.maximum(high - low, 0)))
    area = min(cv2.contourArea(px.astype(np.float32)), in_image)
    return max(1, round(math.sqrt(area) / _MAX_SIDE_PX))


def on_plane(rays: F64, pose: Pose) -> tuple[F64, F64]:
    """Return where homogeneous rays (3, n) meet the marker's plane: north and east, m, (n,)."""
    H = inverse(np.column_stack([pose.R[:, 0], pose.R[:, 1], pose.t]))
    q = H @ rays
    return q[0] / q[2], q[1] / q[2]


def pose_slope(out: F64, pose: Pose, north: F64, east: F64, slope_n: F64, slope_e: F64) -> None:
    """Write the derivative (6, n) of grey levels by (dt, w), both on the marker's own axes.

    At a fixed ray a plane moved by m = dt + w x arm carries the point -g . m along its axis r,
    g = r - normal (r . ray) / (normal . ray); in the marker's axes g and arm are plain.
    """
    t = pose.R.T @ pose.t
    lift = (slope_n * (north + t[0]) + slope_e * (east + t[1])) / t[2]
    np.negative(slope_n, out=out[0])
    np.negative(slope_e, out=out[1])
    out[2] = lift
    np.multiply(east, lift, out=out[3])
    np.multiply(north, -lift, out=out[4])
    np.subtract(east * slope_n, north * slope_e, out=out[5])


def on_plate(plate: Plate, points: F64) -> Mask:
    """Tell which points (n, 2) of the pad, its own axes, m, lie on its plate."""
    north, east = points.T
    is_on = (north < plate.north_m) & (north > -plate.south_m)
    is_on &= (east < plate.east_m) & (east > -plate.west_m)
    return np.asarray(is_on)


def whole_in_picture(camera: CameraModel, points: F64) -> F64 | None:
    """Return the pixels (n, 2) of points (n, 3), camera frame; None: not all are in the picture."""
    if float(points[:, 2].min()) < MIN_DEPTH_M:
        return None
    px = camera.pixels(points)
    is_whole = bool((px >= 0.0).all() and (px <= (camera.width - 1, camera.height - 1)).all())
    return px if is_whole else None


def is_any_in_picture(camera: CameraModel, points: F64) -> bool:
    """Tell whether one of points (n, 3), camera frame, is in the picture."""
    px = camera.pixels(points[points[:, 2] > MIN_DEPTH_M])
    return bool(((px >= 0.0) & (px <= (camera.width - 1, camera.height - 1))).all(axis=1).any())


def lens_grid(camera: CameraModel, low: NDArray[np.int_], size: tuple[int, int], step: int) -> F64:
    """Return the homogeneous rays (3, rows * columns) of a grid of pixels.

    The lens's map is smooth: it is computed at a few nodes and interpolated by polynomials.
    """
    columns, rows = (
        first + (0.5 + (n - 1) * _NODES) * step - 0.5
        for first, n in zip(low.tolist(), size, strict=True)
    )
    nodes = np.empty((_LENS_NODES, _LENS_NODES, 2))
    nodes[..., 0] = columns
    nodes[..., 1] = rows[:, None]
    at = camera.rays(nodes.reshape(-1, 2)).T.reshape(2, _LENS_NODES, _LENS_NODES)
    rays = np.ones((3, size[0] * size[1]))
    rays[:2] = (_lagrange(size[1]) @ at @ _lagrange(size[0]).T).reshape(2, -1)
    return rays


@lru_cache
def _lagrange(n: int) -> F64:
    """Return the weights (n, nodes) of polynomial interpolation at n even steps between nodes."""
    powers = np.vander(np.linspace(-1.0, 1.0, _LENS_NODES), increasing=True)
    x = np.linspace(-1.0, 1.0, n)
    weights: F64 = np.vander(x, _LENS_NODES, increasing=True) @ np.asarray(np.linalg.inv(powers))
    return weights


def _normalised(x: F64) -> F64:
    centred: F64 = (x - x.mean()) / max(float(x.max() - x.min()), 1e-9)
    return centred


def levels_at(image: Image, camera: CameraModel, points: F64) -> F64:
    """Return grey levels at points (n, 3), camera frame; NaN at those that are not in the image."""
    is_seen = points[:, 2] > MIN_DEPTH_M
    px = camera.pixels(np.where(is_seen[:, None], points, (0.0, 0.0, 1.0)))
    h, w = image.shape
    is_seen &= ((px >= 0.0) & (px <= (w - 1, h - 1))).all(axis=1)
    at = np.where(is_seen[:, None], px, 0.0).astype(np.float32)[None]
    grey = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR)[0]
    levels: F64 = np.where(is_seen, grey.astype(np.float64), np.nan)
    return levels
