"""Fit of a ring's pose to the grey levels near its two edges.

The model of a pixel: its ray meets the pad's plane at a distance rho from the ring's centre; the
edges at rho = r_i and r_o are steps between three grey levels, blurred by a Gaussian and, where
asked for, by straight motion. Gauss-Newton on centre, normal, blur, motion, levels and light
gradient, with weights against what the model leaves out (occlusion, the plate's edge). Distances
are exact in the pad's plane, so neither perspective nor lens distortion bends them; two
corrections of second order make up for measuring them in pixels.

Several starts are fitted side by side: arrays have one row for each.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel
from landerd.vision.ring_pose import F64, Pose, tangents

F32 = NDArray[np.float32]  # of everything per pixel: half the time, and 1e-5 px is enough

U8 = NDArray[np.uint8]

_PARAMETERS = 13  # centre 3, normal 2, blur 1, motion 2, levels 3, light gradient 2
_ENOUGH = 0.2  # expected gain of chi-square by another step that is not worth it
_MIN_BLUR, _MAX_BLUR = 0.2, 12.0  # px
_FINE_PX = 36.0  # below this size the edges bend within a pixel: see fit_ring
_SPREAD_PX = 0.4  # of those places from the pixel's centre, along x and y
_MARGIN = 0.24  # white around a ring, in radii: the thesis's plate has 0.12 m round its 1 m
_UNKNOWN = 30.0  # contrast of what lies beyond the margin, in sigmas of the noise
_MIN_COS = 0.15  # of the tilt: flatter views than 81 degrees are not fitted


@dataclass(frozen=True)
class Pixels:
    """Grey levels (n,), the rays (x, y, 1) on which they were seen, and weights (n,)."""

    rays: F32  # (3, n)
    grey: F32
    trust: F32
    fine: bool  # small ring: look at each pixel in four places
    focal: float  # pixels per ray unit, geometric mean


@dataclass(frozen=True)
class RingFit:
    """A fitted ring, and how well it fits. Levels are grey levels at the ring's centre."""

    position: F64  # (3,), m
    normal: F64  # (3,), unit, away from the camera
    blur_px: float  # sigma
    motion_px: F64  # (2,) path of the image during exposure; its sign is arbitrary
    inside: float
    black: float
    outside: float
    noise: float  # robust sigma of the residuals, grey levels
    cost: float  # robust sum of squared residuals over noise^2
    inliers: float  # share of pixels within 3 sigma
    covariance: F64  # of position (3, 3), m^2
    sigma_tilt: float  # rad
    ratio: float  # inner over outer diameter as the pixels have it
    sigma_ratio: float

    @property
    def contrast(self) -> float:
        """Step from black to white, grey levels: the smaller of both edges."""
        return min(self.inside, self.outside) - self.black


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
    g = _Geometry(v, focal, *(a[None].astype(np.float32) for a in pose))
    d_o, d_i = (g.rho[0] - radius) / g.scale[0], (g.rho[0] - radius * ratio) / g.scale[0]
    # Light from beyond the plate's edge reaches this far in; what is there nobody knows.
    beyond, _ = _step((d_o - _MARGIN * radius / g.scale[0]) / max(0.7, band_px / 3.0))
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
    return np.rint(lines).reshape(-1, 2).astype(np.intp)


class _Geometry:
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
        near = _Geometry(v.reshape(count, 3, -1), self.focal, self.t, self.normal)
        scale = near.scale.reshape(count, 2, n)
        turn = (near.across.reshape(count, 2, 2, n) * self.across[:, :, None]).sum(axis=1)
        return (near.rho.reshape(count, 2, n) - radii[:, None]) / scale + d * turn, scale


def _step(z: F32) -> tuple[F32, F32]:
    """Return the normal distribution function (to 3e-4) and the density."""
    square = z * z
    cdf = 0.5 + 0.5 * np.tanh(z * (0.7978845608 + 0.0356774081 * square))
    return cdf, np.exp(-0.5 * square) * 0.3989422804


def fit_ring(
    pixels: Pixels,
    starts: Sequence[Pose],
    radius: float,
    ratio: float,
    blur_px: float,
    steps: int,
    motion_px: Sequence[F64] | None = None,
) -> list[RingFit]:
    """Return the fits from starts within about two pixels, best first; failed ones are left out.

    `motion_px` gives a first path (2,) of the image during exposure for every start; None: the
    image stood still.
    """
    grey = pixels.grey
    count, n = len(starts), len(grey)
    t = np.array([p for p, _ in starts])
    normal = np.array([v for _, v in starts])
    ordered = np.sort(grey)
    white, black = float(ordered[-1 - n // 8]), float(ordered[n // 8])
    p = np.tile([blur_px**2, 0.0, 0.0, white, black, white, 0.0, 0.0], (count, 1))
    radii = np.array([radius, radius * ratio], dtype=np.float32)
    spread = 0.0
    along = np.zeros(1)
    if motion_px is not None:
        p[:, 1:3] = motion_px
        parts = int(min(max(np.hypot(*p[:, 1:3].T).max() / 1.3, 3.0), 9.0))
        along = (np.arange(parts) + 0.5) / parts - 0.5
    elif pixels.fine:
        # Small rings bend within the blur. A Gaussian is nearly the mean of four narrower ones
        # set square around it, and for those the edges are straight enough.
        spread = _SPREAD_PX
        along = np.zeros(4)
    parts = len(along)
    corners = np.array([[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, -1.0, 1.0]])
    share = np.repeat(along, n).astype(np.float32)
    J = np.empty((count, _PARAMETERS + 1, parts * n), dtype=np.float32)
    diagonal = np.arange(_PARAMETERS)
    bends: tuple[F32, F32] | None = None
    v = pixels.rays
    for i in range(steps + 1):
        last = i == steps
        if motion_px is not None:
            v = _shifted(pixels, p[:, 1:3, None] * along)
        elif i == 0 and parts > 1:
            v = _shifted(pixels, np.repeat(spread * corners[None], count, axis=0))
        t32, n32, p32 = (array.astype(np.float32) for array in (t, normal, p))
        g = _Geometry(v, pixels.focal, t32, n32)
        square, inside, dark, outside = (p32[:, k : k + 1] for k in (0, 3, 4, 5))
        s = np.sqrt(np.maximum(square - spread**2, _MIN_BLUR**2))
        if bends is None or pixels.fine:
            bends = g.bends()
        area, bend = bends
        d = (g.rho[:, None] - radii[:, None]) / g.scale[:, None]  # outer edge, inner edge
        d = d - bend[:, None] * d * d
        scale = g.scale[:, None]
        if pixels.fine:
            d, scale = g.foot(d, radii)
        bow = (0.5 * s * area * area)[:, None] / (radii[:, None] * scale**3)
        f, density = _step(d / s[:, None] + bow)
        XY = (v[..., :2, :] - t32[:, :2, None] / t32[:, 2:, None]) * (t32[:, 2:, None] / radius)
        light = 1.0 + (p32[:, None, 6:8] @ XY)[:, 0]
        base = inside + (dark - inside) * f[:, 1] + (outside - dark) * f[:, 0]
        model = light * base
        height = np.stack([outside - dark, dark - inside], axis=1) / s[:, None]
        edge = density * (light[:, None] * height)  # d model / d distance, of both edges
        steep = edge[:, 0] + edge[:, 1]
        D = steep / g.scale
        Da = D * g.a
        e = np.array([tangents(a) for a in normal])  # (starts, 2, 3)
        J[:, :3] = Da[:, None] * n32[:, :, None] - D[:, None] * g.u
        J[:, 3:5] = (e.astype(np.float32) @ g.u) * (-Da * g.rho)[:, None]
        J[:, 5] = (edge * d).sum(axis=1) / (-2.0 * s * s)
        J[:, 6:8] = 0.0 if motion_px is None else (steep * share)[:, None] * g.across
        J[:, 8] = light * (1.0 - f[:, 1])
        J[:, 9] = light * (f[:, 1] - f[:, 0])
        J[:, 10] = light * f[:, 0]
        J[:, 11:13] = base[:, None] * XY
        J[:, 13] = edge[:, 1] / (-g.scale)  # of the inner radius: only the judgement uses it
        rows = J
        if parts > 1:
            model = model.reshape(count, parts, n).mean(axis=1)
            rows = J.reshape(count, _PARAMETERS + 1, parts, n).mean(axis=2)
        residual = grey - model
        middle = np.partition(np.abs(residual), n // 2, axis=1)[:, n // 2, None]
        noise = np.maximum(1.4826 * middle, 0.5)
        u = (residual / (3.0 * noise)) ** 2
        weight = pixels.trust / (1.0 + u) ** 2
        weighted = rows * weight[:, None, :]
        H = (weighted @ rows.transpose(0, 2, 1)).astype(np.float64)
        b = (weighted @ residual[:, :, None])[:, :, 0].astype(np.float64)
        _add_priors(H, b, p, noise[:, 0])
        if last:
            break
        A = H[:, :_PARAMETERS, :_PARAMETERS].copy()
        # A limit to the step, not a prior: near frontal view the tilt is hardly seen.
        A[:, diagonal[3:5], diagonal[3:5]] += noise * noise / 0.2**2
        step = np.linalg.solve(A, b[:, :_PARAMETERS, None])[:, :, 0]
        gain = (step * b[:, :_PARAMETERS]).sum(axis=1) / (noise[:, 0] ** 2)
        if float(gain.max()) < _ENOUGH:
            break
        depth = t[:, 2]
        aside = step[:, :2] - t[:, :2] * (step[:, 2] / depth)[:, None]
        ease = np.minimum(1.0, 0.25 * depth / np.maximum(np.abs(step[:, 2]), 1e-9))
        ease = np.minimum(ease, 0.3 * radius / np.maximum(np.hypot(*aside.T), 1e-9))[:, None]
        t = t + ease * step[:, :3]
        t[:, 2] = np.maximum(t[:, 2], 0.02)
        normal = normal + ease * (step[:, 3:4] * e[:, 0] + step[:, 4:5] * e[:, 1])
        normal /= np.sqrt((normal * normal).sum(axis=1))[:, None]
        p = p + step[:, 5:]
        p[:, 0] = np.clip(p[:, 0], _MIN_BLUR**2, _MAX_BLUR**2)
        p[:, 1:3] = np.clip(p[:, 1:3], -30.0, 30.0)
    fits = []
    least = float(noise.min())
    for k in range(count):
        distance = float(np.linalg.norm(t[k]))
        if not float(normal[k] @ t[k]) > _MIN_COS * distance:
            continue
        w, r = weight[k], residual[k]
        variance = float((w * r * r).sum()) / max(float(w.sum()) - _PARAMETERS, 5.0)
        full = np.linalg.inv(H[k])
        less = np.linalg.inv(H[k, :_PARAMETERS, :_PARAMETERS])
        fits.append(
            RingFit(
                position=t[k],
                normal=normal[k],
                blur_px=math.sqrt(float(p[k, 0])),
                motion_px=p[k, 1:3],
                inside=float(p[k, 3]),
                black=float(p[k, 4]),
                outside=float(p[k, 5]),
                noise=float(noise[k, 0]),
                cost=float((9.0 * pixels.trust * u[k] / (1.0 + u[k])).sum())
                * (float(noise[k, 0]) / least) ** 2,
                inliers=float(np.count_nonzero(u[k] < 1.0)) / n,
                covariance=variance * less[:3, :3],
                sigma_tilt=math.sqrt(max(0.0, variance * float(less[3, 3] + less[4, 4]) / 2.0)),
                ratio=ratio + float(full[13] @ b[k]) / radius,
                sigma_ratio=math.sqrt(max(0.0, variance * float(full[13, 13]))) / radius,
            )
        )
    return sorted(fits, key=lambda f: f.cost)


def _shifted(pixels: Pixels, shift_px: F64) -> F32:
    """Return the rays (starts, 3, parts n) of pixels moved by (starts, 2, parts) pixels."""
    count, _, parts = shift_px.shape
    v = np.repeat(pixels.rays[None, :, None], parts, axis=2).repeat(count, axis=0)
    v[:, :2] += (shift_px / pixels.focal).astype(np.float32)[..., None]
    return v.reshape(count, 3, -1)


def _add_priors(H: F64, b: F64, p: F64, noise: F64) -> None:
    """Add what is known besides the pixels to the normal equations, in place.

    Paper is equally white inside and around (to 6 %): far away little is seen of the surroundings.
    Motion is below 30 px. Tilts span about a radian.
    """
    variance = noise * noise
    tie = variance / (0.06 * np.maximum(p[:, 3], 10.0)) ** 2
    H[:, 8, 8] += tie
    H[:, 10, 10] += tie
    H[:, 8, 10] -= tie
    H[:, 10, 8] -= tie
    b[:, 8] += tie * (p[:, 5] - p[:, 3])
    b[:, 10] -= tie * (p[:, 5] - p[:, 3])
    H[:, 3, 3] += variance
    H[:, 4, 4] += variance
    H[:, 5, 5] += 1e-3 * variance
    H[:, 6, 6] += 1e-3 * variance
    H[:, 7, 7] += 1e-3 * variance
    b[:, 6] -= 1e-3 * variance * p[:, 1]
    b[:, 7] -= 1e-3 * variance * p[:, 2]
    H[:, 11, 11] += variance
    H[:, 12, 12] += variance
