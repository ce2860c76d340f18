"""The pixels of a planar marker, where their rays meet its plane, and tests of what is in view.

`marker_patch` chooses the pixels to which `print_fit` fits a print. The rest is shared by most of
vision: intersections with a plane, grey levels at points, rays of a grid of pixels.
"""

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

_CORNERS = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]])  # of a square of side 2
_MAX_SIDE_PX = 30.0  # the image of a larger marker is reduced to about this side
_MIN_SIDE_PX = 4  # least sides of the box round a marker, px of the reduced image
_MIN_COUNT = 50  # least number of pixels: a fit has 11 parameters
_LENS_NODES = 5  # along each axis, at which the lens's map is computed
_NODES = np.linspace(0.0, 1.0, _LENS_NODES)
# Blur of a sharp lens, sigma 0.6 px, and of a pixel's own box: variances, px^2.
_LENS_BLUR, _BOX_BLUR = 0.36, 1.0 / 12.0
# Weights, along each axis, of a reduced pixel's halves and of its neighbours' nearest ones, and the
# blur of that: nearly a Gaussian, as which the model takes it.
_WEIGHTS = np.array([1.0, 3.0, 3.0, 1.0]) / 8.0
_REDUCED_BLUR = 3.0 / 16.0 + _BOX_BLUR / 4.0
# Error of the corners, in fitted pixels, by what lens model, light and sampling leave out; chosen
# so that the stated 95 % regions of `bench.vision_square` hold about 95 %.
_EDGE_BIAS_PX = 0.006
# The same by reducing the image, for each of its pixels along a fitted one: no lens blurs like a
# Gaussian, and no light is quite linear.
_REDUCED_BIAS_PX = 0.001

# Grey level at which models are clipped; noise darkens what is clipped.
FULL_SCALE = 254.5
# First contrast of a fit beside clipped white, over that of the clipped levels.
WHITE_START = 2.0
# White is over full scale if more than a share of the pixels is at least this bright: noise and
# JPEG lower some. A mean of clipped pixels is not that of the light: of a large marker some single
# pixels are fitted then, up to so many on edges and off them. A pixel is on an edge if its
# neighbours differ by so many grey levels.
CLIPPED = 253
_CLIPPED_SHARE = 0.05
_MOST_ON_EDGES, _MOST_OFF_EDGES, _EDGE_STEP = 1000, 200, 30
_NEIGHBOURS = np.ones((3, 3), np.uint8)
# Error of the corners then, px: the samples of a print are not much finer than the pixels.
_SINGLE_BIAS_PX = 0.02


@dataclass(frozen=True)
class Patch:
    """The pixels a marker is fitted to; each is a mean of a square of the image's pixels.

    Where white is clipped, they are the image's own, and of a large marker's only some.
    """

    grey: F64  # grey levels, (n,)
    rays: F64  # homogeneous, z = 1, (3, n)
    x: F64  # of the rays, centred and divided by their range: about -0.5 to 0.5, (n,)
    y: F64  # likewise
    pixel: float  # width of a pixel on the plane z = 1
    blur: float  # variance to start from, pixels^2: of a sharp lens and the pixel's weights
    bias: float  # error of the corners that residuals do not show, pixels, with a sharp lens
    reduction: int  # number of the image's pixels along a side of one of these, if not clipped
    is_clipped: bool  # white is over full scale

    @property
    def is_thinned(self) -> bool:
        """Whether these are some of the image's own pixels, instead of means."""
        return self.is_clipped and self.reduction > 1


def marker_patch(
    image: Image,
    camera: CameraModel,
    pose: Pose,
    reach: float,
    is_used: Callable[[F64, F64], Mask],
    reduction: int | None = None,
    white: float = math.inf,
) -> Patch | None:
    """Return the pixels that show a marker under a pose; None: too few, or it is behind the lens.

    The image of a large marker is reduced or, where white is clipped, thinned, which saves time.

    Args:
        image: grey image (height, width).
        camera: the lens.
        pose: of the marker, camera frame.
        reach: half the side of the square about the marker's centre that is considered, m.
        is_used: tells which points of the marker's plane are used, by north and east, m, (n,) each.
        reduction: number of pixels along a side that become one; None: chosen by the marker's size.
        white: width of the white beyond the reach that no pixel may look across, m.
    """
    outline = pose.points(_CORNERS * reach)
    if outline[:, 2].min() < MIN_DEPTH_M:
        return None
    px = camera.pixels(outline)
    low = np.maximum(np.floor(px.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(px.max(axis=0)) + 1, (camera.width, camera.height)).astype(int)
    widest = white * camera.focal / max(float(pose.t[2]), MIN_DEPTH_M)
    reduce = reduction or _reduction(px, low, high, widest)
    box = image[low[1] : high[1], low[0] : high[0]]
    is_clipped = is_white_clipped(box)
    step = 1 if is_clipped else reduce
    size = (int(high[0] - low[0]) // step, int(high[1] - low[1]) // step)
    if min(size) < _MIN_SIDE_PX:
        return None
    crop = box[: size[1] * step, : size[0] * step]
    chosen, bias = None, math.hypot(_EDGE_BIAS_PX, _REDUCED_BIAS_PX * reduce)
    if is_clipped and reduce > 1:
        chosen, bias = _thinned(crop), _SINGLE_BIAS_PX
        grey = crop.reshape(-1)[chosen].astype(np.float64)
    else:
        grey = (_reduced(crop, size) if step > 1 else crop.astype(np.float64)).reshape(-1)
    rays = lens_grid(camera, low, size, step, chosen)
    inside = is_used(*on_plane(rays, pose))
    if np.count_nonzero(inside) < _MIN_COUNT:
        return None
    rays = rays.compress(inside, axis=1)  # rows in one piece, unlike those of rays[:, inside]
    return Patch(
        grey=grey[inside],
        rays=rays,
        x=_normalised(rays[0]),
        y=_normalised(rays[1]),
        pixel=step / camera.focal,
        blur=_LENS_BLUR / step**2 + (_BOX_BLUR if step == 1 else _REDUCED_BLUR),
        bias=bias,
        reduction=reduce,
        is_clipped=is_clipped,
    )


def is_white_clipped(grey: Image) -> bool:
    """Tell whether white is over full scale by grey levels of any shape."""
    return bool(np.count_nonzero(grey >= CLIPPED) > _CLIPPED_SHARE * grey.size)


def _thinned(crop: Image) -> NDArray[np.intp]:
    """Return the indices (n,), row by row, of a few pixels of an image, most of them on edges."""
    step = cv2.morphologyEx(crop, cv2.MORPH_GRADIENT, _NEIGHBOURS).reshape(-1)
    on, off = np.flatnonzero(step >= _EDGE_STEP), np.flatnonzero(step < _EDGE_STEP)
    few = on[:: 1 + len(on) // _MOST_ON_EDGES], off[:: 1 + len(off) // _MOST_OFF_EDGES]
    return np.concatenate(few)


def _reduced(crop: Image, size: tuple[int, int]) -> F64:
    """Return an image reduced to a size (width, height).

    Of plain means of squares the Gaussian model misplaces edges that lie along the rows or columns,
    all of a print alike: by a thirtieth of a reduced pixel, many times what is stated.
    """
    halves = cv2.resize(crop, (2 * size[0], 2 * size[1]), interpolation=cv2.INTER_AREA)
    means = cv2.sepFilter2D(halves, cv2.CV_64F, _WEIGHTS, _WEIGHTS, anchor=(1, 1))
    return np.asarray(means[::2, ::2], dtype=np.float64)


def _reduction(px: F64, low: NDArray[np.int_], high: NDArray[np.int_], widest: float) -> int:
    """Return the number of pixels along a side that become one.

    Args:
        px: corners (4, 2) of the square that is considered, px.
        low: top left corner (2,) of the box round them within the image, px.
        high: its bottom right corner, likewise.
        widest: number that is not exceeded, unless that takes more than four times the pixels.
    """
    width, height = (high - low).tolist()
    in_image = float(max(width, 0) * max(height, 0))
    area = min(cv2.contourArea(px.astype(np.float32)), in_image)
    by_size = math.sqrt(area) / _MAX_SIDE_PX
    return max(1, round(max(min(by_size, widest), 0.5 * by_size)))


def on_plane(rays: F64, pose: Pose) -> tuple[F64, F64]:
    """Return north and east, m, (n,) each, of the points where rays meet a marker's plane.

    Args:
        rays: homogeneous, camera frame, (3, n).
        pose: of the marker, camera frame.
    """
    from_plane = pose.R.copy()
    from_plane[:, 2] = pose.t
    q = inverse(from_plane) @ rays
    return q[0] / q[2], q[1] / q[2]


def pose_slope(out: F64, pose: Pose, north: F64, east: F64, slope_n: F64, slope_e: F64) -> None:
    """Write the derivative of grey levels by (dt, w), both on the marker's own axes, into `out`.

    A point at `arm` from the marker's centre moves by m = dt + w x arm. The point that a fixed ray
    shows then moves on the marker, along its axis r, by -g . m, with
    g = r - normal (r . ray) / (normal . ray). On the marker's axes g and arm are simple.

    Args:
        out: (6, n), overwritten.
        pose: of the marker, camera frame.
        north: of the points on the marker, m, (n,).
        east: likewise.
        slope_n: derivative of the grey levels by north, 1/m, (n,).
        slope_e: the same by east.
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
    """Tell which points (n, 2) of the pad (north, east; m) lie on its plate."""
    north, east = points.T
    is_on = (north < plate.north_m) & (north > -plate.south_m)
    is_on &= (east < plate.east_m) & (east > -plate.west_m)
    return np.asarray(is_on)


def whole_in_picture(camera: CameraModel, points: F64) -> F64 | None:
    """Return points (n, 3), camera frame, m, as px (n, 2); None: not all are in the picture."""
    if float(points[:, 2].min()) < MIN_DEPTH_M:
        return None
    px = camera.pixels(points)
    is_whole = bool((px >= 0.0).all() and (px <= (camera.width - 1, camera.height - 1)).all())
    return px if is_whole else None


def is_any_in_picture(camera: CameraModel, points: F64) -> bool:
    """Tell whether at least one of points (n, 3), camera frame, m, is in the picture."""
    px = camera.pixels(points[points[:, 2] > MIN_DEPTH_M])
    return bool(((px >= 0.0) & (px <= (camera.width - 1, camera.height - 1))).all(axis=1).any())


def lens_grid(
    camera: CameraModel,
    low: NDArray[np.int_],
    size: tuple[int, int],
    step: int,
    chosen: NDArray[np.intp] | None = None,
) -> F64:
    """Return the homogeneous rays (3, n) of a grid of pixels, row by row.

    The lens's map is smooth: it is computed at a few nodes and interpolated by polynomials.

    Args:
        camera: the lens.
        low: column and row (2,) of the grid's top left pixel in the image.
        size: numbers of columns and rows of the grid.
        step: side of the square of the image's pixels that is one of the grid's.
        chosen: indices (n,) of those of its pixels that are returned; None: all are.
    """
    columns, rows = (
        first + (0.5 + (n - 1) * _NODES) * step - 0.5
        for first, n in zip(low.tolist(), size, strict=True)
    )
    nodes = np.empty((_LENS_NODES, _LENS_NODES, 2))
    nodes[..., 0] = columns
    nodes[..., 1] = rows[:, None]
    at = camera.rays(nodes.reshape(-1, 2)).T.reshape(2, _LENS_NODES, _LENS_NODES)
    along, down = _lagrange(size[0]), _lagrange(size[1])
    rays = np.empty((3, size[0] * size[1] if chosen is None else len(chosen)))
    rays[2] = 1.0
    if chosen is None:
        rays[:2] = (down @ at @ along.T).reshape(2, -1)
    else:
        row, column = np.divmod(chosen, size[0])
        rays[:2] = ((at @ along[column].T) * down[row].T).sum(axis=1)
    return rays


@lru_cache
def _lagrange(n: int) -> F64:
    """Return weights (n, nodes) of the polynomial through the nodes at n evenly spaced places."""
    powers = np.vander(np.linspace(-1.0, 1.0, _LENS_NODES), increasing=True)
    x = np.linspace(-1.0, 1.0, n)
    weights: F64 = np.vander(x, _LENS_NODES, increasing=True) @ np.asarray(np.linalg.inv(powers))
    return weights


def _normalised(x: F64) -> F64:
    """Return values (n,) less their mean, over their range."""
    centred: F64 = (x - x.sum() / len(x)) / max(float(x.max() - x.min()), 1e-9)
    return centred


def levels_at(image: Image, camera: CameraModel, points: F64) -> F64:
    """Return grey levels (n,) at points (n, 3), camera frame, m; NaN outside the image."""
    is_seen = points[:, 2] > MIN_DEPTH_M
    if not is_seen.all():
        points = np.where(is_seen[:, None], points, (0.0, 0.0, 1.0))
    px = camera.pixels(points)
    x, y = px.T
    h, w = image.shape
    is_seen &= (x >= 0.0) & (x <= w - 1) & (y >= 0.0) & (y <= h - 1)
    at = np.ascontiguousarray(px.T, dtype=np.float32)
    unseen = np.flatnonzero(~is_seen)
    at[:, unseen] = 0.0
    levels: F64 = cv2.remap(image, at[:1], at[1:], cv2.INTER_LINEAR)[0].astype(np.float64)
    levels[unseen] = np.nan
    return levels
