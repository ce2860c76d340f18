"""Fit of a ring's pose to the grey levels near its two edges.

Gauss-Newton on centre, normal, blur, levels and light of a `RingModel`, and on motion or the
camera's response where asked for, with robust weights against what the model leaves out (occlusion,
the plate's edge). `ring_fit_stages` says which pixels and starts a fit gets, `ring_checks` what it
must show to be a ring's.

Several starts are fitted side by side: arrays have one row for each. "Noise" is the robust sigma of
the residuals.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.geometry import Vec3, add, dot, rotate, scale, transpose, unit
from landerd.messages import GREY
from landerd.pad import Ring
from landerd.vision.arrays import F32, Mask
from landerd.vision.edge_profile import SIGMA_PER_MAD
from landerd.vision.linear import length
from landerd.vision.patch import FULL_SCALE, WHITE_START
from landerd.vision.pose import vec3
from landerd.vision.ring_covariance import (
    clipped_covariance,
    motion_covariance,
    pose_uncertainty,
    shift_covariance,
)
from landerd.vision.ring_model import (
    ASTIGMATISM,
    BLUR,
    HEIGHTS,
    INSIDE,
    MIN_BLUR_PX,
    MOTION,
    RATIO,
    RESPONSE,
    TILT,
    RingModel,
)
from landerd.vision.ring_pixels import Pixels, plane_axes
from landerd.vision.ring_pose import CirclePose
from landerd.vision.ring_response import RESPONSE_SIGMAS, bounded_response

# Where nothing else is said, the numbers were set by trial on the images of `bench.vision_ring`.
_MAX_BLUR_PX = 12.0  # sigma
_MAX_MOTION_PX = 30.0  # components of the path along x and y
# Reductions of chi-square by a step (a step of one sigma reduces it by 1). Below the first, small
# rings are supersampled; below the second, another step is not worth its time.
_SUPERSAMPLED_BELOW = 30.0
_CONVERGED = 1.0
# By how much one step divides the blur's variance at most: a longer step leads to edges so sharp
# that it takes three more steps back.
_BLUR_STEP = 2.0
# Where white is clipped: factor on the number of steps; and one step multiplies the variance by no
# more than it divides it. The fit has to learn how far white is over full scale together with it.
_CLIPPED_STEPS = 3
# After so many of these steps the fit is given up if its noise is more than this share of the
# contrast: of 124 rings beside clipped white none had more than 0.07 then, and 0.06 in the end; of
# what looks like one in drawings and photographs of products half had more.
_TRIED_STEPS, _HOPELESS_NOISE = 3, 0.15
# A start whose noise is more than this times the least of all starts is not fitted further: it will
# not become the best.
_RIVAL_NOISE = 1.5
_MIN_COS = 0.15  # of the angle between normal and line of sight: up to 81 degrees are fitted
_MIN_NOISE = 0.5  # grey levels: rounding alone leaves 0.29
_ROBUST_SIGMAS = 3.0  # residuals beyond it count less (Geman and McClure's weights)
# Variance of a fit with these weights to normal noise, over what weighted information and residuals
# say: E[psi^2] / E[psi']^2 over E[w r^2] / E[w]^2, psi = w r (Huber, "Robust Statistics", 1981,
# section 6.3).
_ROBUST_VARIANCE = 1.27
# Sigma of the difference between the white inside and around, as a share of white; the same where
# clipped white makes the light's curvature a parameter, with sigma of that, a share in one radius;
# and the least white, grey levels, that the difference is taken of.
_PAPER_SIGMA = 0.06
_EVEN_PAPER_SIGMA, _CURVATURE_SIGMA = 0.02, 0.03
_LEAST_WHITE = 10.0
_ASTIGMATISM_SIGMA = 0.3  # px^2
_TILT_STEP = 0.2  # rad: steps of the tilt are damped as if it were known to this
_DEPTH_STEP, _ASIDE_STEP = 0.25, 0.3  # longest steps: a share of the depth; aside, in radii
_MIN_RANGE_M = 0.02  # least depth that a step may lead to
# A pixel is explained if its residual is below the first, grey levels, or below this share of the
# contrast.
_EXPLAINED, _EXPLAINED_SHARE = 8.0, 0.1


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
    explained: Callable[[], float]  # returns `inliers`: computed on demand
    # Returns the covariance of the position (3, 3), m^2, and sigma of the tilt, rad: computed on
    # demand, as most fits' are never asked for.
    uncertainty: Callable[[], tuple[F64, float]]
    ratio: float  # inner over outer diameter as the pixels tell it
    sigma_ratio: float
    response_chi2: float = 0.0  # chi-square of `response` against a linear camera's
    residual: F32 | None = None  # (n,), grey levels
    # Which of them tell something, (n,): the others are clipped, as they should be. None: white was
    # not clipped in the model.
    is_told: Mask | None = None
    response: F64 | None = None  # the camera's, see `ring_response`; None: not fitted
    # `ring_residuals.coherent_residual`, computed on demand: a clear ring's is not asked for.
    coherence: Callable[["RingFit"], float] = lambda _: math.inf
    stage: str = GREY  # fitted to grey levels; EDGES: to the places of the edges alone
    inflation: float = 1.0  # factor on the covariance, for errors that pixels have in common

    @property
    def contrast(self) -> float:
        """Step from black to white, grey levels: the smaller of both edges."""
        return min(self.inside, self.outside) - self.black

    @cached_property
    def covariance(self) -> F64:
        """Of the position, (3, 3), m^2."""
        return self.inflation * self._uncertainty[0]

    @cached_property
    def inliers(self) -> float:
        """Share of pixels that the model explains to a tenth of the contrast."""
        return self.explained()

    @cached_property
    def coherent(self) -> float:
        """Sigma of what neighbouring pixels' residuals have in common, over the contrast."""
        return self.coherence(self)

    @cached_property
    def sigma_tilt(self) -> float:
        """Of the normal, rad."""
        return self._uncertainty[1]

    @cached_property
    def _uncertainty(self) -> tuple[F64, float]:
        return self.uncertainty()


@dataclass
class _Estimate:
    """The present parameters of the fits from all starts."""

    # Of each start: centre, m, and unit normal, camera frame. In plain floats: numpy takes several
    # times as long on single vectors.
    t: list[Vec3]
    normal: list[Vec3]
    # (starts, rows - 1): blur, levels, motion, response or astigmatism, and light as `RingModel`
    # takes them. The columns of ratio and pose stay 0: the ratio is held, the pose is in t and
    # normal.
    parameters: F64


@dataclass(frozen=True)
class _Prior:
    """What is known besides the pixels, as matrices (rows, rows) in units of 1/noise^2."""

    information: F64
    zero_mean: F64  # the part of it that draws parameters towards zero
    damping: F64  # limits steps; it is no knowledge


@dataclass(frozen=True)
class _NormalEquations:
    """The least squares problem linearised about an estimate."""

    axes: F32  # of the planes, (starts, 3, 3)
    derivative: F32  # of grey levels, (starts, rows - 1, n)
    residual: F32  # (starts, n)
    squares: NDArray[np.floating]  # of residuals over `_ROBUST_SIGMAS` noises, (starts, n)
    weight: NDArray[np.floating]  # of prior and robustness, (starts, n)
    noise: F32  # robust sigma of the residuals, (starts,)
    variance: F64  # noise^2, (starts, 1)
    products: F64  # of the derivatives and, last, the residual: (starts, rows, rows)
    H: F64  # information times noise^2, (starts, rows - 1, rows - 1)
    b: F64  # gradient, (starts, rows - 1)


def fit_ring(
    pixels: Pixels,
    starts: Sequence[CirclePose],
    ring: Ring,
    blur_px: float,
    steps: int,
    motion_px: Sequence[F64] | None = None,
    response: F64 | None = None,
    coherence: Callable[[RingFit], float] = lambda _: math.inf,
    *,
    is_clipped: bool = False,
) -> list[RingFit]:
    """Return the fits from starts within about two pixels, best first; failed ones are left out.

    Args:
        pixels: near the ring's edges.
        starts: poses to start from.
        ring: its true size and ratio.
        blur_px: sigma to start from.
        steps: largest number of steps.
        motion_px: path (2,) of the image during exposure to start from, one for each start; None:
            the image stands still.
        response: the camera's response (3,) to start from; None: it is linear and not fitted.
        coherence: see `RingFit`.
        is_clipped: whether the model clips white; not together with motion or a response.
    """
    model = RingModel(
        pixels,
        starts[0][0],
        ring,
        motion_px,
        has_response=response is not None,
        is_clipped=is_clipped,
    )
    black, white = _levels(pixels.grey)
    if is_clipped:
        white = black + WHITE_START * (white - black)
        steps *= _CLIPPED_STEPS
    estimate = _first_estimate(model.rows, starts, (black, white), blur_px)
    if motion_px is not None:
        estimate.parameters[:, MOTION] = motion_px
    if response is not None:
        estimate.parameters[:, RESPONSE] = response
    prior = _prior(
        model.rows - 1,
        max(white, _LEAST_WHITE),
        model.is_moving,
        model.has_response,
        is_clipped,
    )
    equations = _descended(model, prior, estimate, steps)
    return [] if equations is None else _ring_fits(model, estimate, equations, coherence)


def _descended(
    model: RingModel, prior: _Prior, estimate: _Estimate, steps: int
) -> _NormalEquations | None:
    """Move an estimate until it is fitted; return the equations of the last step; None: it failed.

    Quality and covariance come from these equations, as the last step changes little.
    """
    equations = None
    is_near, last_reduction = False, [0.0] * len(estimate.t)
    for i in range(steps):
        supersampled = model.pixels.supersample and (is_near or i >= steps - 2)
        equations = _normal_equations(model, prior, estimate, supersampled)
        if equations is None:
            return None
        if model.is_clipped and i >= _TRIED_STEPS and _is_hopeless(estimate, equations):
            break
        reduction = _step(model, prior, estimate, equations)
        is_open = _is_open(reduction, last_reduction, equations.noise.tolist(), i)
        if supersampled == model.pixels.supersample and not is_open:
            break
        is_near = is_near or min(reduction) < _SUPERSAMPLED_BELOW
        if not model.is_clipped:  # reductions fall slowly there
            last_reduction = reduction
    return equations


def _is_hopeless(estimate: _Estimate, equations: _NormalEquations) -> bool:
    """Tell whether all fits beside clipped white leave so much that they will not explain it."""
    inside, outer, inner = estimate.parameters[:, INSIDE : HEIGHTS.stop].T
    black = inside + inner
    contrast = np.minimum(np.minimum(inside, black + outer), FULL_SCALE) - black
    return bool((equations.noise > _HOPELESS_NOISE * contrast).all())


def _levels(grey: F32) -> tuple[float, float]:
    """Return the limits of the darkest and brightest eighth of levels: about black and white."""
    n = len(grey)
    eighth = n // 8
    ordered = np.partition(grey, (eighth, n - 1 - eighth))
    return float(ordered[eighth]), float(ordered[n - 1 - eighth])


def _first_estimate(
    rows: int,
    starts: Sequence[CirclePose],
    levels: tuple[float, float],
    blur_px: float,
) -> _Estimate:
    black, white = levels
    parameters = np.zeros((len(starts), rows - 1))
    parameters[:, BLUR : HEIGHTS.stop] = blur_px**2, white, white - black, black - white
    t, normal = [vec3(position) for position, _ in starts], [vec3(normal) for _, normal in starts]
    return _Estimate(t, normal, parameters)


@lru_cache
def _prior(
    rows: int, white: float, is_moving: bool, has_response: bool, is_clipped: bool
) -> _Prior:
    """Return what is known of all rings, by the number of parameters and the white's grey level.

    Paper is equally white inside and around, which helps as far rings show little of their
    surroundings, and even more where that white is clipped. Motion is below 30 px. Tilts span
    about a radian, which helps near frontal view, where they are hardly seen.
    """
    zero_mean = np.zeros((rows, rows))
    paper_sigma = _EVEN_PAPER_SIGMA if is_clipped else _PAPER_SIGMA
    zero_mean[HEIGHTS, HEIGHTS] = 1.0 / (paper_sigma * white) ** 2
    held = np.full(rows, 1e-4)  # so that the matrix is never singular
    held[TILT] += 1.0
    held[BLUR] += 1e-3
    held[-3 if is_clipped else -2 :] += 1.0
    if is_moving:
        zero_mean[MOTION, MOTION] = 1e-3 * np.eye(2)
    if has_response:
        zero_mean[RESPONSE, RESPONSE] = np.diag(RESPONSE_SIGMAS**-2)
    if is_clipped:
        zero_mean[-1, -1] = _CURVATURE_SIGMA**-2
        zero_mean[ASTIGMATISM, ASTIGMATISM] = _ASTIGMATISM_SIGMA**-2 * np.eye(2)
    damping = np.zeros(rows)
    damping[TILT] = 1.0 / _TILT_STEP**2
    return _Prior(zero_mean + np.diag(held), zero_mean, np.diag(damping))


def _normal_equations(
    model: RingModel, prior: _Prior, estimate: _Estimate, supersampled: bool
) -> _NormalEquations | None:
    """Return the normal equations about an estimate; None if they are not finite."""
    weight = model.pixels.weight
    t32, axes = plane_axes(estimate.t, estimate.normal)
    J = model.derivative(t32, axes, estimate.parameters, supersampled)
    residual = J[:, -1]
    noise = np.maximum(SIGMA_PER_MAD * _middle(residual, model.is_told), _MIN_NOISE)
    u = residual * (1.0 / (_ROBUST_SIGMAS * noise))[:, None]
    u *= u
    robust = 1.0 + u
    robust *= robust
    np.divide(weight, robust, out=robust)
    if model.is_told is not None:
        robust *= model.is_told
    products = ((J * robust[:, None]) @ J.transpose(0, 2, 1)).astype(np.float64)
    if not np.isfinite(products).all():
        return None
    variance = (noise * noise).astype(np.float64)[:, None]
    H = products[:, :-1, :-1] + variance[:, None] * prior.information
    b = products[:, :-1, -1] - variance * (estimate.parameters @ prior.zero_mean)
    return _NormalEquations(axes, J[:, :-1], residual, u, robust, noise, variance, products, H, b)


def _middle(residual: F32, is_told: Mask | None) -> F32:
    """Return the median absolute residual (starts,) of the pixels (starts, n) that count."""
    size: F32 = np.abs(residual)
    n = size.shape[1]
    if is_told is None:
        size.partition(n // 2, axis=1)
        return size[:, n // 2]
    size[~is_told] = np.inf
    counts = np.maximum(is_told.sum(axis=1), 1)
    ordered = np.sort(size, axis=1)
    middle: F32 = ordered[np.arange(len(size)), counts // 2]
    return np.where(np.isfinite(middle), middle, np.float32(_EXPLAINED))


def _step(
    model: RingModel, prior: _Prior, estimate: _Estimate, equations: _NormalEquations
) -> list[float]:
    """Move the estimate by a step that holds the ratio.

    Returns:
        by how much chi-square should fall, for each start.
    """
    A, b = equations.H + equations.variance[:, None] * prior.damping, equations.b[:, 1:]
    # Zero where A is singular. A quarter of the time of numpy's own.
    solved = [cv2.solve(a, c)[1] for a, c in zip(A[:, 1:, 1:], b[:, :, None], strict=True)]
    step = np.array(solved)[:, :, 0]
    reduction: list[float] = ((step * b).sum(axis=1) / equations.variance[:, 0]).tolist()
    _move(estimate, equations.axes, step, model.ring.radius_m)
    p = estimate.parameters
    blur = p[:, BLUR].copy()
    p[:, BLUR:] += step[:, BLUR - 1 :]
    p[:, BLUR] = np.maximum(p[:, BLUR], blur / _BLUR_STEP)
    if model.is_clipped:
        p[:, BLUR] = np.minimum(p[:, BLUR], blur * _BLUR_STEP)
    p[:, BLUR] = np.minimum(np.maximum(p[:, BLUR], MIN_BLUR_PX**2), _MAX_BLUR_PX**2)
    if model.is_moving:
        p[:, MOTION] = np.clip(p[:, MOTION], -_MAX_MOTION_PX, _MAX_MOTION_PX)
    if model.has_response:
        p[:, RESPONSE] = bounded_response(p[:, RESPONSE])
    return reduction


def _move(estimate: _Estimate, axes: F32, step: F64, radius: float) -> None:
    """Move poses by steps (starts, 5 or more) on the planes' axes; too long ones are shortened."""
    starts = zip(estimate.t, estimate.normal, axes.tolist(), step.tolist(), strict=True)
    estimate.t, estimate.normal = [], []
    for t, normal, rows, (a, b, c, p, q, *_) in starts:
        to_camera = transpose(rows)
        forward = rotate(to_camera, (a, b, c))
        x, y, z = t
        dx, dy, dz = forward
        aside = math.hypot(dx - x * dz / z, dy - y * dz / z)
        longest = max(abs(dz) / (_DEPTH_STEP * z), aside / (_ASIDE_STEP * radius), 1.0)
        x, y, z = add(t, scale(forward, 1.0 / longest))
        estimate.t.append((x, y, max(z, _MIN_RANGE_M)))
        turned = rotate(to_camera, (p, q, 0.0))
        estimate.normal.append(unit(add(normal, scale(turned, 1.0 / longest))))


def _is_open(
    reduction: list[float], last_reduction: list[float], noise: list[float], steps_before: int
) -> bool:
    """Tell whether another step is worth its time for any of the starts."""
    most_noise = math.inf if steps_before < 2 else _RIVAL_NOISE * min(noise)
    of_starts = zip(reduction, last_reduction, noise, strict=True)
    still_open = [(r, last) for r, last, n in of_starts if r > _CONVERGED and n < most_noise]
    # Near the end reductions fall ever faster, so the next one can be predicted from the last two.
    # As long as two poses compete, the last reduction itself must be small: their costs are
    # compared.
    if len(still_open) == 1:
        ((r, last),) = still_open
        return r * r > _CONVERGED * last
    return bool(still_open)


def _ring_fits(
    model: RingModel,
    estimate: _Estimate,
    equations: _NormalEquations,
    coherence: Callable[[RingFit], float],
) -> list[RingFit]:
    """Return the fits, best first, without those of too oblique views or without information.

    Pixels hold none if all have one grey level, as below the cut of a broken picture, or are
    clipped.
    """
    noise, u = equations.noise, equations.squares
    robust = _ROBUST_SIGMAS * _ROBUST_SIGMAS * model.pixels.weight * u / (1.0 + u)
    costs = robust.sum(axis=1) * (noise / noise.min()) ** 2
    fits = [
        _ring_fit(model, estimate, equations, k, float(costs[k]), coherence)
        for k, (t, normal) in enumerate(zip(estimate.t, estimate.normal, strict=True))
        if dot(normal, t) > _MIN_COS * math.hypot(*t) and float(equations.products[k, -1, -1]) > 0.0
    ]
    return sorted(fits, key=lambda f: f.cost)


def _ring_fit(
    model: RingModel,
    estimate: _Estimate,
    equations: _NormalEquations,
    k: int,
    cost: float,
    coherence: Callable[[RingFit], float],
) -> RingFit:
    """Return the fit from start k, with its quality."""
    t, parameters, radius = np.array(estimate.t[k]), estimate.parameters[k], model.ring.radius_m
    inside, outer, inner = parameters[INSIDE : HEIGHTS.stop].tolist()
    black, outside = inside + inner, inside + inner + outer
    is_told = None
    if model.is_clipped:
        assert model.is_told is not None
        inside, outside = min(inside, FULL_SCALE), min(outside, FULL_SCALE)
        is_told = model.is_told[k] | (equations.squares[k] > 1.0)
    C = cv2.invert(equations.H[k])[1]  # numpy's own takes five times as long
    dof = float(equations.weight[k].sum()) - (model.rows - 2)
    scale = equations.products[k, -1, -1] / max(dof, 5.0)
    response, chi2 = None, 0.0
    if model.has_response:
        response = parameters[RESPONSE].copy()
        chi2 = float(response @ np.linalg.solve(scale * C[RESPONSE, RESPONSE], response))
    ratio = model.ring.inner_ratio
    off = float(C[RATIO] @ equations.b[k]) / radius
    sigma_off = math.sqrt(max(0.0, scale * float(C[RATIO, RATIO]))) / radius
    motion = parameters[MOTION] if model.is_moving else np.zeros(2)
    path = length(motion) / model.pixels.focal
    uncertainty = partial(
        pose_uncertainty,
        C,
        _ROBUST_VARIANCE * scale,
        (t, equations.axes[k]),
        equations.derivative[k, 1:],
        equations.weight[k] * equations.residual[k],
        model.pixels.rays[:2],
        lambda: (
            shift_covariance(t, ratio, off, sigma_off)
            + motion_covariance(t, radius, path)
            + (clipped_covariance(t, model.pixels.focal) if model.is_clipped else 0.0)
        ),
    )
    return RingFit(
        position=t,
        normal=np.array(estimate.normal[k]),
        blur_px=math.sqrt(float(parameters[BLUR])),
        motion_px=motion,
        inside=inside,
        black=black,
        outside=outside,
        noise=float(equations.noise[k]),
        cost=cost,
        explained=partial(
            _inliers, model.pixels, equations.residual[k], min(inside, outside) - black
        ),
        uncertainty=uncertainty,
        ratio=ratio + off,
        sigma_ratio=sigma_off,
        residual=equations.residual[k],
        is_told=is_told,
        response=response,
        response_chi2=chi2,
        coherence=coherence,
    )


def _inliers(pixels: Pixels, residual: F32, contrast: float) -> float:
    """Return the share of pixels, by weight, whose residual is below a tenth of the contrast."""
    unexplained = np.abs(residual) * np.sqrt(pixels.weight)
    explained = unexplained < max(_EXPLAINED, _EXPLAINED_SHARE * contrast)
    return float(pixels.weight[explained].sum()) / float(pixels.weight.sum())
