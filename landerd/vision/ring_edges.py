"""Fit of a ring's pose to where its two edges lie in the image, whatever its grey levels do.

Edges are looked for along rays from the centre, each between the black and the white beside it: a
shadow dims both alike, and under any monotone tone curve, clipped white included, they keep their
place but for a shift towards black or white that is the same all around. That shift is fitted
beside the pose; the known ratio tells it from the range. Rays on which a leg, dirt or a glare lies
are outliers.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import numpy.ma  # np.median loads it when first called: 40 ms, in flight

from landerd.camera_model import F64, CameraModel
from landerd.pad import Ring
from landerd.vision.arrays import F32, U8, Mask
from landerd.vision.edge_profile import ROBUST_SIGMAS, SIGMA_PER_MAD, crossing, is_step, medians
from landerd.vision.linear import inverse
from landerd.vision.ring_pixels import PlaneView, plane_axes
from landerd.vision.ring_pose import CirclePose

INTERP = cv2.INTER_CUBIC
_RAYS = 64
_SAMPLES = 25  # across an edge, on each ray
_ANGLES = np.arange(_RAYS) * (2.0 * math.pi / _RAYS)
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
# Bands across the edges, from black to white, in radii: half of the stroke, and less than the
# thesis's margin. In pixels, those of the last rounds.
_INTO_BLACK, _INTO_WHITE = 0.27, 0.2
_FINE_PX = 4.0
_COARSE_ROUNDS, _FINE_ROUNDS = 1, 2
_DESCENTS = 2  # steps to the edges of one round
_SHIFT, _RATIO = 5, 6  # rows of a step, after those of centre and tilt
_FREED_DESCENTS = 4
_LEAST_RATIO, _MOST_RATIO = 0.1, 0.95
_SETTLED_PX = 0.1  # a round that moves the edges by less is the last
# Share of the rays that must be near the edges after the first round, and how near, of the radius:
# rings in all kinds of light gave 0.65 and more, half of the textures less than 0.6.
_COARSE_SUPPORT, _COARSE_NEAR = 0.6, 0.09
_END = 5  # samples at either end of a band that tell black and white
_LEVEL_RAYS = 2  # to either side, of which black and white are medians
_BESIDE = (np.arange(_RAYS)[:, None] + np.arange(-_LEVEL_RAYS, _LEVEL_RAYS + 1)) % _RAYS
_COARSE_NOISE_PX, _LEAST_NOISE_PX = 0.3, 0.04
_SHIFT_SIGMA_PX = 0.5  # of what a tone curve moves edges by
_CLIPPED_SHIFT_BLURS = 1.3  # white that is 2.5 to 5 times over full scale moves an edge so far
# Of the rays: a shadow as wide as a ring's hole dims as many beyond it, and dirt leaves as many of
# a hole clean.
_SHADED_SHARE = 0.12
_NEAREST_M = 1e-3
_MIN_RADIUS_PX = 3.0
_MIN_RAYS = 20  # of both edges together
# An edge is as fitted within the lesser of these, px and share of the radius, and this share of it.
_NEAR_PX, _NEAR_SMALL, _NEAR_SHARE = 0.45, 0.03, 0.015
_INDEPENDENT_PX = 2.0  # along an edge, of pixels that are not of the same blur
_MOST_CORRELATED = 0.95


@dataclass(frozen=True)
class RingEdgeFit:
    """A pose fitted to edges, and how much of the ring they show."""

    position: F64  # (3,), m
    normal: F64  # (3,)
    shift_px: float  # of both edges, into the black
    sigma_shift: float  # px
    noise_px: float  # of edges, robust
    blur_px: float  # sigma
    broad_px: float  # of the broadest quarter
    radius_px: float
    support: tuple[float, float]  # share of the rays in the image with an edge: outer, inner
    visible: float  # share of the rays that are in the image
    cos_tilt: float  # of the normal to the line of sight
    ridge: float  # of a brighter circle within the stroke, over the contrast
    dark: float  # share of the stroke that is darker than the white beside it
    bright: float  # share of hole and margin that are brighter than the black beside them
    residual: F64  # (rays,) of all edges, px; nan where none is seen
    dependence: float  # how many times fewer edges than rays there are
    covariance: F64  # (5, 5) of centre and tilt on the plane's axes, m^2, m rad, rad^2
    levels: tuple[float, float, float]  # inside, black, outside
    shaded: float  # level of the outside's darkest part: the white there, if a shadow crosses it
    clean: float  # level of the inside's brightest part: the white there, if dirt hides most of it
    # Of white over the black beside it, edge by edge, whatever the light: outer and inner ones.
    contrast: tuple[float, float]  # grey levels
    depth: tuple[float, float]  # share of the white
    uneven: float  # how much the light changes about the ring: four fifths of the white, over it
    freed: Callable[[], "Freed"]  # what ratio the edges have by themselves, worked out when asked


@dataclass(frozen=True)
class Freed:
    """Where the ratio is fitted as well."""

    ratio: float  # inner over outer diameter
    shift_px: float  # of both edges then, into the black
    noise_px: float


@dataclass(frozen=True)
class _Edges:
    """Where edges were seen: outer ones first, then inner ones, a ray each."""

    rays: F32  # (3, 2 n), z = 1
    seen: Mask  # (2 n,)
    blur_px: float  # sigma, as the slopes of the edges have it
    broad_px: float  # that of the broadest quarter: along a motion edges are broader
    in_image: Mask  # (2 n,)
    levels: F64  # (2, 2, n): edge; black, white


def edge_fit(image: U8, camera: CameraModel, ring: Ring, start: CirclePose) -> RingEdgeFit | None:
    """Return the pose whose edges are those in the image near a start; None if there is none.

    Args:
        image: grey image (height, width).
        camera: the lens.
        ring: its true size and ratio.
        start: a pose within a tenth of the radius.
    """
    pose, shift = start, 0.0
    radius_px = _radius_px(camera, ring, pose)
    for i in range(_COARSE_ROUNDS + _FINE_ROUNDS):
        is_coarse, before = i < _COARSE_ROUNDS, pose
        reach = 1.0 if is_coarse else min(1.0, _FINE_PX / (_INTO_WHITE * radius_px))
        edges = _edges(image, camera, ring, pose, reach)
        if edges is None or np.count_nonzero(edges.seen) < _MIN_RAYS:
            return None
        least = _COARSE_NOISE_PX if is_coarse else _LEAST_NOISE_PX
        fitted = _descended(edges, ring, camera, pose, shift, least)
        if fitted is None:
            return None
        pose, shift, noise, equations = fitted
        radius_px = _radius_px(camera, ring, pose)
        if is_coarse and not _has_support(edges, equations, radius_px):
            return None
        if not _MIN_RADIUS_PX < radius_px < 4.0 * max(image.shape):
            return None
        is_last = i == _COARSE_ROUNDS + _FINE_ROUNDS - 1
        if is_last or (not is_coarse and moved_px(camera, ring, before, pose) < _SETTLED_PX):
            return _judged(image, camera, ring, pose, shift, noise, edges, equations)
    return None


def _has_support(edges: _Edges, equations: "_Equations", radius_px: float) -> bool:
    """Tell whether a ring may come of a first round: most texture goes no further."""
    near = edges.seen & (np.abs(equations.residual) < max(_NEAR_PX, _COARSE_NEAR * radius_px))
    return bool(np.count_nonzero(near) > _COARSE_SUPPORT * np.count_nonzero(edges.in_image))


def moved_px(camera: CameraModel, ring: Ring, before: CirclePose, after: CirclePose) -> float:
    """Return about how far the edges were moved in the image from one pose to another."""
    way = (after[0] - before[0]) * (_radius_px(camera, ring, after) / ring.radius_m)
    way[2] *= ring.radius_m / float(after[0][2])
    return float(np.sqrt(way @ way))


def _radius_px(camera: CameraModel, ring: Ring, pose: CirclePose) -> float:
    return camera.focal * ring.radius_m / max(float(pose[0][2]), 1e-6)


def points_on(ring: Ring, pose: CirclePose) -> F64:
    """Return points (n, 3) of the outer edge, camera frame, m."""
    return _points(ring, pose, np.full(_RAYS, ring.radius_m))


def _points(ring: Ring, pose: CirclePose, radii: F64) -> F64:
    """Return points (..., rays, 3) on circles of radii (..., rays), camera frame, m."""
    _, axes = plane_axes(pose[0][None], pose[1][None])
    around = _CIRCLE @ axes[0, :2].astype(np.float64)
    points: F64 = pose[0] + radii[..., None] * around
    return points


def _sampled(
    image: U8, camera: CameraModel, ring: Ring, pose: CirclePose, radii: F64
) -> tuple[F64, Mask, F32] | None:
    """Return grey levels on circles (bands, circles), whether they are in the image, and pixels.

    Pixels are worked out for the first, the middle and the last circle of each band: a parabola
    through these gives the others. None, if any is behind the lens.
    """
    bands, n = radii.shape
    nodes = [0, n // 2, n - 1]
    points = _points(ring, pose, radii[:, nodes, None] + np.zeros(_RAYS))
    if float(points[..., 2].min()) < _NEAREST_M:
        return None
    at = camera.pixels(points.reshape(-1, 3)).reshape(bands, 3, _RAYS * 2)
    px = np.empty((bands, n, _RAYS * 2), dtype=np.float32)
    for band in range(bands):
        x = radii[band]
        a, b, c = x[nodes]
        basis = np.stack(
            [
                (x - b) * (x - c) / ((a - b) * (a - c)),
                (x - a) * (x - c) / ((b - a) * (b - c)),
                (x - a) * (x - b) / ((c - a) * (c - b)),
            ],
            axis=1,
        )
        px[band] = basis @ at[band]
    flat = px.reshape(bands * n, _RAYS, 2)
    h, w = image.shape
    inside = np.asarray(((flat >= 0.0) & (flat <= (w - 1, h - 1))).all(axis=-1))
    grey = cv2.remap(image, flat[..., 0], flat[..., 1], INTERP)
    shape = (bands, n, _RAYS)
    return grey.reshape(shape).astype(np.float64), inside.reshape(shape), px.reshape(*shape, 2)


def _edges(
    image: U8, camera: CameraModel, ring: Ring, pose: CirclePose, reach: float
) -> _Edges | None:
    """Return the edges within a share of the bands about a pose."""
    R, r = ring.radius_m, ring.radius_m * ring.inner_ratio
    along = np.linspace(-_INTO_BLACK, _INTO_WHITE, _SAMPLES) * (reach * R)
    sampled = _sampled(image, camera, ring, pose, np.stack([R + along, r - along]))
    if sampled is None:
        return None
    grey, inside, px = sampled
    black, white = _beside(grey[:, :_END].mean(axis=1)), _beside(grey[:, -_END:].mean(axis=1))
    found, rise, is_edge = crossing(grey, 0.5 * (black + white), along)
    in_image = inside.all(axis=1)
    seen = is_edge & in_image & is_step(black, white)
    across = px[:, -1] - px[:, 0]
    spacing = np.sqrt((across * across).sum(axis=-1)) / (_SAMPLES - 1)
    slope = rise / np.maximum(spacing, 1e-3)
    blurs = np.sort(((white - black) / slope)[seen]) / math.sqrt(2.0 * math.pi)
    n = len(blurs)
    blur, broad = (float(blurs[n // 2]), float(blurs[3 * n // 4])) if n else (0.0, 0.0)
    where = np.stack([R + found[0], r - found[1]])
    points = _points(ring, pose, where).reshape(-1, 3)
    rays = (points / points[:, 2:]).T.astype(np.float32)
    return _Edges(
        rays, seen.ravel(), blur, broad, in_image.ravel(), np.stack([black, white], axis=1)
    )


def _beside(level: F64) -> F64:
    """Return levels (edges, rays), each the median of its neighbours."""
    smooth: F64 = np.partition(level[:, _BESIDE], _LEVEL_RAYS, axis=2)[:, :, _LEVEL_RAYS]
    return smooth


@dataclass(frozen=True)
class _Equations:
    """Least squares about a pose."""

    residual: F64  # (2 n,), px
    weight: F64  # (2 n,)
    H: F64  # (7, 7): centre, tilt, shift, ratio; over the variance of an edge
    b: F64  # (7,), the right side
    scale: float  # of the variance, from the residuals
    axes: F32


def _descended(
    edges: _Edges,
    ring: Ring,
    camera: CameraModel,
    pose: CirclePose,
    shift: float,
    least_noise: float,
) -> tuple[CirclePose, float, float, _Equations] | None:
    """Return pose, shift and noise after some robust steps to the edges."""
    for _ in range(_DESCENTS):
        equations, noise = _normal_equations(edges, ring, camera, pose, shift, least_noise)
        stepped = _stepped(pose, equations, _SHIFT + 1)
        if stepped is None:
            return None
        pose, step = stepped
        shift += float(step[_SHIFT])
    return pose, shift, noise, equations


def _freed(
    edges: _Edges, ring: Ring, camera: CameraModel, pose: CirclePose, shift: float, noise: float
) -> Freed:
    """Return the ratio of the same edges, from a fit that was held to the ring's."""
    for _ in range(_FREED_DESCENTS):
        equations, noise = _normal_equations(edges, ring, camera, pose, shift, _LEAST_NOISE_PX)
        stepped = _stepped(pose, equations, _RATIO + 1)
        if stepped is None:
            break
        pose, step = stepped
        shift += float(step[_SHIFT])
        ratio = min(max(ring.inner_ratio + float(step[_RATIO]), _LEAST_RATIO), _MOST_RATIO)
        ring = ring.model_copy(update={"inner_ratio": ratio})
    return Freed(ring.inner_ratio, shift, noise)


def _stepped(pose: CirclePose, equations: _Equations, rows: int) -> tuple[CirclePose, F64] | None:
    """Return the pose after a step of the first unknowns, the others held, and the step.

    None: there is no step, or it is wild.
    """
    solved, column = cv2.solve(equations.H[:rows, :rows], equations.b[:rows, None])
    if not (solved and np.isfinite(column).all()):
        return None
    step: F64 = np.asarray(column[:, 0], dtype=np.float64)
    moved = _moved(pose, step, equations.axes)
    return None if moved is None else (moved, step)


def _moved(pose: CirclePose, step: F64, axes: F32) -> CirclePose | None:
    """Return a pose moved by a step on its plane's axes; None if that is wild."""
    t, normal = pose
    e = axes.astype(np.float64)
    moved = t + step[:3] @ e
    turned = normal + np.clip(step[3:5], -0.2, 0.2) @ e[:2]
    turned = turned / np.linalg.norm(turned)
    is_seen = float(turned @ moved) >= 0.15 * float(np.linalg.norm(moved))
    return (moved, turned) if 0.5 * t[2] < moved[2] < 2.0 * t[2] and is_seen else None


def _normal_equations(
    edges: _Edges,
    ring: Ring,
    camera: CameraModel,
    pose: CirclePose,
    shift: float,
    least_noise: float,
) -> tuple[_Equations, float]:
    """Return the equations about a pose, and the noise of edges, px."""
    focal = camera.focal
    t32, axes = plane_axes(pose[0][None], pose[1][None])
    g = PlaneView(edges.rays, focal, t32, axes)
    n = _RAYS
    radii = np.repeat([ring.radius_m, ring.radius_m * ring.inner_ratio], n)
    inwards = np.repeat([1.0, -1.0], n)  # a shift into the black
    scale = g.scale[0].astype(np.float64)
    # Blur moves a bent edge towards its centre of curvature.
    area, _ = g.curvature()
    bend = (
        0.5
        * area[0] ** 2
        / (radii * scale**3)
        * min(_true_blur_px(edges, shift), 0.1 * ring.radius_m / float(scale.min())) ** 2
    )
    residual = (g.rho[0] - radii) / scale + bend + inwards * shift
    J = np.empty((_RATIO + 1, 2 * n))
    J[:3] = g.u[0] / scale
    J[3:5] = (g.a[0] * g.rho[0])[None] * g.u[0, :2] / scale
    J[_SHIFT] = -inwards
    J[_RATIO] = np.repeat([0.0, ring.radius_m], n) / scale
    off = np.abs(residual[edges.seen])
    middle = len(off) // 2
    noise = max(least_noise, SIGMA_PER_MAD * float(np.partition(off, middle)[middle]))
    u = (residual / (ROBUST_SIGMAS * noise)) ** 2
    weight = edges.seen / (1.0 + u) ** 2
    H = (J * weight) @ J.T / noise**2
    b = (J * weight) @ residual / noise**2
    H[3, 3] += 1.0
    H[4, 4] += 1.0
    H[_SHIFT, _SHIFT] += 1.0 / _SHIFT_SIGMA_PX**2
    b[_SHIFT] -= shift / _SHIFT_SIGMA_PX**2
    used = float(weight.sum())
    spread = float((weight * residual**2).sum()) / max(used - 6.0, 4.0) / noise**2
    return _Equations(residual, weight, H, b, spread, axes[0]), noise


def _true_blur_px(edges: _Edges, shift_px: float) -> float:
    """Return the blur before white was clipped: what is left of it looks sharp, but lies aside."""
    return max(edges.blur_px, shift_px / _CLIPPED_SHIFT_BLURS)


def _judged(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    pose: CirclePose,
    shift: float,
    noise: float,
    edges: _Edges,
    equations: _Equations,
) -> RingEdgeFit:
    """Return the fit with what tells whether it is of a ring."""
    radius_px = _radius_px(camera, ring, pose)
    off = np.abs(equations.residual)
    reach = min(_NEAR_PX, _NEAR_SMALL * radius_px) + _NEAR_SHARE * radius_px
    near = edges.seen & (off < reach)
    there = np.maximum(edges.in_image.reshape(2, _RAYS).sum(axis=1), 1)
    support = near.reshape(2, _RAYS).sum(axis=1) / there
    dark, bright, ridge = _areas(image, camera, ring, pose, edges, max(shift, 0.0) / radius_px)
    few = _dependence(equations, radius_px * (1.0 + ring.inner_ratio) / 2.0)
    covariance = inverse(equations.H[:_RATIO, :_RATIO]) * max(equations.scale, 0.3) * few
    seen = edges.seen.reshape(2, _RAYS)
    levels = (
        _median(edges.levels[1, 1], seen[1]),
        _median(edges.levels[:, 0], seen),
        _median(edges.levels[0, 1], seen[0]),
    )
    beside = [(*edges.levels[i], seen[i]) for i in (0, 1)]
    contrast = [_median(white - black, there) for black, white, there in beside]
    depth = [_median(1.0 - black / np.maximum(white, 1.0), there) for black, white, there in beside]
    return RingEdgeFit(
        position=pose[0],
        normal=pose[1],
        shift_px=shift,
        sigma_shift=math.sqrt(float(covariance[5, 5])),
        noise_px=noise,
        blur_px=edges.blur_px,
        broad_px=edges.broad_px,
        radius_px=radius_px,
        support=(float(support[0]), float(support[1])),
        visible=float(edges.in_image.mean()),
        cos_tilt=float(pose[1] @ pose[0]) / float(np.linalg.norm(pose[0])),
        ridge=ridge,
        dark=dark,
        bright=bright,
        residual=np.where(edges.seen, equations.residual, np.nan),
        dependence=few,
        covariance=covariance[:5, :5],
        levels=levels,
        shaded=_ranked(edges.levels[0, 1][seen[0]], _SHADED_SHARE),
        clean=_ranked(edges.levels[1, 1][seen[1]], 1.0 - _SHADED_SHARE),
        contrast=(contrast[0], contrast[1]),
        depth=(depth[0], depth[1]),
        uneven=_uneven(edges.levels[0, 1][seen[0]]),
        freed=partial(_freed, edges, ring, camera, pose, shift, noise),
    )


def _uneven(white: F64) -> float:
    """Return how far four fifths of some levels reach, over their middle."""
    if not len(white):
        return 0.0
    low, middle, high = np.percentile(white, (10.0, 50.0, 90.0))
    return float(high - low) / max(float(middle), 1.0)


def _median(values: F64, where: Mask) -> float:
    return float(medians(values[where][None])[0]) if where.any() else 0.0


def _ranked(levels: F64, share: float) -> float:
    """Return the level that such a share is darker than."""
    return float(np.sort(levels)[int(share * len(levels))]) if len(levels) else 0.0


def _dependence(equations: _Equations, radius_px: float) -> float:
    """Return how many times fewer edges than rays there are, as far as information goes.

    Neighbouring rays of a small ring see the same pixels; and what a soft shadow or bent paper does
    to an edge it does to the next one, too: of errors with correlation c from ray to ray, the sum
    of many has (1 + c) / (1 - c) times the variance.
    """
    r = (equations.residual * np.sqrt(equations.weight)).reshape(2, _RAYS)
    total = float((r * r).sum())
    correlation = float((r * np.roll(r, 1, axis=1)).sum()) / max(total, 1e-12)
    c = min(max(correlation, 0.0), _MOST_CORRELATED)
    return max((1.0 + c) / (1.0 - c), _RAYS * _INDEPENDENT_PX / (2.0 * math.pi * radius_px))


_LEAST_STROKE = 0.1  # over the radius
_STROKE_RADII = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85)  # from inner to outer edge
_HOLE_RADII = (0.1, 0.35, 0.55, 0.7)  # of the inner edge
_MARGIN_RADII = (1.08, 1.13)
_MOST_HALO = 0.2  # of the contrast: 0.19 in strongly sharpened pictures; dirt in the hole is none


def _areas(
    image: U8, camera: CameraModel, ring: Ring, pose: CirclePose, edges: _Edges, spread: float
) -> tuple[float, float, float]:
    """Return the shares of the stroke that is dark and of the white that is bright, and the ridge.

    The last: what rises within the stroke, between its edges, as in targets of several rings, and
    more than the hole sinks within its edge.
    `spread` is what the white has taken of the stroke on either side, over the radius.
    """
    R, k = ring.radius_m, ring.inner_ratio
    left = max(_LEAST_STROKE, 1.0 - k - 2.0 * spread)
    inner_edge = 0.5 * (1.0 + k - left)
    shares = [k * s for s in _HOLE_RADII] + [inner_edge + left * s for s in _STROKE_RADII]
    shares += _MARGIN_RADII
    sampled = _sampled(image, camera, ring, pose, R * np.array([shares]))
    if sampled is None:
        return 0.0, 0.0, 1.0
    grey, inside, _ = (part[0] for part in sampled)
    outer, inner = edges.levels.mean(axis=1)  # half-way beside each edge
    hole, stroke = len(_HOLE_RADII), len(_STROKE_RADII)
    limit = np.where((np.arange(len(shares)) < hole + stroke // 2)[:, None], inner, outer)
    is_dark = grey < limit
    white = np.r_[:hole, hole + stroke : len(shares)]
    black = np.r_[hole : hole + stroke]
    dark = float(is_dark[black][inside[black]].mean()) if inside[black].any() else 0.0
    bright = float((~is_dark[white])[inside[white]].mean()) if inside[white].any() else 0.0
    seen = inside[black].all(axis=0)
    if not seen.any():
        return dark, bright, 1.0
    # Over the black beside either edge, that a shadow across the stroke is no ridge.
    beside = edges.levels[:, 0].max(axis=0)[seen]
    contrast = (edges.levels[:, 1].max(axis=0)[seen] - beside).clip(min=1.0)
    level = medians((grey[black][:, seen] - beside) / contrast)
    # A camera that sharpens darkens the stroke along its edges, and brightens the white there.
    middle, *_, near = grey[:hole, seen] / contrast
    is_seen = inside[:hole, seen].all(axis=0)
    halo = min(_MOST_HALO, max(0.0, _median(near - middle, is_seen)))
    return dark, bright, max(0.0, rise_within(level) - halo)


def rise_within(level: F64) -> float:
    """Return by how much a profile (n,) rises over the least on either side of a place, at most."""
    before = np.minimum.accumulate(level)
    after = np.minimum.accumulate(level[::-1])[::-1]
    return float((level - np.maximum(before, after)).max())
