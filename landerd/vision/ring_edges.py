"""Fit of a ring's pose to the places of its two edges, whatever its grey levels do.

Edges are looked for along rays from the centre, each between the black and the white beside it. A
shadow dims both alike. Under any monotone tone curve, clipped white included, edges keep their
place except for a shift towards black or white that is the same all around; it is fitted together
with the pose, and the known ratio of the ring distinguishes it from the range. Only behind such a
curve does a motion move edges: those across its way further into the black than those along. Rays
on which a leg, dirt or glare lies are outliers.

This is the fit behind `ring_explained`, which decides whether the edges are a ring's.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
import numpy.ma  # np.median loads it when first called: 40 ms, in flight
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.pad import Ring
from landerd.vision.arrays import F32, U8, Mask
from landerd.vision.edge_profile import ROBUST_SIGMAS, SIGMA_PER_MAD, crossing, is_step, medians
from landerd.vision.linear import inverse
from landerd.vision.ring_pixels import PlaneView, pose_axes
from landerd.vision.ring_pose import CirclePose

INTERP = cv2.INTER_CUBIC
_RAYS = 64
_SAMPLES = 25  # grey levels across an edge, on each ray
_ANGLES = np.arange(_RAYS) * (2.0 * math.pi / _RAYS)
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
# Reach of the bands across the edges into black and into white, in radii: half of the thesis's
# stroke, and less than its margin; of a thinner stroke half. In the last rounds they are reduced to
# this into the white, px.
_INTO_BLACK, _INTO_WHITE = 0.27, 0.2
_FINE_PX = 4.0
_COARSE_ROUNDS, _FINE_ROUNDS = 1, 2  # a round looks for edges about a pose and fits it to them
_DESCENTS = 2  # Gauss-Newton steps in one round
# Rows of a step, after those of centre and tilt; and which of them are fitted as a rule, with the
# ratio free, and with a motion.
_SHIFT, _RATIO, _MOTION, _ROWS = 5, 6, slice(7, 9), 9
_Rows = slice | NDArray[np.intp]
_HELD, _FREE, _MOVED = slice(0, 6), slice(0, 7), np.r_[0:6, 7:9]
_FREED_DESCENTS = 4  # steps with the ratio or a motion fitted as well
_LEAST_RATIO, _MOST_RATIO = 0.1, 0.95
_SETTLED_PX = 0.1  # a round that moves the edges by less is the last
# Least share of the rays whose edge is near the fitted one after the first round, and how near, a
# share of the radius: rings in all kinds of light gave 0.65 and more, half of the textures less
# than 0.6.
_COARSE_SUPPORT, _COARSE_NEAR = 0.6, 0.09
_END = 5  # samples at either end of a band whose mean is black or white
_LEVEL_RAYS = 2  # neighbours to either side with which a ray takes the median of black and white
_BESIDE = (np.arange(_RAYS)[:, None] + np.arange(-_LEVEL_RAYS, _LEVEL_RAYS + 1)) % _RAYS
_COARSE_NOISE_PX, _LEAST_NOISE_PX = 0.3, 0.04  # least noise of edges: in the first round, later
# Sigma of the shift by a tone curve, and of a motion's part of it, before anything is seen.
_SHIFT_SIGMA_PX, _MOTION_SIGMA_PX = 0.5, 2.0
# Noise of edges, px, from which on a motion is looked for. It explains them if the noise is less
# than the second times that without it, and edges across it are blurred more than those along: by
# the third, a factor, and by the fourth times its part of the shift. 75 rings that moved by 4 to 15
# px behind a gamma of 2.2 or with white up to 2.5 times over full scale gave a factor of 1.12 at
# least, one 1.09; oblique rings of another ratio and letters in clipped white 1.09 at most, one
# letter 1.14.
_RESTLESS_PX, _MOTION_NOISE, _MOTION_BROADER, _MOTION_BLUR = 0.2, 0.8, 1.1, 0.3
_LEAST_EDGES = 6  # across a motion, and along it
# Shift by white that is 2.5 to 5 times over full scale, in blurs.
_CLIPPED_SHIFT_BLURS = 1.3
# Share of the rays: a shadow as wide as a ring's hole dims as many of those beyond the ring, and
# dirt leaves as many of a hole's clean.
_SHADED_SHARE = 0.12
_NEAREST_M = 1e-3  # least depth of a point that is projected
_MIN_RADIUS_PX = 3.0
_MIN_RAYS = 20  # with an edge, outer and inner ones together
# An edge counts as in place within a distance: the smaller of the first, px, and the second, a
# share of the radius, plus the third, a share of the radius.
_NEAR_PX, _NEAR_SMALL, _NEAR_SHARE = 0.45, 0.03, 0.015
_INDEPENDENT_PX = 2.0  # distance along an edge from which on pixels do not share a blur
_MOST_CORRELATED = 0.95


@dataclass(frozen=True)
class RingEdgeFit:
    """A pose fitted to a ring's edges, and how much of the ring they show."""

    position: F64  # (3,), m
    normal: F64  # (3,)
    shift_px: float  # of both edges, into the black; in motion that of the edges along its way
    sigma_shift: float  # px
    motion_px: float  # amplitude of the shift by direction, in motion; 0: there is none
    noise_px: float  # robust sigma of the edges' residuals
    blur_px: float  # sigma, by the slopes of the edges; the median, in motion of those along it
    broad_px: float  # the same of the broadest quarter of the edges
    radius_px: float
    support: tuple[float, float]  # share of the rays in the image with an edge: outer, inner
    visible: float  # share of the rays that are in the image
    cos_tilt: float  # of the angle between normal and line of sight
    ridge: float  # height of a brighter circle within the stroke, over the contrast
    dark: float  # share of the stroke that is darker than half-way to the white beside it
    bright: float  # share of hole and margin brighter than half-way to the black beside them
    residual: F64  # (2 rays,), outer then inner edges, px; NaN where none is seen
    dependence: float  # number of rays over that of independent edges
    covariance: F64  # (5, 5) of centre and tilt on the plane's axes, m^2, m rad, rad^2
    levels: tuple[float, float, float]  # grey levels inside, of the black, outside
    darkest: float  # level of the stroke on the circle where it is darkest
    shaded: float  # level of the darkest part outside: the white there, if a shadow crosses it
    clean: float  # level of the brightest part inside: the white there, if dirt hides most of it
    # Contrast from each edge's black to its white, whatever the light: outer edges, inner ones.
    contrast: tuple[float, float]  # grey levels
    depth: tuple[float, float]  # as a share of the white
    uneven: float  # change of light about the ring: white from its 10 to its 90 %, over its median
    freed: Callable[[], "Freed"]  # the fit without motion, the ratio free, computed on demand


@dataclass(frozen=True)
class Freed:
    """The fit to the same edges with the ratio fitted as well."""

    ratio: float  # inner over outer diameter
    shift_px: float  # of both edges, into the black
    noise_px: float


@dataclass(frozen=True)
class _Edges:
    """Where edges were seen: for each of n rays the outer edges first, then the inner ones."""

    rays: F32  # lines of sight of the edges, (3, 2 n), z = 1
    seen: Mask  # (2 n,)
    blurs_px: F64  # sigma, by the slope of each edge, (2 n,); anything where none is seen
    blur_px: float  # sigma, by the slopes of the edges; the median
    broad_px: float  # the same of the broadest quarter: along a motion edges are broader
    in_image: Mask  # (2 n,)
    levels: F64  # grey levels (2, 2, n): outer and inner edge; black and white


def edge_fit(image: U8, camera: CameraModel, ring: Ring, start: CirclePose) -> RingEdgeFit | None:
    """Return the pose whose edges are those in the image near a start; None: there are too few.

    Args:
        image: grey image (height, width).
        camera: the lens.
        ring: its true size and ratio.
        start: a pose under which edges are off by a tenth of the radius at most.
    """
    at = _Estimate(start)
    radius_px = _radius_px(camera, ring, start)
    for i in range(_COARSE_ROUNDS + _FINE_ROUNDS):
        is_coarse, before = i < _COARSE_ROUNDS, at.pose
        reach = 1.0 if is_coarse else min(1.0, _FINE_PX / (_INTO_WHITE * radius_px))
        edges = _edges(image, camera, ring, before, reach)
        if edges is None or np.count_nonzero(edges.seen) < _MIN_RAYS:
            return None
        least = _COARSE_NOISE_PX if is_coarse else _LEAST_NOISE_PX
        fitted = _descended(edges, ring, camera, at, least)
        if fitted is None:
            return None
        at, noise, equations = fitted
        radius_px = _radius_px(camera, ring, at.pose)
        if is_coarse and not _has_support(edges, equations, radius_px):
            return None
        if not _MIN_RADIUS_PX < radius_px < 4.0 * max(image.shape):
            return None
        is_last = i == _COARSE_ROUNDS + _FINE_ROUNDS - 1
        if is_last or (not is_coarse and moved_px(camera, ring, before, at.pose) < _SETTLED_PX):
            freed = partial(_freed, edges, ring, camera, at, noise)
            moving = _in_motion(edges, ring, camera, at, noise) if noise > _RESTLESS_PX else None
            if moving is not None:
                at, noise, equations, edges = moving
            return _judged(image, camera, ring, at, noise, edges, equations, freed)
    return None


def _has_support(edges: _Edges, equations: "_Equations", radius_px: float) -> bool:
    """Tell whether the first round may lead to a ring: most texture goes no further."""
    near = edges.seen & (np.abs(equations.residual) < max(_NEAR_PX, _COARSE_NEAR * radius_px))
    return bool(np.count_nonzero(near) > _COARSE_SUPPORT * np.count_nonzero(edges.in_image))


def moved_px(camera: CameraModel, ring: Ring, before: CirclePose, after: CirclePose) -> float:
    """Return about how far a ring's edges move in the image from one pose to another, px."""
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
    _, axes = pose_axes(pose)
    around = _CIRCLE @ axes[0, :2].astype(np.float64)
    points: F64 = pose[0] + radii[..., None] * around
    return points


def _sampled(
    image: U8, camera: CameraModel, ring: Ring, pose: CirclePose, radii: F64
) -> tuple[F64, Mask, F32] | None:
    """Return grey levels on circles of radii (bands, circles), m; None: some are behind the lens.

    Pixels are projected for the first, the middle and the last circle of each band; a parabola
    through these gives the others.

    Returns:
        grey levels and whether they are in the image, (bands, circles, rays), and their pixels,
        (bands, circles, rays, 2).
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
    """Return the edges in the image about a pose, within a share `reach` of the bands."""
    R, r = ring.radius_m, ring.radius_m * ring.inner_ratio
    into_black = min(reach * _INTO_BLACK, 0.5 * (1.0 - ring.inner_ratio))
    along = np.linspace(-into_black, reach * _INTO_WHITE, _SAMPLES) * R
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
    of_edges = (white - black) / slope / math.sqrt(2.0 * math.pi)
    blurs = np.sort(of_edges[seen])
    n = len(blurs)
    blur, broad = (float(blurs[n // 2]), float(blurs[3 * n // 4])) if n else (0.0, 0.0)
    where = np.stack([R + found[0], r - found[1]])
    points = _points(ring, pose, where).reshape(-1, 3)
    rays = (points / points[:, 2:]).T.astype(np.float32)
    return _Edges(
        rays,
        seen.ravel(),
        of_edges.ravel(),
        blur,
        broad,
        in_image.ravel(),
        np.stack([black, white], axis=1),
    )


def _beside(level: F64) -> F64:
    """Return levels (edges, rays), each the median of itself and its neighbours."""
    smooth: F64 = np.partition(level[:, _BESIDE], _LEVEL_RAYS, axis=2)[:, :, _LEVEL_RAYS]
    return smooth


@dataclass(frozen=True)
class _Equations:
    """The least squares problem linearised about a pose."""

    residual: F64  # of outer and inner edges, (2 n,), px
    weight: F64  # (2 n,)
    H: F64  # normal matrix (9, 9) of centre, tilt, shift, ratio, motion; over an edge's variance
    b: F64  # right side, (9,)
    scale: float  # variance of the weighted residuals, over that of an edge
    axes: F32  # of the ring's plane, (3, 3)


@dataclass(frozen=True)
class _Estimate:
    """What is fitted to edges."""

    pose: CirclePose
    shift: float = 0.0  # of both edges, into the black, px; the mean of all directions
    # More of it for edges whose normal lies along the image's x, and along the diagonal between x
    # and y, px, (2,): less for those across.
    motion: F64 = field(default_factory=lambda: np.zeros(2))


def _descended(
    edges: _Edges,
    ring: Ring,
    camera: CameraModel,
    at: _Estimate,
    least_noise: float,
    rows: _Rows = _HELD,
    steps: int = _DESCENTS,
) -> tuple[_Estimate, float, _Equations] | None:
    """Return estimate, noise (px) and equations after some robust steps; None: one fails."""
    for _ in range(steps):
        equations, noise = _normal_equations(edges, ring, camera, at, least_noise)
        stepped = _stepped(at, equations, rows)
        if stepped is None:
            return None
        at, _ = stepped
    return at, noise, equations


def _freed(edges: _Edges, ring: Ring, camera: CameraModel, at: _Estimate, noise: float) -> Freed:
    """Return the fit of the same edges with the ratio free, from one that held it at the ring's."""
    for _ in range(_FREED_DESCENTS):
        equations, noise = _normal_equations(edges, ring, camera, at, _LEAST_NOISE_PX)
        stepped = _stepped(at, equations, _FREE)
        if stepped is None:
            break
        at, step = stepped
        ratio = min(max(ring.inner_ratio + float(step[_RATIO]), _LEAST_RATIO), _MOST_RATIO)
        ring = ring.model_copy(update={"inner_ratio": ratio})
    return Freed(ring.inner_ratio, at.shift, noise)


def _in_motion(
    edges: _Edges, ring: Ring, camera: CameraModel, at: _Estimate, noise: float
) -> tuple[_Estimate, float, _Equations, _Edges] | None:
    """Return a fit to the same edges in motion behind a tone curve or beside clipped white.

    There the moving white hides more of the black than it uncovers: edges across the way are
    shifted further than those along it. None: that does not explain them much better, or edges
    across are not as much broader than those along as a motion makes them.
    """
    before = noise
    fitted = _descended(edges, ring, camera, at, _LEAST_NOISE_PX, _MOVED, _FREED_DESCENTS)
    if fitted is None:
        return None
    at, noise, equations = fitted
    size = float(np.hypot(*at.motion))
    t32, axes = pose_axes(at.pose)
    turn = (at.motion / max(size, 1e-9)) @ _turns(PlaneView(edges.rays, camera.focal, t32, axes))
    across, along = (edges.blurs_px[edges.seen & (s * turn > 0.5)] for s in (1.0, -1.0))
    if noise > _MOTION_NOISE * before or min(len(across), len(along)) < _LEAST_EDGES:
        return None
    wide, sharp = float(np.median(across)), float(np.median(along))
    if wide < max(_MOTION_BROADER * sharp, math.hypot(sharp, _MOTION_BLUR * size)):
        return None
    return at, noise, equations, replace(edges, blur_px=sharp)


def _turns(g: PlaneView) -> F64:
    """Return cosine and sine, (2, n), of twice the angle of the edges' normals to the x axis."""
    x, y = g.across()[0].astype(np.float64)
    return np.stack([x * x - y * y, 2.0 * x * y])


def _stepped(at: _Estimate, equations: _Equations, rows: _Rows) -> tuple[_Estimate, F64] | None:
    """Return the estimate after a step of some of the unknowns, the others held, and the step.

    The step is (9,). None: the equations are singular, or the step is implausible.
    """
    H = np.ascontiguousarray(equations.H[rows][:, rows])
    solved, column = cv2.solve(H, equations.b[rows, None])
    if not (solved and np.isfinite(column).all()):
        return None
    step = np.zeros(_ROWS)
    step[rows] = column[:, 0]
    pose = _moved(at.pose, step, equations.axes)
    if pose is None:
        return None
    return _Estimate(pose, at.shift + float(step[_SHIFT]), at.motion + step[_MOTION]), step


def _moved(pose: CirclePose, step: F64, axes: F32) -> CirclePose | None:
    """Return a pose moved by a step on its plane's axes; None: the step is implausible.

    It halves or doubles the depth, or turns the ring nearly edge-on.
    """
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
    at: _Estimate,
    least_noise: float,
) -> tuple[_Equations, float]:
    """Return the linearised problem about an estimate, and the noise of edges, px."""
    focal, shift = camera.focal, at.shift
    t32, axes = pose_axes(at.pose)
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
    turns = _turns(g)
    residual = (g.rho[0] - radii) / scale + bend + inwards * (shift + at.motion @ turns)
    J = np.empty((_ROWS, 2 * n))
    J[_MOTION] = -inwards * turns
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
    H[_MOTION, _MOTION] += np.eye(2) / _MOTION_SIGMA_PX**2
    b[_MOTION] -= at.motion / _MOTION_SIGMA_PX**2
    used = float(weight.sum())
    spread = float((weight * residual**2).sum()) / max(used - 6.0, 4.0) / noise**2
    return _Equations(residual, weight, H, b, spread, axes[0]), noise


def _true_blur_px(edges: _Edges, shift_px: float) -> float:
    """Return the sigma of the blur before white was clipped.

    Edges of clipped white look sharp but are shifted: the shift tells the blur they had.
    """
    return max(edges.blur_px, shift_px / _CLIPPED_SHIFT_BLURS)


def _judged(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    at: _Estimate,
    noise: float,
    edges: _Edges,
    equations: _Equations,
    freed: Callable[[], Freed],
) -> RingEdgeFit:
    """Return the fit with everything that tells whether it is of a ring."""
    pose, motion = at.pose, float(np.hypot(*at.motion))
    shift = at.shift - motion
    radius_px = _radius_px(camera, ring, pose)
    off = np.abs(equations.residual)
    reach = min(_NEAR_PX, _NEAR_SMALL * radius_px) + _NEAR_SHARE * radius_px
    near = edges.seen & (off < reach)
    there = np.maximum(edges.in_image.reshape(2, _RAYS).sum(axis=1), 1)
    support = near.reshape(2, _RAYS).sum(axis=1) / there
    areas = _areas(image, camera, ring, pose, edges, max(at.shift + motion, 0.0) / radius_px)
    few = _dependence(equations, radius_px * (1.0 + ring.inner_ratio) / 2.0)
    rows = _MOVED if motion else _HELD
    covariance = inverse(equations.H[rows][:, rows]) * max(equations.scale, 0.3) * few
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
        motion_px=motion,
        noise_px=noise,
        blur_px=edges.blur_px,
        broad_px=edges.broad_px,
        radius_px=radius_px,
        support=(float(support[0]), float(support[1])),
        visible=float(edges.in_image.mean()),
        cos_tilt=float(pose[1] @ pose[0]) / float(np.linalg.norm(pose[0])),
        ridge=areas.ridge,
        dark=areas.dark,
        bright=areas.bright,
        residual=np.where(edges.seen, equations.residual, np.nan),
        dependence=few,
        covariance=covariance[:5, :5],
        levels=levels,
        darkest=areas.darkest,
        shaded=_ranked(edges.levels[0, 1][seen[0]], _SHADED_SHARE),
        clean=_ranked(edges.levels[1, 1][seen[1]], 1.0 - _SHADED_SHARE),
        contrast=(contrast[0], contrast[1]),
        depth=(depth[0], depth[1]),
        uneven=_uneven(edges.levels[0, 1][seen[0]]),
        freed=freed,
    )


def _uneven(white: F64) -> float:
    """Return the range of the middle four fifths of some levels, over their median."""
    if not len(white):
        return 0.0
    low, middle, high = np.percentile(white, (10.0, 50.0, 90.0))
    return float(high - low) / max(float(middle), 1.0)


def _median(values: F64, where: Mask) -> float:
    return float(medians(values[where][None])[0]) if where.any() else 0.0


def _ranked(levels: F64, share: float) -> float:
    """Return the level that this share of the levels is darker than."""
    return float(np.sort(levels)[int(share * len(levels))]) if len(levels) else 0.0


def _dependence(equations: _Equations, radius_px: float) -> float:
    """Return the number of rays over that of independent edges.

    Neighbouring rays of a small ring see the same pixels, and a soft shadow or bent paper displaces
    neighbouring edges alike. The sum of many errors with correlation c from ray to ray has
    (1 + c) / (1 - c) times the variance of independent ones.
    """
    r = (equations.residual * np.sqrt(equations.weight)).reshape(2, _RAYS)
    total = float((r * r).sum())
    correlation = float((r * np.roll(r, 1, axis=1)).sum()) / max(total, 1e-12)
    c = min(max(correlation, 0.0), _MOST_CORRELATED)
    return max((1.0 + c) / (1.0 - c), _RAYS * _INDEPENDENT_PX / (2.0 * math.pi * radius_px))


# Circles on which areas are judged: in the stroke, shares of its width from the inner edge; in the
# hole, shares of its radius; in the margin, of the outer radius.
_LEAST_STROKE = 0.1  # width that is left of the stroke at least, over the radius
_STROKE_RADII = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85)
_HOLE_RADII = (0.1, 0.35, 0.55, 0.7)
_MARGIN_RADII = (1.08, 1.13)
# Largest halo of a sharpened picture, over the contrast: 0.19 in strongly sharpened ones. More is
# dirt in the hole.
_MOST_HALO = 0.2


class _Areas(NamedTuple):
    """What the areas between a ring's edges show; see `RingEdgeFit`."""

    dark: float
    bright: float
    ridge: float = 1.0
    darkest: float = 0.0


def _areas(
    image: U8, camera: CameraModel, ring: Ring, pose: CirclePose, edges: _Edges, spread: float
) -> _Areas:
    """Return what the areas between the edges show; see `RingEdgeFit`.

    The ridge is how far levels rise within the stroke, between its edges, over the contrast, as in
    targets of several rings. The halo of sharpening, how far levels in the hole rise towards its
    edge, is subtracted from it.

    Args:
        image: grey image (height, width).
        camera: the lens.
        ring: its true size and ratio.
        pose: as fitted.
        edges: of that pose.
        spread: how much of the stroke clipped white has taken on either side, over the radius.
    """
    R, k = ring.radius_m, ring.inner_ratio
    left = max(_LEAST_STROKE, 1.0 - k - 2.0 * spread)
    inner_edge = 0.5 * (1.0 + k - left)
    shares = [k * s for s in _HOLE_RADII] + [inner_edge + left * s for s in _STROKE_RADII]
    shares += _MARGIN_RADII
    sampled = _sampled(image, camera, ring, pose, R * np.array([shares]))
    if sampled is None:
        return _Areas(0.0, 0.0)
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
        return _Areas(dark, bright)
    # Relative to the brighter black of both edges, so that a shadow across the stroke is no ridge.
    beside = edges.levels[:, 0].max(axis=0)[seen]
    contrast = (edges.levels[:, 1].max(axis=0)[seen] - beside).clip(min=1.0)
    stroke_grey = grey[black][:, seen]
    level = medians((stroke_grey - beside) / contrast)
    # A camera that sharpens darkens the stroke along its edges, and brightens the white there.
    middle, *_, near = grey[:hole, seen] / contrast
    is_seen = inside[:hole, seen].all(axis=0)
    halo = min(_MOST_HALO, max(0.0, _median(near - middle, is_seen)))
    ridge = max(0.0, rise_within(level) - halo)
    return _Areas(dark, bright, ridge, float(medians(stroke_grey).min()))


def rise_within(level: F64) -> float:
    """Return the height of a profile's (n,) highest ridge above the lowest levels on both sides."""
    before = np.minimum.accumulate(level)
    after = np.minimum.accumulate(level[::-1])[::-1]
    return float((level - np.maximum(before, after)).max())
