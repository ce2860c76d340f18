"""Fit of a ring's pose to the grey levels near its two edges.

The model of a pixel: its ray meets the pad's plane at a distance rho from the ring's centre; the
edges at rho = r_i and r_o are steps between three grey levels, blurred by a Gaussian. Gauss-Newton
on centre, normal, levels, light gradient and blur, with weights against what the model leaves out
(occlusion, the plate's edge). Distances are exact in the pad's plane, so neither perspective nor
lens distortion bends them; two corrections of second order make up for measuring them in pixels.
"""

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel
from landerd.vision.ring_pose import F64, Pose

U8 = NDArray[np.uint8]

_BAND_PX = 3.0  # pixels this near to an edge take part
_MOST = 1000  # pixels in a fit
_MAX_TILT_COS = 0.15


@dataclass(frozen=True)
class Pixels:
    """Grey levels and where they were seen."""

    x: F64  # rays on z = 1, (n,)
    y: F64
    grey: F64  # (n,)
    focal: float  # pixels per ray unit, geometric mean


@dataclass
class RingFit:
    """A fitted ring. Grey levels are `inside`, `black`, `outside` at the ring's centre."""

    position: F64  # (3,), m
    normal: F64  # (3,), unit, away from the camera
    blur_px: float
    inside: float
    black: float
    outside: float
    slope: F64  # (2,) relative change of light per ring radius, along x and y of the image
    noise: float = 0.0  # robust sigma of the residuals, grey levels
    cost: float = math.inf  # robust sum of squared residuals over noise^2
    samples: int = 0
    inliers: float = 0.0  # share of pixels within 3 sigma
    covariance: F64 | None = None  # of position (3, 3), m^2
    sigma_tilt: float = math.inf  # rad
    ratio: float = 0.0  # inner over outer diameter as the pixels have it
    sigma_ratio: float = math.inf

    @property
    def contrast(self) -> float:
        """Step from black to white, grey levels: the smaller of both edges."""
        return min(self.inside, self.outside) - self.black


def pixels_near(
    image: U8, camera: CameraModel, pose: Pose, radius: float, ratio: float
) -> Pixels | None:
    """Return the pixels near both edges of a ring at a pose; None if too few are in the image."""
    h, w = image.shape
    outer, inner = edge_pixels(camera, pose, radius), edge_pixels(camera, pose, radius * ratio)
    low, high = outer.min(axis=0), outer.max(axis=0)
    if not np.isfinite(low).all():
        return None
    if float((high - low).max()) < 40.0:
        x0, y0 = np.maximum(np.floor(low - _BAND_PX), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(high + _BAND_PX), (w - 1, h - 1)).astype(int)
        if x1 - x0 < 4 or y1 - y0 < 4:
            return None
        gx, gy = np.meshgrid(np.arange(x0, x1 + 1), np.arange(y0, y1 + 1))
        p = np.column_stack([gx.ravel(), gy.ravel()])
    else:
        p = np.concatenate([_across(inner, 0.4), _across(outer, 0.6)])
        p = p[(p[:, 0] >= 0) & (p[:, 0] < w) & (p[:, 1] >= 0) & (p[:, 1] < h)]
    if len(p) < 40:
        return None
    rays = camera.rays(p.astype(np.float64))
    focal = math.sqrt(camera.fx * camera.fy)
    grey = image[p[:, 1], p[:, 0]].astype(np.float64)
    pixels = Pixels(rays[:, 0].copy(), rays[:, 1].copy(), grey, focal)
    rho, _, _, scale, *_ = _plane(pixels, *pose)
    near = (rho - radius < _BAND_PX * scale) & (
        (radius - rho < _BAND_PX * scale) | (np.abs(rho - radius * ratio) < _BAND_PX * scale)
    )
    if np.count_nonzero(near) < 40:
        return None
    return Pixels(pixels.x[near], pixels.y[near], grey[near], focal)


def edge_pixels(camera: CameraModel, pose: Pose, radius: float, count: int = 64) -> F64:
    """Return pixels (count, 2) on a circle in the pad's plane."""
    position, normal = pose
    e1, e2 = _tangents(normal)
    a = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)[:, None]
    points = position + radius * (np.cos(a) * e1 + np.sin(a) * e2)
    points[:, 2] = np.maximum(points[:, 2], 1e-3)
    return camera.pixels(points)


def _across(edge: F64, share: float) -> NDArray[np.intp]:
    """Return whole pixels (n, 2) on short lines across a closed outline (64, 2)."""
    offsets = np.arange(-_BAND_PX, _BAND_PX + 0.5)
    count = int(share * _MOST / len(offsets))
    at = np.arange(count) * (len(edge) / count)
    i = at.astype(int)
    part = (at - i)[:, None]
    closed = np.vstack([edge, edge[:1]])
    along = closed[i + 1] - closed[i]
    p = closed[i] + part * along
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None] + 1e-12
    lines = p[:, None, :] + offsets[None, :, None] * normal[:, None, :]
    return np.rint(lines).reshape(-1, 2).astype(np.intp)


def _tangents(normal: F64) -> tuple[F64, F64]:
    """Return two unit vectors that span the plane of a normal."""
    x, y, z = (float(v) for v in normal)
    # Across the axis that lies farther from the normal.
    if abs(x) < 0.7:
        k = 1.0 / math.hypot(y, z)
        e1 = (0.0, z * k, -y * k)
    else:
        k = 1.0 / math.hypot(x, z)
        e1 = (-z * k, 0.0, x * k)
    e2 = (y * e1[2] - z * e1[1], z * e1[0] - x * e1[2], x * e1[1] - y * e1[0])
    return np.array(e1), np.array(e2)


def _plane(
    pixels: Pixels, position: F64, normal: F64
) -> tuple[F64, tuple[F64, F64, F64], F64, F64, F64, F64, F64]:
    """Return rho, q, a, metres per pixel across the level line, and what its bend needs.

    q is the point in the plane from the centre (three arrays); d rho = (a n - q / rho) . dt and
    d rho = -a q . dn. The last three are the plane's area of one pixel squared over ..., see
    `_bends`.
    """
    x, y, f = pixels.x, pixels.y, pixels.focal
    nx, ny, nz = (float(v) for v in normal)
    tx, ty, tz = (float(v) for v in position)
    m = np.maximum(nx * x + ny * y + nz, 1e-6)
    depth = (nx * tx + ny * ty + nz * tz) / m
    qx, qy, qz = depth * x - tx, depth * y - ty, depth - tz
    rho = np.sqrt(qx * qx + qy * qy + qz * qz) + 1e-9
    a = (qx * x + qy * y + qz) / (m * rho)
    k = depth / f
    gx = k * (qx / rho - nx * a)
    gy = k * (qy / rho - ny * a)
    scale = np.sqrt(gx * gx + gy * gy) + 1e-12
    return rho, (qx, qy, qz), a, scale, gx, gy, depth / m


def _bends(
    pixels: Pixels, pose: Pose, rho: F64, scale: F64, gx: F64, gy: F64, depth_over_m: F64
) -> tuple[F64, F64]:
    """Return the level line's curvature (1/px) and half the second derivative of rho across it.

    With M the metric of the plane in pixels, rho^2 = p^T M p: the curvature is
    det M / (rho g^3), and rho'' across the line is (u^T M u - g^2) / rho, u the unit gradient.
    """
    x, y, f = pixels.x, pixels.y, pixels.focal
    nx, ny, nz = (float(v) for v in pose[1])
    m = np.maximum(nx * x + ny * y + nz, 1e-6)
    depth = depth_over_m * m
    ux, uy = gx / scale, gy / scale
    nu = (nx * ux + ny * uy) / m
    k = depth / f
    wx, wy, wz = ux - nu * x, uy - nu * y, -nu
    along2 = k * k * (wx * wx + wy * wy + wz * wz)
    area = depth * depth_over_m * depth / (f * f) / np.maximum(depth, 1e-9)
    curvature = area * area / (rho * scale**3)
    return curvature, np.maximum(along2 - scale * scale, 0.0) / (2.0 * rho)


def _step(z: F64) -> tuple[F64, F64]:
    """Return the normal distribution function and its density."""
    cdf = 0.5 + 0.5 * np.tanh(z * (0.7978845608 + 0.0356774081 * z * z))
    return cdf, np.exp(-0.5 * z * z) * 0.3989422804


def fit_ring(
    pixels: Pixels, start: Pose, radius: float, ratio: float, iterations: int, blur_px: float = 1.0
) -> RingFit | None:
    """Fit a ring to pixels from a start within about two pixels; None if the fit fails."""
    position, normal = start[0].copy(), start[1].copy()
    x, y, grey = pixels.x, pixels.y, pixels.grey
    n = len(grey)
    ordered = np.sort(grey)
    black, inside = float(ordered[n // 10]), float(ordered[-1 - n // 10])
    outside = inside
    slope = np.zeros(2)
    blur = blur_px
    inner = radius * ratio
    J = np.empty((12, n))
    bends: tuple[F64, F64] | None = None
    noise = 0.0
    for i in range(iterations + 1):
        rho, q, a, scale, gx, gy, dm = _plane(pixels, position, normal)
        if bends is None or i == iterations - 1:
            bends = _bends(pixels, (position, normal), rho, scale, gx, gy, dm)
        curvature, half_second = bends
        d_o, d_i = (rho - radius) / scale, (rho - inner) / scale
        bent = half_second / scale
        bow = 0.5 * blur * curvature
        f_o, p_o = _step((d_o - bent * d_o * d_o) / blur + bow)
        f_i, p_i = _step((d_i - bent * d_i * d_i) / blur + bow)
        X = (x - position[0] / position[2]) * (position[2] / radius)
        Y = (y - position[1] / position[2]) * (position[2] / radius)
        light = 1.0 + slope[0] * X + slope[1] * Y
        base = inside + (black - inside) * f_i + (outside - black) * f_o
        residual = grey - light * base
        s_o = light * (outside - black) * p_o / blur
        s_i = light * (black - inside) * p_i / blur
        D = (s_o + s_i) / scale
        e1, e2 = _tangents(normal)
        Da = D * a
        for k in range(3):
            J[k] = Da * normal[k] - D * q[k] / rho
        J[3] = -Da * (q[0] * e1[0] + q[1] * e1[1] + q[2] * e1[2])
        J[4] = -Da * (q[0] * e2[0] + q[1] * e2[1] + q[2] * e2[2])
        J[5] = -(s_o * d_o + s_i * d_i) / blur
        J[6] = light * (1.0 - f_i)
        J[7] = light * (f_i - f_o)
        J[8] = light * f_o
        J[9] = base * X
        J[10] = base * Y
        J[11] = -s_i / scale  # of the inner radius: only the last look uses it
        size = np.abs(residual)
        noise = max(1.4826 * float(np.median(size)), 0.5)
        weight = 1.0 / (1.0 + (residual / (3.0 * noise)) ** 2)
        JW = J * weight
        H = JW @ J.T
        b = JW @ residual
        if i == iterations:
            break
        H5 = H[:11, :11].copy()
        # A step limit, not a prior: near frontal view the tilt is hardly seen.
        H5[3, 3] += noise * noise / 0.09
        H5[4, 4] += noise * noise / 0.09
        H5[5, 5] += noise * noise / 0.25
        try:
            step = np.linalg.solve(H5, b[:11])
        except np.linalg.LinAlgError:
            return None
        limit = 0.3 * radius / max(1e-9, float(np.linalg.norm(step[:3] - position * (step[2] / position[2]))))
        limit = min(1.0, limit, 0.25 * position[2] / max(1e-9, abs(float(step[2]))))
        position = position + limit * step[:3]
        normal = normal + limit * (step[3] * e1 + step[4] * e2)
        normal /= np.linalg.norm(normal)
        blur = min(max(blur + limit * float(step[5]), 0.35), 4.0)
        inside += float(step[6])
        black += float(step[7])
        outside += float(step[8])
        slope = slope + step[9:11]
        sight = float(normal @ position)
        if not (position[2] > 0.0 and sight > _MAX_TILT_COS * float(np.linalg.norm(position))):
            return None
    fit = RingFit(position, normal, blur, inside, black, outside, slope)
    _judge(fit, H, b, residual, weight, noise, radius, ratio)
    return fit


def _judge(
    fit: RingFit,
    H: F64,
    b: F64,
    residual: F64,
    weight: F64,
    noise: float,
    radius: float,
    ratio: float,
) -> None:
    """Fill in cost, covariance and the ratio the pixels have."""
    n = len(residual)
    fit.noise = noise
    fit.samples = n
    fit.cost = float(np.sum(9.0 * np.log1p((residual / (3.0 * noise)) ** 2)))
    fit.inliers = float(np.count_nonzero(np.abs(residual) < 3.0 * noise)) / n
    variance = float(np.sum(weight * residual * residual) / max(float(weight.sum()) - 11.0, 5.0))
    H = H.copy()
    H[3, 3] += variance / 0.25
    H[4, 4] += variance / 0.25
    try:
        full = np.linalg.inv(H)
        inverse = np.linalg.inv(H[:11, :11])
    except np.linalg.LinAlgError:
        return
    fit.covariance = cast(F64, variance * inverse[:3, :3])
    fit.sigma_tilt = math.sqrt(max(0.0, variance * float(inverse[3, 3] + inverse[4, 4]) / 2.0))
    fit.ratio = ratio + float((full @ b)[11]) / radius
    fit.sigma_ratio = math.sqrt(max(0.0, variance * float(full[11, 11]))) / radius
