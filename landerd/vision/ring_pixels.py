"""The pixels near a ring's edges, and where their rays meet the plane of a pose."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.pad import Ring
from landerd.vision.arrays import F32, U8
from landerd.vision.patch import is_white_clipped, lens_grid
from landerd.vision.pose import circle, vec3
from landerd.vision.ring_pose import CirclePose, plane_frame

# Extent of a ring, px, below which it is supersampled: its edges are curved within the blur, which
# biased oblique distant rings.
_SMALL_PX = 36.0
# Width of the white around a ring, in its radii: the thesis's plate has 0.12 m round a ring of 1 m.
MARGIN = 0.24
# Contrast of what lies beyond the margin, in sigmas of the noise: it is unknown, and weights assume
# this.
_SURROUNDINGS_SIGMAS = 20.0
_MIN_WEIGHT = 0.02  # least weight of a pixel that is worth its time
_MIN_COUNT = 30  # least number of pixels: a fit has 12 to 15 parameters
_CORNERS = 64  # of an outline
# Constants of the functions that fits call most, as arrays (): numpy converts numbers, its own too,
# in each operation. Added to divisors against zero; least part of a ray along the normal.
_LEAST_RHO, _LEAST_LENGTH, _LEAST_M = (np.array(x, np.float32) for x in (1e-9, 1e-12, 1e-6))
# The normal distribution function and its density by hyperbolic tangent and exponential.
_CUBIC, _SLOPE, _HALF, _MINUS_HALF, _DENSITY = (
    np.array(x, np.float32) for x in (0.0356774081, 0.7978845608, 0.5, -0.5, 0.3989422804)
)


@dataclass(frozen=True)
class Pixels:
    """The pixels to which a ring is fitted."""

    rays: F32  # (x, y, 1), (3, n)
    grey: F32  # grey levels, (n,)
    weight: F32  # from 0 to 1, (n,)
    supersample: bool  # whether the ring is so small that each pixel is modelled by subpixels
    focal: float  # focal length, px: the geometric mean of both axes
    is_clipped: bool  # white is over full scale


def edge_pixels(
    camera: CameraModel, pose: CirclePose, radii: Sequence[float], count: int = _CORNERS
) -> F64:
    """Return points (radii, count, 2), px, on circles about a ring's centre in its plane.

    Args:
        camera: the lens.
        pose: of the ring.
        radii: of the circles, m.
        count: number of points on each.
    """
    position, normal = pose
    around = circle(1.0, count) @ np.array(plane_frame(vec3(normal))[:2])
    points = position + np.array(radii)[:, None, None] * around
    np.maximum(points[..., 2], 1e-3, out=points[..., 2])
    return camera.pixels(points).reshape(points.shape[0], count, 2)


def pixels_near(
    image: U8,
    camera: CameraModel,
    pose: CirclePose,
    ring: Ring,
    band_px: float,
    max_count: int,
    *,
    supersample: bool,
    dense: bool = False,
) -> Pixels | None:
    """Return the pixels near both edges of a ring; None: too few are in the image.

    Args:
        image: grey image (height, width).
        camera: the lens.
        pose: of the ring.
        ring: its true size and ratio.
        band_px: largest distance of a pixel from an edge.
        max_count: largest number of pixels, about.
        supersample: whether a small ring is to be fitted with subpixels.
        dense: whether twice as many are returned.
    """
    times = 2 if dense else 1
    max_count *= times
    edges = edge_pixels(camera, pose, _radii(ring), times * _CORNERS)
    size = float((edges[0].max(axis=0) - edges[0].min(axis=0)).max())
    if not size <= 4.0 * max(image.shape):
        return None
    if size < _SMALL_PX:
        seen = _around(image, camera, edges[0], band_px)
    else:
        seen = _across(image, camera, edges, band_px, max_count)
    if seen is None:
        return None
    v, levels = seen
    focal = camera.focal
    near, weight = _weighted(v, focal, pose, ring, band_px)
    near = near[:: len(near) // max_count + 1]
    if len(near) < _MIN_COUNT:
        return None
    is_small = supersample and size < _SMALL_PX
    grey = levels[near]
    is_clipped = is_white_clipped(grey)
    return Pixels(v[:, near], grey.astype(np.float32), weight[near], is_small, focal, is_clipped)


def _weighted(
    v: F32, focal: float, pose: CirclePose, ring: Ring, band_px: float
) -> tuple[NDArray[np.intp], F32]:
    """Return the indices of rays (3, n) that meet the plane near a ring's edges, and all weights.

    The weights are (n,); `band_px` is the largest distance from an edge.
    """
    g = PlaneView(v, focal, *pose_axes(pose))
    d_o, d_i = ((g.rho[0] - r) / g.scale[0] for r in _radii(ring))
    # Share of a pixel's light that comes from beyond the white margin, where anything may lie.
    z = (d_o - MARGIN * ring.radius_m / g.scale[0]) / max(0.7, band_px / 3.0)
    beyond = _normal_cdf(z, z * z)
    weight: F32 = 1.0 / (1.0 + (_SURROUNDINGS_SIGMAS * beyond) ** 2)
    is_near = (d_o < band_px) & ((d_o > -band_px) | (np.abs(d_i) < band_px))
    return np.flatnonzero(is_near & (weight > _MIN_WEIGHT)), weight


def _radii(ring: Ring) -> tuple[float, float]:
    """Return the outer and the inner radius, m."""
    return ring.radius_m, ring.radius_m * ring.inner_ratio


def _around(image: U8, camera: CameraModel, edge: F64, band_px: float) -> tuple[F32, U8] | None:
    """Return rays (3, n) and grey levels (n,) of all pixels of the box round an outline.

    The outline (count, 2), px, is widened by `band_px`. None: too few are in the image.
    """
    h, w = image.shape
    low = np.maximum(np.floor(edge.min(axis=0) - band_px), 0).astype(int)
    high = np.minimum(np.ceil(edge.max(axis=0) + band_px) + 1, (w, h)).astype(int)
    columns, rows = np.maximum(high - low, 0).tolist()
    if columns * rows < _MIN_COUNT:
        return None
    box = image[low[1] : high[1], low[0] : high[0]]
    return lens_grid(camera, low, (columns, rows), 1).astype(np.float32), box.reshape(-1)


def _across(
    image: U8, camera: CameraModel, edges: F64, band_px: float, max_count: int
) -> tuple[F32, U8] | None:
    """Return rays (3, n) and grey levels (n,) of pixels on short lines across closed outlines.

    None: too few are in the image.

    Args:
        image: grey image (height, width).
        camera: the lens.
        edges: the outlines, px, (outlines, count, 2).
        band_px: length of a line to either side of its outline.
        max_count: largest number of pixels, about.
    """
    step = max(1.0, band_px / 4.0)
    offsets = np.arange(-band_px, band_px + 0.5 * step, step)
    corners = edges.shape[1]
    count = min(corners, int(max_count / (len(edges) * len(offsets))))
    at = np.arange(count) * corners // count
    along = edges[:, (at + 1) % corners] - edges[:, at - 1]
    normal = along[..., ::-1] * (-1.0, 1.0)
    normal *= (1.0 / (np.sqrt((normal * normal).sum(axis=-1)) + 1e-12))[..., None]
    lines = edges[:, at][..., None, :] + offsets[:, None] * normal[..., None, :]
    p = np.rint(lines).reshape(-1, 2).astype(np.intp)
    h, w = image.shape
    p = p[(p[:, 0] >= 0) & (p[:, 0] < w) & (p[:, 1] >= 0) & (p[:, 1] < h)]
    if len(p) < _MIN_COUNT:
        return None
    v = np.ones((3, len(p)), dtype=np.float32)
    v[:2] = camera.rays(p.astype(np.float64)).T
    return v, image[p[:, 1], p[:, 0]]


def plane_axes(t: Sequence[Vec3], normal: Sequence[Vec3]) -> tuple[F32, F32]:
    """Return centres (starts, 3), m, and plane axes (starts, 3, 3) as `PlaneView` takes them.

    Args:
        t: centres, camera frame, m.
        normal: unit normals, camera frame.
    """
    flat = [x for n in normal for axis in plane_frame(n) for x in axis]
    return np.array(t, dtype=np.float32), np.array(flat, dtype=np.float32).reshape(-1, 3, 3)


def pose_axes(pose: CirclePose) -> tuple[F32, F32]:
    """Return the same of one pose: (1, 3) and (1, 3, 3)."""
    return plane_axes([vec3(pose[0])], [vec3(pose[1])])


class PlaneView:
    """Where rays meet the planes of several poses of a ring, and the derivatives there.

    Attributes, (starts, n) unless said otherwise: `m`, the rays' part along the normal; `depth`, of
    the points where the rays meet the plane, m; `rho`, distance of these points from the ring's
    centre, m; `u`, (starts, 3, n), the negative derivative of rho by a shift of the centre on the
    plane's axes; `a`, its third row with the opposite sign; `gradient`, (starts, 2, n), of rho by
    the rays' x and y, over the depth; `length`, of the gradient; `scale`, metres of the plane per
    px across the lines of equal rho.
    """

    def __init__(self, v: F32, focal: float, t: F32, axes: F32) -> None:
        """Compute the view.

        Args:
            v: rays (x, y, 1), (3, n) or (starts, 3, n).
            focal: focal length, px.
            t: centres of the ring, camera frame, m, (starts, 3).
            axes: of the planes in the camera frame, (starts, 3, 3): two tangents and the normal,
                one in each row.
        """
        self.v, self.focal, self.axes, self.t = v, focal, axes, t
        along = axes @ v
        self.m = np.maximum(along[:, 2], _LEAST_M)
        centre = (axes @ t[:, :, None])[:, :, 0]
        off = centre[:, 2:]
        self.depth = off / self.m
        q = along[:, :2] * self.depth[:, None]
        q -= centre[:, :2, None]
        self.rho = _length(q)
        self.rho += _LEAST_RHO
        # Unit vector u from the centre, and a: d rho = (a n - u) . dt and d rho = -a rho u . dn.
        # Stacked as (u, -a) they are -d rho / dt on the plane's axes.
        self.u = np.empty_like(along)
        np.divide(q, self.rho[:, None], out=self.u[:, :2])
        self.a = ((centre[:, None, :2] @ self.u[:, :2])[:, 0] + self.rho) / off
        np.negative(self.a, out=self.u[:, 2])
        self.gradient = axes[:, :, :2].transpose(0, 2, 1) @ self.u  # of rho on z = 1, over depth
        self.length = _length(self.gradient)
        self.length += _LEAST_LENGTH
        # Metres in the plane per pixel, across the level lines of rho.
        self.scale = self.length * self.depth
        self.scale *= np.float32(1.0 / focal)

    def across(self) -> F32:
        """Return the unit vectors (starts, 2, n) along which rho rises fastest in the image."""
        unit: F32 = self.gradient / self.length[:, None]
        return unit

    def curvature(self) -> tuple[F32, F32]:
        """Return the plane's area in a pixel, m^2, and rho'' / (2 rho'), 1/px.

        The derivatives are those across a line of equal rho in the image, px. With M the metric of
        the plane in pixels, rho^2 = p^T M p: the area is the root of det M, the curvature of the
        line is det M / (rho g^3), and rho'' is (w^T M w - g^2) / rho, with g the `scale` and w the
        unit gradient.
        """
        across = self.across()
        nw = (self.axes[:, 2:, :2] @ across)[:, 0] / self.m
        k = self.depth / self.focal
        e = nw[:, None] * self.v
        e[:, :2] -= across
        excess = np.maximum(k * k * (e * e).sum(axis=1) - self.scale * self.scale, 0.0)
        return k * k / self.m, excess / (2.0 * self.rho * self.scale)

    def foot(self, d: F32, radii: F32) -> tuple[F32, F32]:
        """Return the pixels' distances to two circles, and `scale`, by the circles' nearest points.

        These distances are more exact than those measured at the pixels.

        Args:
            d: signed distances measured at the pixels, px, (starts, 2, n).
            radii: of the circles, m, (2, 1).

        Returns:
            signed distances, px, and metres per px, both (starts, 2, n).
        """
        d = np.clip(d, -3.0, 3.0)
        count, _, n = d.shape
        across = self.across()
        v = np.broadcast_to(self.v, (count, 3, n))[:, :, None] + np.zeros((2, 1), np.float32)
        v[:, :2] -= (d / self.focal)[:, None] * across[:, :, None]
        near = PlaneView(v.reshape(count, 3, -1), self.focal, self.t, self.axes)
        scale = near.scale.reshape(count, 2, n)
        turn = (near.across().reshape(count, 2, 2, n) * across[:, :, None]).sum(axis=1)
        return (near.rho.reshape(count, 2, n) - radii) / scale + d * turn, scale


def _length(way: F32) -> F32:
    """Return the lengths (starts, n) of vectors (starts, 2, n)."""
    square = way * way
    length: F32 = square[:, 0] + square[:, 1]
    np.sqrt(length, out=length)
    return length


def sectors(x: NDArray[np.floating], y: NDArray[np.floating], count: int) -> NDArray[np.intp]:
    """Return the sector round the origin in which each point (n,) lies, from 0 to `count` - 1."""
    turns = np.arctan2(y, x) * (count / math.tau)
    sector: NDArray[np.intp] = np.floor(turns).astype(np.intp) % count
    return sector


def blurred_step(z: F32) -> tuple[F32, F32]:
    """Return the standard normal distribution function (to 3e-4) and its density.

    That is a step blurred by a Gaussian, `z` sigmas from it, and its derivative.
    """
    square = z * z
    cdf = _normal_cdf(z, square)
    square *= _MINUS_HALF
    density: F32 = np.exp(square, out=square)
    density *= _DENSITY
    return cdf, density


def _normal_cdf(z: F32, square: F32) -> F32:
    """Return the first of `blurred_step`, given the square of z too."""
    cdf: F32 = square * _CUBIC
    cdf += _SLOPE
    cdf *= z
    np.tanh(cdf, out=cdf)
    cdf *= _HALF
    cdf += _HALF
    return cdf


def shifted(pixels: Pixels, shift_px: F64) -> F32:
    """Return the rays (starts, 3, parts * n) of pixels (n,) moved by (starts, 2, parts) px."""
    count, _, parts = shift_px.shape
    v = np.empty((count, 3, parts, pixels.rays.shape[1]), dtype=np.float32)
    v[:] = pixels.rays[:, None]
    v[:, :2] += (shift_px / pixels.focal).astype(np.float32)[..., None]
    return v.reshape(count, 3, -1)
