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

from landerd.vision.ring_pixels import F32, Pixels, PlaneView, blurred_step, shifted
from landerd.vision.ring_pose import F64, Pose, tangents

_PARAMETERS = 13  # centre 3, normal 2, blur 1, motion 2, levels 3, light gradient 2
_SPREAD_PX = 0.4  # of the places in which a small ring's pixel is looked at, along x and y
_ENOUGH = 1.0  # gain of chi-square by a step after which another is not worth it
_MIN_BLUR, _MAX_BLUR = 0.2, 12.0  # px
_MIN_COS = 0.15  # of the tilt: flatter views than 81 degrees are not fitted


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
    inliers: float  # share of pixels that the model explains to a tenth of the contrast
    covariance: F64  # of position (3, 3), m^2
    sigma_tilt: float  # rad
    ratio: float  # inner over outer diameter as the pixels have it
    sigma_ratio: float

    @property
    def contrast(self) -> float:
        """Step from black to white, grey levels: the smaller of both edges."""
        return min(self.inside, self.outside) - self.black


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
    for i in range(steps):
        if motion_px is not None:
            v = shifted(pixels, p[:, 1:3, None] * along)
        elif i == 0 and parts > 1:
            v = shifted(pixels, np.repeat(spread * corners[None], count, axis=0))
        t32, n32, p32 = (array.astype(np.float32) for array in (t, normal, p))
        g = PlaneView(v, pixels.focal, t32, n32)
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
        f, density = blurred_step(d / s[:, None] + bow)
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
        A = H[:, :_PARAMETERS, :_PARAMETERS].copy()
        # A limit to the step, not a prior: near frontal view the tilt is hardly seen.
        A[:, diagonal[3:5], diagonal[3:5]] += noise * noise / 0.2**2
        if not (np.isfinite(A).all() and np.isfinite(b).all()):
            return []
        step = np.linalg.solve(A, b[:, :_PARAMETERS, None])[:, :, 0]
        gain = (step * b[:, :_PARAMETERS]).sum(axis=1) / (noise[:, 0] ** 2)
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
        # The judgement below is of the state before the last step, which changed little.
        if float(gain.max()) < _ENOUGH:
            break
    fits: list[RingFit] = []
    if not np.isfinite(H).all():
        return fits
    least = float(noise.min())
    for k in range(count):
        distance = float(np.linalg.norm(t[k]))
        if not float(normal[k] @ t[k]) > _MIN_COS * distance:
            continue
        w, r = weight[k], residual[k]
        step_height = max(float(min(p[k, 3], p[k, 5]) - p[k, 4]), 1.0)
        explained = np.abs(r) * np.sqrt(pixels.trust) < max(8.0, 0.1 * step_height)
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
                inliers=float((pixels.trust * explained).sum() / pixels.trust.sum()),
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
    every = np.arange(_PARAMETERS + 1)
    H[:, every, every] += 1e-4 * variance[:, None]  # so that no parameter is ever free
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
