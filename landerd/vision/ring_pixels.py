"""The pixels near a ring's edges, and where their rays meet the plane of a pose."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel
from landerd.vision.ring_pose import F64, Pose, tangents

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]  # of everything per pixel: half the time, and 1e-5 px is enough

_FINE_PX = 36.0  # below this size a ring's edges bend within a pixel
MARGIN = 0.24  # white around a ring, in radii: the thesis's plate has 0.12 m round its 1 m
_UNKNOWN = 30.0  # contrast of what lies beyond the margin, in sigmas of the noise


@dataclass(frozen=True)
class Pixels:
    """Grey levels (n,), the rays (x, y, 1) on which they were seen, and weights (n,)."""

    rays: F32  # (3, n)
    grey: F32
    trust: F32
    fine: bool  # small ring: look at each pixel in four places
    focal: float  # pixels per ray unit, geometric mean


def edge_pixels(camera: CameraModel, pose: Pose, radius: float, count: int = 48) -> F64:
    """Return pixels (count, 2) of a circle in the pad's plane."""
    position, normal = pose
    e1, e2 = tangents(normal)
    a = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)[:, None]
    points = position + radius * (np.cos(a) * e1 + np.sin(a) * e2)
    points[:, 2] = np.maximum(points[:, 2], 1e-3)
    return camera.pixels(points)


def pixels_near(
    image: U8,
    camera: CameraModel,
    pose: Pose,
    radius: float,
    ratio: float,
    band_px: float,
    most: int,
    fine: bool,
) -> Pixels | None:
    """Return the pixels within a band of both edges of a ring; None if too few are in the image.

    At most about `most` pixels are taken. With `fine`, small rings will be fitted with all care.
    """
    h, w = image.shape
    outer = edge_pixels(camera, pose, radius)
    low, high = outer.min(axis=0), outer.max(axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return None
    size = float((high - low).max())
    if size > 4.0 * max(h, w):
        return None
    if size < _FINE_PX:
        x0, y0 = np.maximum(np.floor(low - band_px), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(high + band_px), (w - 1, h - 1)).astype(int)
        gx, gy = np.meshgrid(np.arange(x0, x1 + 1), np.arange(y0, y1 + 1))
        p = np.column_stack([gx.ravel(), gy.ravel()])
    else:
        inner = edge_pixels(camera, pose, radius * ratio)
        p = np.concatenate(
            [_across(inner, band_px, 0.4 * most), _across(outer, band_px, 0.6 * most)]
        )
        p = p[(p[:, 0] >= 0) & (p[:, 0] < w) & (p[:, 1] >= 0) & (p[:, 1] < h)]
    if len(p) < 30:
        return None
    rays = camera.rays(p.astype(np.float64))
    focal = math.sqrt(camera.fx * camera.fy)
    grey = image[p[:, 1], p[:, 0]].astype(np.float32)
    v = np.ones((3, len(p)), dtype=np.float32)
    v[:2] = rays.T
    g = PlaneView(v, focal, *(a[None].astype(np.float32) for a in pose))
    d_o, d_i = (g.rho[0] - radius) / g.scale[0], (g.rho[0] - radius * ratio) / g.scale[0]
    # Light from beyond the plate's edge reaches this far in; what is there nobody knows.
    beyond, _ = blurred_step((d_o - MARGIN * radius / g.scale[0]) / max(0.7, band_px / 3.0))
    trust = 1.0 / (1.0 + (_UNKNOWN * beyond) ** 2)
    near = np.flatnonzero(
        (d_o < band_px) & ((d_o > -band_px) | (np.abs(d_i) < band_px)) & (trust > 0.02)
    )
    near = near[:: len(near) // most + 1]
    if len(near) < 30:
        return None
    return Pixels(v[:, near], grey[near], trust[near], fine and size < _FINE_PX, focal)


def _across(edge: F64, band_px: float, most: float) -> NDArray[np.intp]:
    """Return whole pixels (n, 2) on short lines across a closed outline."""
    step = max(1.0, band_px / 4.0)
    offsets = np.arange(-band_px, band_px + 0.5 * step, step)
    count = int(most / len(offsets))
    at = np.arange(count) * (len(edge) / count)
    i = at.astype(int)
    closed = np.vstack([edge, edge[:1]])
    along = closed[i + 1] - closed[i]
    p = closed[i] + (at - i)[:, None] * along
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    normal /= np.sqrt((normal * normal).sum(axis=1))[:, None] + 1e-12
    lines = p[:, None, :] + offsets[None, :, None] * normal[:, None, :]
    pixels: NDArray[np.intp] = np.rint(lines).reshape(-1, 2).astype(np.intp)
    return pixels


class PlaneView:
    """Rays v = (x, y, 1), (3, n) or (starts, 3, n), against the planes of several poses.

    Arrays are (starts, n), vectors (starts, 3, n).
    """

    def __init__(self, v: F32, focal: float, t: F32, normal: F32) -> None:
        self.v, self.focal, self.t, self.normal = v, focal, t, normal
        self.m = np.maximum((normal[:, None] @ v)[:, 0], 1e-6)
        self.depth = (normal * t).sum(axis=1)[:, None] / self.m
        q = self.depth[:, None] * v - t[:, :, None]
        self.rho = np.sqrt((q * q).sum(axis=1)) + 1e-9
        # Unit vector from the centre; d rho = (a n - u) . dt and d rho = -a rho u . dn.
        self.u = q / self.rho[:, None]
        self.a = (self.u * v).sum(axis=1) / self.m
        gradient = self.u[:, :2] - normal[:, :2, None] * self.a[:, None]
        length = np.sqrt((gradient * gradient).sum(axis=1)) + 1e-12
        self.across = gradient / length[:, None]  # unit gradient of rho in the image
        self.scale = length * self.depth / focal  # metres in the plane per pixel, across

    def bends(self) -> tuple[F32, F32]:
        """Return the plane's area in a pixel (m^2) and rho'' / (2 rho') across a level line (1/px).

        With M the metric of the plane in pixels, rho^2 = p^T M p: the root of det M is the area,
        the line's curvature det M / (rho g^3), and rho'' (w^T M w - g^2) / rho, w the unit
        gradient.
        """
        nw = (self.normal[:, :2, None] * self.across).sum(axis=1) / self.m
        k = self.depth / self.focal
        e = nw[:, None] * self.v
        e[:, :2] -= self.across
        excess = np.maximum(k * k * (e * e).sum(axis=1) - self.scale * self.scale, 0.0)
        return k * k / self.m, excess / (2.0 * self.rho * self.scale)

    def foot(self, d: F32, radii: F32) -> tuple[F32, F32]:
        """Return distances (px) to circles and g (m/px), (starts, 2, n), seen from their edges.

        `d` are first distances (starts, 2, n) to the circles of two radii.
        """
        d = np.clip(d, -3.0, 3.0)
        count, _, n = d.shape
        v = np.broadcast_to(self.v, (count, 3, n))[:, :, None] + np.zeros((2, 1), np.float32)
        v[:, :2] -= (d / self.focal)[:, None] * self.across[:, :, None]
        near = PlaneView(v.reshape(count, 3, -1), self.focal, self.t, self.normal)
        scale = near.scale.reshape(count, 2, n)
        turn = (near.across.reshape(count, 2, 2, n) * self.across[:, :, None]).sum(axis=1)
        return (near.rho.reshape(count, 2, n) - radii[:, None]) / scale + d * turn, scale


def blurred_step(z: F32) -> tuple[F32, F32]:
    """Return the normal distribution function (to 3e-4) and the density."""
    square = z * z
    half = np.float32(0.5)
    cdf: F32 = half + half * np.tanh(z * (0.7978845608 + 0.0356774081 * square))
    density: F32 = np.exp(-0.5 * square) * np.float32(0.3989422804)
    return cdf, density


def shifted(pixels: Pixels, shift_px: F64) -> F32:
    """Return the rays (starts, 3, parts n) of pixels moved by (starts, 2, parts) pixels."""
    count, _, parts = shift_px.shape
    v = np.repeat(pixels.rays[None, :, None], parts, axis=2).repeat(count, axis=0)
    v[:, :2] += (shift_px / pixels.focal).astype(np.float32)[..., None]
    return v.reshape(count, 3, -1)
