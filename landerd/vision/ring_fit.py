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
    """Grey levels, rays (x, y) on z = 1 on which they were seen, and weights, all (n,)."""

    x: F64
    y: F64
    grey: F64
    trust: F64
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
    grey = image[p[:, 1], p[:, 0]].astype(np.float64)
    x, y = np.ascontiguousarray(rays.T)
    g = _Geometry(x, y, focal, pose[0][None], pose[1][None])
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
    return Pixels(x[near], y[near], grey[near], trust[near], fine and size < _FINE_PX, focal)


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
    """Pixels against the planes of several poses: arrays (starts, n)."""

    def __init__(self, x: F64, y: F64, f: float, t: F64, n: F64) -> None:
        self.x, self.y, self.f = x, y, f
        nx, ny, nz = n[:, 0:1], n[:, 1:2], n[:, 2:3]
        self.m = np.maximum(nx * x + ny * y + nz, 1e-6)
        self.depth = (n * t).sum(axis=1)[:, None] / self.m
        qx = self.depth * x - t[:, 0:1]
        qy = self.depth * y - t[:, 1:2]
        qz = self.depth - t[:, 2:3]
        self.rho = np.sqrt(qx * qx + qy * qy + qz * qz) + 1e-9
        # Unit vector from the centre; d rho = (a n - u) . dt and d rho = -a rho u . dn.
        self.u = (qx / self.rho, qy / self.rho, qz / self.rho)
        self.a = (self.u[0] * x + self.u[1] * y + self.u[2]) / self.m
        k = self.depth / f
        gx = k * (self.u[0] - nx * self.a)
        gy = k * (self.u[1] - ny * self.a)
        self.scale = np.sqrt(gx * gx + gy * gy) + 1e-12  # metres in the plane per pixel
        self.across = (gx / self.scale, gy / self.scale)  # unit gradient of rho in the image

    def bends(self, n: F64) -> tuple[F64, F64]:
        """Return the plane's area in a pixel (m^2) and rho'' / (2 rho') across a level line (1/px).

        With M the metric of the plane in pixels, rho^2 = p^T M p: the root of det M is the area,
        the line's curvature det M / (rho g^3), and rho'' (w^T M w - g^2) / rho, w the unit
        gradient.
        """
        wx, wy = self.across
        nw = (n[:, 0:1] * wx + n[:, 1:2] * wy) / self.m
        k = self.depth / self.f
        ex, ey = wx - nw * self.x, wy - nw * self.y
        excess = np.maximum(k * k * (ex * ex + ey * ey + nw * nw) - self.scale * self.scale, 0.0)
        return k * k / self.m, excess / (2.0 * self.rho * self.scale)

    def edge(self, radius: float, bend: F64) -> F64:
        """Return signed distances (px) to a circle, to second order."""
        d = (self.rho - radius) / self.scale
        return d - bend * d * d

    def foot(self, d: F64, radius: float, t: F64, n: F64) -> tuple[F64, F64]:
        """Return distance (px) to a circle and g (m/px) from where a first distance leads."""
        d = np.clip(d, -3.0, 3.0)
        wx, wy = self.across
        k = d / self.f
        near = _Geometry(self.x - k * wx, self.y - k * wy, self.f, t, n)
        fx, fy = near.across
        return (near.rho - radius) / near.scale + d * (wx * fx + wy * fy), near.scale


def _step(z: F64) -> tuple[F64, F64]:
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
    inner = radius * ratio
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
    corner = spread * np.array([[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, -1.0, 1.0]])[:, :parts]
    share = np.repeat(along, n)
    J = np.empty((count, _PARAMETERS + 1, parts * n))
    diagonal = np.arange(_PARAMETERS)
    bends: tuple[F64, F64] | None = None
    x, y = pixels.x, pixels.y
    for i in range(steps + 1):
        last = i == steps
        if parts > 1 and (i == 0 or motion_px is not None):
            shift = (
                p[:, 1:3, None] * along + corner[:, : 1 if motion_px is not None else parts]
            ) / (pixels.focal)
            x = (pixels.x + shift[:, 0, :, None]).reshape(count, -1)
            y = (pixels.y + shift[:, 1, :, None]).reshape(count, -1)
        g = _Geometry(x, y, pixels.focal, t, normal)
        wx, wy = g.across
        square, inside, dark, outside, slope_x, slope_y = (
            p[:, k : k + 1] for k in (0, 3, 4, 5, 6, 7)
        )
        s = np.sqrt(np.maximum(square - spread**2, _MIN_BLUR**2))
        if bends is None or pixels.fine:
            bends = g.bends(normal)
        area, bend = bends
        d_o, d_i = g.edge(radius, bend), g.edge(inner, bend)
        g_o = g_i = g.scale
        if pixels.fine:
            d_o, g_o = g.foot(d_o, radius, t, normal)
            d_i, g_i = g.foot(d_i, inner, t, normal)
        bow = 0.5 * s * area * area
        f_o, p_o = _step(d_o / s + bow / (radius * g_o**3))
        f_i, p_i = _step(d_i / s + bow / (inner * g_i**3))
        X = (x - t[:, 0:1] / t[:, 2:3]) * (t[:, 2:3] / radius)
        Y = (y - t[:, 1:2] / t[:, 2:3]) * (t[:, 2:3] / radius)
        light = 1.0 + slope_x * X + slope_y * Y
        base = inside + (dark - inside) * f_i + (outside - dark) * f_o
        model = light * base
        s_o = light * (outside - dark) * p_o / s
        s_i = light * (dark - inside) * p_i / s
        steep = s_o + s_i
        D = steep / g.scale
        Da = D * g.a
        for k in range(3):
            J[:, k] = Da * normal[:, k : k + 1] - D * g.u[k]
        Da *= -g.rho
        e = [tangents(v) for v in normal]
        for k in range(2):
            ek = np.array([pair[k] for pair in e])
            J[:, 3 + k] = Da * (g.u[0] * ek[:, 0:1] + g.u[1] * ek[:, 1:2] + g.u[2] * ek[:, 2:3])
        J[:, 5] = (s_o * d_o + s_i * d_i) / (-2.0 * s * s)
        if motion_px is None:
            J[:, 6:8] = 0.0
        else:
            J[:, 6] = steep * wx * share
            J[:, 7] = steep * wy * share
        J[:, 8] = light * (1.0 - f_i)
        J[:, 9] = light * (f_i - f_o)
        J[:, 10] = light * f_o
        J[:, 11] = base * X
        J[:, 12] = base * Y
        J[:, 13] = s_i / (-g.scale)  # of the inner radius: only the judgement uses it
        rows = J
        if parts > 1:
            model = model.reshape(count, parts, n).mean(axis=1)
            rows = J.reshape(count, _PARAMETERS + 1, parts, n).mean(axis=2)
        residual = grey - model
        noise = np.maximum(1.4826 * np.median(np.abs(residual), axis=1, keepdims=True), 0.5)
        u = (residual / (3.0 * noise)) ** 2
        weight = pixels.trust / (1.0 + u) ** 2
        weighted = rows * weight[:, None, :]
        H = weighted @ rows.transpose(0, 2, 1)
        b = (weighted @ residual[:, :, None])[:, :, 0]
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
        normal = normal + ease * (
            step[:, 3:4] * np.array([v[0] for v in e]) + step[:, 4:5] * np.array([v[1] for v in e])
        )
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
