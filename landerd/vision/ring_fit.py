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
from functools import lru_cache

import cv2
import numpy as np

from landerd.vision.ring_pixels import (
    F32,
    Pixels,
    PlaneView,
    blurred_step,
    plane_axes,
    shifted,
)
from landerd.vision.ring_pose import F64, Pose

# Rows of the derivative and of the normal equations. The light gradient follows, then the residual.
_RATIO = 0  # inner radius: only the judgement uses it
_CENTRE = slice(1, 4)  # on the plane's axes
_TILT = slice(4, 6)  # of the normal, towards the two tangents
_BLUR = 6  # variance, px^2
_INSIDE = 7  # level
_STEPS = slice(8, 10)  # of the level, outwards: at the outer and the inner edge
_MOTION = slice(10, 12)  # where it is fitted
_STATIC, _MOVING = 10, 12  # rows before the light gradient

_SPREAD_PX = 0.4  # of the places in which a small ring's pixel is looked at, along x and y
_CORNERS = np.array([[[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, -1.0, 1.0]]])
_NEAR = 30.0  # gain of chi-square by a step after which small rings are looked at with all care
_ENOUGH = 1.0  # and after which another step is not worth it
_NO_RIVAL = 1.5  # times the other start's noise: it will not become the better one
_MIN_BLUR, _MAX_BLUR = 0.2, 12.0  # px
_TOLD_TILT = 7.0  # sigma of a tilt that is told from frontal view
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
    n = len(pixels.grey)
    eighth = n // 8
    ordered = np.partition(pixels.grey, (eighth, n - 1 - eighth))
    black, white = float(ordered[eighth]), float(ordered[n - 1 - eighth])
    model = _Model(pixels, starts[0][0], radius, ratio, motion_px)
    t = np.array([position for position, _ in starts])
    normal = np.array([away for _, away in starts])
    state = np.zeros((len(starts), model.rows - 1))
    state[:, _BLUR : _STEPS.stop] = blur_px**2, white, white - black, black - white
    if motion_px is not None:
        state[:, _MOTION] = motion_px
    prior, pull, limit = _priors(model.rows - 1, max(white, 10.0), motion_px is not None)
    near, last_gain = False, np.zeros(len(starts))
    for i in range(steps):
        careful = pixels.fine and (near or i >= steps - 2)
        t32, axes = plane_axes(t, normal)
        J = model.derivative(t32, axes, state, careful)
        residual = J[:, -1]
        middle = np.partition(np.abs(residual), n // 2, axis=1)[:, n // 2]
        noise = np.maximum(1.4826 * middle, 0.5)
        u = residual * (1.0 / (3.0 * noise))[:, None]
        u *= u
        weight = pixels.trust / (1.0 + u) ** 2
        products = ((J * weight[:, None]) @ J.transpose(0, 2, 1)).astype(np.float64)
        variance = (noise * noise).astype(np.float64)[:, None]
        H = products[:, :-1, :-1] + variance[:, None] * prior
        b = products[:, :-1, -1] - variance * (state @ pull)
        if not np.isfinite(products).all():
            return []
        A = H + variance[:, None] * limit
        step = np.array([_solved(a, c) for a, c in zip(A[:, 1:, 1:], b[:, 1:], strict=True)])
        gain = (step * b[:, 1:]).sum(axis=1) / variance[:, 0]
        t, normal = _moved(t, normal, axes, step, radius)
        state[:, _BLUR:] += step[:, _BLUR - 1 :]
        state[:, _BLUR] = np.minimum(np.maximum(state[:, _BLUR], _MIN_BLUR**2), _MAX_BLUR**2)
        if motion_px is not None:
            state[:, _MOTION] = np.clip(state[:, _MOTION], -30.0, 30.0)
        # The judgement below is of the state before the last step, which changed little.
        is_open = (gain > _ENOUGH) & ((noise < _NO_RIVAL * noise.min()) | (i < 2))
        # Gains fall ever faster near the end, so the next one is foreseen. Where two poses vie, the
        # last gain itself must be small: their costs are compared.
        if np.count_nonzero(is_open) == 1:
            is_open &= gain * gain > _ENOUGH * last_gain
        if careful == pixels.fine and not is_open.any():
            break
        near = near or float(gain.min()) < _NEAR
        last_gain = gain
    inverse = np.array([cv2.invert(h)[1] for h in H])  # numpy's own takes five times as long
    costs = (9.0 * pixels.trust * u / (1.0 + u)).sum(axis=1) * (noise / noise.min()) ** 2
    trusted = float(pixels.trust.sum())
    unexplained = np.abs(residual) * np.sqrt(pixels.trust)
    fits = []
    for k in range(len(starts)):
        if not float(normal[k] @ t[k]) > _MIN_COS * math.hypot(*t[k].tolist()):
            continue
        inside, outer, inner = state[k, _INSIDE : _STEPS.stop].tolist()
        levels = (inside, inside + inner, inside + inner + outer)
        explained = unexplained[k] < max(8.0, 0.1 * (min(levels[0], levels[2]) - levels[1]))
        scale = products[k, -1, -1] / max(float(weight[k].sum()) - (model.rows - 2), 5.0)
        C, e = inverse[k], axes[k].astype(np.float64)
        across = C[1:6, _RATIO]
        pose_covariance = scale * (C[1:6, 1:6] - np.outer(across, across) / C[_RATIO, _RATIO])
        pose_covariance += _unseen_tilt(pose_covariance, e @ t[k] / np.linalg.norm(t[k]))
        fits.append(
            RingFit(
                position=t[k],
                normal=normal[k],
                blur_px=math.sqrt(float(state[k, _BLUR])),
                motion_px=state[k, _MOTION] if motion_px is not None else np.zeros(2),
                inside=levels[0],
                black=levels[1],
                outside=levels[2],
                noise=float(noise[k]),
                cost=float(costs[k]),
                inliers=float(pixels.trust[explained].sum()) / trusted,
                covariance=e.T @ pose_covariance[:3, :3] @ e,
                sigma_tilt=math.sqrt(max(0.0, float(np.trace(pose_covariance[3:, 3:])) / 2.0)),
                ratio=ratio + float(C[_RATIO] @ b[k]) / radius,
                sigma_ratio=math.sqrt(max(0.0, scale * float(C[_RATIO, _RATIO]))) / radius,
            )
        )
    return sorted(fits, key=lambda f: f.cost)


def _unseen_tilt(covariance: F64, sight: F64) -> F64:
    """Return what is to be added to a covariance (5, 5) of centre and tilt near frontal view.

    There the image changes with the square of the angle to the line of sight (unit vector, on the
    plane's axes). If the true angle is zero, the error of the one that is found is twice what a
    linear model at that angle says.
    """
    angle = math.hypot(sight[0], sight[1])
    way = np.zeros(5)
    way[3:] = sight[:2] / max(angle, 1e-9)
    moved = covariance @ way
    variance = float(way @ moved)
    if not variance > 0.0:
        return np.zeros((5, 5))
    share = 3.0 * math.exp(-min((angle * angle / variance / _TOLD_TILT**2) ** 2, 50.0))
    added: F64 = np.outer(moved, moved) * (share / variance)
    return added


class _Model:
    """The grey levels of pixels as a ring would show them, and their derivatives."""

    def __init__(
        self,
        pixels: Pixels,
        centre: F64,
        radius: float,
        ratio: float,
        motion_px: Sequence[F64] | None,
    ) -> None:
        """Prepare; the light gradient is about a first centre."""
        self._pixels = pixels
        self._radii = np.array([radius, radius * ratio], dtype=np.float32)
        x, y, z = centre.tolist()
        xy = pixels.rays[:2] - np.array([[x / z], [y / z]], dtype=np.float32)
        self._xy = xy * np.float32(z / radius)
        self._along: F64 | None = None  # the motion's path, where the image is looked at
        if motion_px is not None:
            parts = int(min(max(max(math.hypot(*m) for m in motion_px) / 1.3, 3.0), 9.0))
            self._along = (np.arange(parts) + 0.5) / parts - 0.5
        self._bends: tuple[F32, F32] | None = None
        self._static = _STATIC if motion_px is None else _MOVING
        self.rows = self._static + 3

    def derivative(self, t: F32, axes: F32, state: F64, careful: bool) -> F32:
        """Return derivatives of grey levels (starts, rows, n), the residual last.

        Careful: small rings bend within the blur. A Gaussian is nearly the mean of four narrower
        ones set square around it, and for those the edges are straight enough.
        """
        pixels, radii = self._pixels, self._radii[:, None]
        v, parts, spread = pixels.rays, 1, 0.0
        if self._along is not None:
            parts = len(self._along)
            v = shifted(pixels, state[:, _MOTION, None] * self._along)
        elif careful:
            parts, spread = 4, _SPREAD_PX
            v = shifted(pixels, spread * _CORNERS)
        g = PlaneView(v, pixels.focal, t, axes)
        blur = np.sqrt(np.maximum(state[:, _BLUR] - spread**2, _MIN_BLUR**2))
        s = blur.astype(np.float32)[:, None, None]
        scale = g.scale[:, None]
        d = (g.rho[:, None] - radii) / scale  # outer edge, inner edge
        if careful:
            area, bend = g.bends()
            d, scale = g.foot(d - bend[:, None] * d * d, radii)
            bow = _bow(area, radii, scale)
        else:
            if self._bends is None:
                area, bend = g.bends()
                self._bends = bend[:, None], _bow(area, radii, scale)
            bend, bow = self._bends
            d -= bend * d * d
        f, density = blurred_step(d / s + bow * s)
        heights = state[:, _STEPS].astype(np.float32)[:, :, None]
        density *= heights / s
        shape = np.empty((len(state), self._static, f.shape[-1]), dtype=np.float32)
        down = (density[:, 0] + density[:, 1]) / -g.scale
        shape[:, _RATIO] = density[:, 1] / -g.scale
        np.multiply(down[:, None], g.u, out=shape[:, _CENTRE])
        np.multiply((down * g.a * g.rho)[:, None], g.u[:, :2], out=shape[:, _TILT])
        density *= d
        np.multiply(density[:, 0] + density[:, 1], -0.5 / (s[:, 0] * s[:, 0]), out=shape[:, _BLUR])
        shape[:, _INSIDE] = 1.0
        shape[:, _STEPS] = f
        if self._along is not None:
            share = np.repeat(self._along, len(pixels.grey)).astype(np.float32)
            shape[:, _MOTION] = (down * -g.scale * share)[:, None] * g.across()
        if parts > 1:
            shape = shape.reshape(*shape.shape[:2], parts, -1).mean(axis=2)
        base = (heights * shape[:, _STEPS]).sum(axis=1)
        base += state[:, _INSIDE, None].astype(np.float32)
        light = state[:, self._static : self._static + 2].astype(np.float32) @ self._xy
        light += 1.0
        J = np.empty((len(state), self.rows, len(pixels.grey)), dtype=np.float32)
        np.multiply(shape, light[:, None], out=J[:, : self._static])
        np.multiply(base[:, None], self._xy, out=J[:, self._static : -1])
        np.subtract(pixels.grey, light * base, out=J[:, -1])
        return J


def _bow(area: F32, radii: F32, scale: F32) -> F32:
    """Return the shift of blurred bent edges (starts, 2, n), in blurs per pixel of blur."""
    return (0.5 * area * area)[:, None] / (radii * scale**3)


@lru_cache
def _priors(rows: int, white: float, moving: bool) -> tuple[F64, F64, F64]:
    """Return what is known besides the pixels, as matrices (rows, rows) in units of 1/noise^2.

    Paper is equally white inside and around (to 6 %): far away little is seen of the surroundings.
    Motion is below 30 px. Tilts span about a radian. The second matrix is the part that draws the
    state to zero. The third is a limit to steps, no prior: near frontal view the tilt is hardly
    seen.
    """
    pull = np.zeros((rows, rows))
    pull[_STEPS, _STEPS] = 1.0 / (0.06 * white) ** 2
    damping = np.full(rows, 1e-4)  # so that no parameter is ever free
    damping[_TILT] += 1.0
    damping[_BLUR] += 1e-3
    damping[-2:] += 1.0
    if moving:
        pull[_MOTION, _MOTION] = 1e-3 * np.eye(2)
    limit = np.zeros(rows)
    limit[_TILT] = 1.0 / 0.2**2
    return pull + np.diag(damping), pull, np.diag(limit)


def _solved(A: F64, b: F64) -> F64:
    """Return the solution (n,) of A x = b; zero if A is singular. Four times as fast as numpy's."""
    return np.asarray(cv2.solve(A, b[:, None])[1], dtype=np.float64)[:, 0]


def _moved(t: F64, normal: F64, axes: F32, step: F64, radius: float) -> tuple[F64, F64]:
    """Return poses after steps (starts, 5 or more) on the planes' axes, wild ones shortened."""
    forward = (step[:, None, :3] @ axes)[:, 0]
    turn = (step[:, None, 3:5] @ axes[:, :2])[:, 0]
    for k, ((x, y, z), (dx, dy, dz)) in enumerate(zip(t.tolist(), forward.tolist(), strict=True)):
        aside = math.hypot(dx - x * dz / z, dy - y * dz / z)
        longest = max(abs(dz) / (0.25 * z), aside / (0.3 * radius))
        if longest > 1.0:
            forward[k] /= longest
            turn[k] /= longest
    t, normal = t + forward, normal + turn
    t[:, 2] = np.maximum(t[:, 2], 0.02)
    return t, normal / np.sqrt((normal * normal).sum(axis=1))[:, None]
