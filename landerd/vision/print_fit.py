"""Pose of a printed marker (square or WhyCode) by least squares on its pixels.

The whole print is known, so that every edge of every cell helps, not only the four corners. The
model image is the print under a pose, blurred by the camera (`blurred_print`) and lit with a linear
gradient, and clipped at full scale. Pose, blur and light are fitted together (Gauss-Newton), and
the camera's tone curve (`tone`) if the picture shows one. The information matrix is that of the
pose after all other parameters are eliminated.

`square_fit.SquarePrint` and `whycode_print.WhyCodePrint` are the prints; `print_edges` is the fit
for light that this model does not explain.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.vision.arrays import Image
from landerd.vision.blurred_print import BlurredPrint
from landerd.vision.edge_profile import SIGMA_PER_MAD
from landerd.vision.linear import inverse, outer, solved
from landerd.vision.patch import (
    CLIPPED,
    FULL_SCALE,
    WHITE_START,
    Patch,
    marker_patch,
    on_plane,
    pose_slope,
)
from landerd.vision.pose import EQUAL_NORMALS_COS, Pose
from landerd.vision.square_pose import corner_information, square_points
from landerd.vision.tone import LINEAR, TONE_SIGMA, TONES, bounded, edge_shift, toned

# Rows of the derivative.
_POSE = slice(0, 6)  # (dt, w) on the marker's own axes
_BLUR = 6  # variance, pixels^2
_LIGHT = slice(7, 11)  # black, contrast, gradients along the image's x and y
_TONE = slice(11, 11 + TONES)
_ROWS = 11 + TONES

_MAX_STEPS = 12
# Change of chi-square by a tone curve from which on one is fitted: by chance once in 400 fits.
_TONE_CHI2 = 12.0
_DAMPED = 1.0 + 1e-6 * np.eye(_ROWS)
_PRIOR = np.diag([0.0] * _TONE.start + [TONE_SIGMA**-2] * TONES)  # information
# Where nothing else is said, the numbers below were set by trial on `bench.vision_square`'s images.

# The last step moves the corners by less than the first, px, and reduces chi-square by less than
# the second: on the way to the other solution corners hardly move.
_CONVERGED_PX = 0.03
_CONVERGED = 20.0
# It also changes the blur by less than this share. From an exact start only the blur is left to be
# found, and as long as it is wrong, a rival that took more steps explains more.
_CONVERGED_BLUR = 0.1
# The blur is fitted once a step moves the corners by less than this, px: before, a print that is
# out of place looks like a blurred one.
_LEARN_BLUR_PX = 0.2
_ROBUST_SIGMAS = 2.5  # residuals beyond it count less (Huber)
_TURNED = 0.6  # residual over contrast above which a pixel is white for black, or the reverse
_MAX_CORRELATION = 0.95  # of neighbouring residuals: they always tell something
_READ_NOISE = 1.0  # least sigma of a residual, grey levels
_SHIFT_BIAS = 0.2  # error of a tone curve's shift of edges, a share of it: no curve is a cubic
# Error of the corners over the root of the blur beyond a sharp lens's: that is no Gaussian.
_UNSHARP_BIAS = 0.05
# ---- white over full scale ---------------------------------------------------------------------
_CLIPPED_TONE_CHI2 = 150.0  # as _TONE_CHI2: where clipped, no curve at all changes it by up to this
# Least blur of single pixels of a large marker, over that of a sharp lens: that of the samples.
_LEAST_BLUR = 0.6
# Error of the shift of clipped edges, a share of it: no lens blurs like a Gaussian.
_CLIPPED_SHIFT_BIAS = 0.1

# Share of the pixels' variance: a fit that explains less is no better than the corners.
MIN_EXPLAINED = 0.85
# A fit that explains less than the first, with residuals that correlate by more than the second, is
# shaded: unevenly lit. Of 90 WhyCodes in hard, soft and leaf shade such fits were off by 2 to 40
# thousandths of the range, most by 10 and more, edges by 0.1 to 5; so were 90 squares, most by 5,
# edges by 0.2 to 1. Without shade all but a few dirty ones explain more.
_EVEN_EXPLAINED, _SHADED_CORRELATION = 0.965, 0.3
# Blur, as a variance over a sharp lens's, from which on motion, not shade, explains the residuals:
# it displaces edges.
_MOVING_BLUR = 3.0
# Errors of light, blur and motion in the model change the difference in chi-square of two poses as
# much as the pixels do: it counts by one sixth, and less if neighbouring residuals correlate.
# Gravity decides where that is not enough.
AMBIGUITY_CHI2 = 6.0


@dataclass(frozen=True)
class Fit:
    """A fitted pose and how well it explains the pixels."""

    pose: Pose
    explained: float  # share of the pixels' variance, 1 at best
    squares: float  # weighted sum of squared residuals, grey levels^2
    variance: float  # of one residual, grey levels^2
    correlation: float  # of neighbouring residuals, from 0 (only noise) to below 1
    tone: F64  # see `toned`; zeros: the picture shows no curve
    blur: float  # variance, over that of a sharp lens
    # Share of the pixels that distinguish the print from others and are white for black, or that
    # are black for white, whichever is smaller: dirt or glare cause one of the two, another print
    # both.
    contradiction: Callable[[], float]
    pixels: float  # number of pixels, as the sum of their weights
    reduction: int  # of the pixels, see `Patch`

    @property
    def contradicted(self) -> float:
        """The share of `contradiction`, computed on demand: a decoded print's is not asked for."""
        return self.contradiction()

    @property
    def is_shaded(self) -> bool:
        """Whether uneven light, which the model does not have, may spoil it: edges tell more."""
        is_even = self.explained > _EVEN_EXPLAINED or self.correlation < _SHADED_CORRELATION
        return not is_even and self.blur < _MOVING_BLUR

    @property
    def darkens(self) -> bool:
        """Whether its tone darkens what is between black and white: no camera does, dirt may."""
        return bool(self.tone[0] < 0.0)


@dataclass
class _Estimate:
    """The present parameters of a fit."""

    pose: Pose
    corners: F64  # rays of the print's corners under that pose, (4, 2)
    blur: float  # variance, pixels^2
    light: F64  # black, contrast, gradients: (4,)
    tone: F64  # (2,)
    is_toned: bool  # the tone is fitted; else it is held, which keeps information if it is linear

    @property
    def rows(self) -> int:
        """Number of parameters that are fitted: the first ones."""
        return _ROWS if self.is_toned else _TONE.start


@dataclass(frozen=True)
class _NormalEquations:
    """The least squares problem linearised about an estimate."""

    residual: F64  # (n,)
    weight: F64  # (n,)
    sigma: float  # of a residual, robust, grey levels
    matrix: F64  # information times sigma^2, (rows, rows)
    gradient: F64  # (rows,)
    informs: NDArray[np.bool_]  # the model is not clipped there, (n,)

    def step(self, rows: int) -> F64:
        """Return the step (rows,) of the first rows, the others held.

        Raises:
            LinAlgError: the pixels leave something open.
        """
        step = np.zeros(_ROWS)
        step[:rows] = solved(self.matrix[:rows, :rows], self.gradient[:rows])
        return step

    def tone_gain(self) -> float:
        """Return by how much a curve that bulges would reduce chi-square."""
        bulging = self.step(_TONE.start + 1) - self.step(_TONE.start)
        return float(bulging @ self.gradient) / self.sigma**2

    def tone_loss(self, tone: F64) -> float:
        """Return by how much chi-square would rise if a tone that was fitted did not bulge."""
        unit = np.zeros(_ROWS)
        unit[_TONE.start] = 1.0
        variance = float(solved(self.matrix, unit)[_TONE.start]) * self.sigma**2
        return float(tone[0]) ** 2 / max(variance, 1e-12)


class MarkerPrint:
    """The print of one marker, ready to be compared with images.

    Keeps the blur and the tone of the last fit, from which the next one starts, and the print
    blurred by as much.
    """

    def __init__(
        self,
        fine: NDArray[np.floating],
        size: float,
        per_m: float,
        reach: float,
        white: float = math.inf,
    ) -> None:
        """Take the print.

        Args:
            fine: samples (2 n, 2 n) of the print and of the white round it, its centre in the
                middle: 1 white, 0 black, its top first. For single pixels of a large marker; means
                of four are used for other pixels.
            size: of the print, m.
            per_m: samples per metre.
            reach: how far from the centre print and image are compared, m.
            white: width of the white beyond that, m.
        """
        self._size, self._reach, self._white = size, reach, white
        self._corners = square_points(size)
        self._fine = fine
        n = fine.shape[0] // 2
        self._blurred = BlurredPrint(fine.reshape(n, 2, n, 2).mean(axis=(1, 3)), 0.5 * per_m)
        self._blur = 1.0  # of the last fit: the next one's is likely similar
        self._tone = LINEAR  # of the camera, as far as it is known

    @cached_property
    def _finer(self) -> BlurredPrint:
        """The print with all its samples."""
        return BlurredPrint(self._fine, 2.0 * self._blurred.per_m)

    def fit(
        self,
        image: Image,
        camera: CameraModel,
        start: Pose,
        *,
        has_rival: bool = True,
        reduction: int | None = None,
    ) -> Fit | None:
        """Return the pose that explains the pixels round a start near it; None if none does.

        With a rival it will be compared with another fit by how well each explains the pixels.
        `reduction` is as `marker_patch` takes it.
        """
        patch = marker_patch(
            image, camera, start, self._reach, self._is_used, reduction, self._white
        )
        if patch is None:
            return None
        blur = max(1.0, self._blur)
        fit = self._fitted(patch, start, blur, has_rival)
        if blur > 1.0 and (fit is None or fit.explained < MIN_EXPLAINED):
            # The last picture was in motion, and this one may not be: small prints blurred like
            # that have no cells left that tell the way to the pose.
            sharp = self._fitted(patch, start, 1.0, has_rival)
            fit = max((fit, sharp), key=lambda f: -math.inf if f is None else f.explained)
        return fit

    def fit_rival(self, image: Image, camera: CameraModel, start: Pose, first: Fit) -> Fit | None:
        """Return the fit near a start of another pose than a first fit's; None if none is.

        The pixels are of the same reduction: the means of more of them are less noisy.
        """
        fit = self.fit(image, camera, start, reduction=first.reduction)
        is_other = fit is not None and fit.pose.normal @ first.pose.normal < EQUAL_NORMALS_COS
        return fit if is_other else None

    def _fitted(self, patch: Patch, start: Pose, blur: float, has_rival: bool) -> Fit | None:
        """Return the fit from a start, with a blur in a sharp lens's; None if there is none."""
        light, tone = _first_light(patch.grey), self._tone
        if patch.is_clipped:
            tone = LINEAR
            if light[0] + light[1] >= CLIPPED:
                light[1] *= WHITE_START
        corners = self.corner_rays(start)
        estimate = _Estimate(start, corners, blur * patch.blur, light, tone, bool(tone.any()))
        equations = self._descended(patch, estimate, has_rival)
        return None if equations is None else self._judged(patch, estimate, equations)

    def remember(self, fit: Fit) -> None:
        """Let the next fits start with the blur and the tone of this one: it found the print.

        Of what is not the print they would lead away from it: off it all looks blurred.
        """
        self._blur, self._tone = fit.blur, fit.tone

    def corner_rays(self, pose: Pose) -> F64:
        """Return the rays (4, 2) of the corners under a pose, on z = 1."""
        return pose.rays(self._corners)

    def _is_used(self, north: F64, east: F64) -> NDArray[np.bool_]:
        """Tell which points (n,) of the plane are compared with the image."""
        used: NDArray[np.bool_] = (np.abs(north) < self._reach) & (np.abs(east) < self._reach)
        return used

    def _is_telling(self, north: F64, east: F64) -> NDArray[np.bool_]:
        """Tell at which points (n,) of the plane the print differs from others of its kind."""
        return self._is_used(north, east)

    def _descended(
        self, patch: Patch, estimate: _Estimate, has_rival: bool
    ) -> _NormalEquations | None:
        """Move an estimate until it fits; return the last step's equations; None: it failed."""
        J = np.empty((_ROWS, len(patch.grey)))
        equations = None
        # Until the fit knows how far white is over full scale, this looks like a tone curve.
        toned_px, toned_chi2 = (
            (_CONVERGED_PX, _CLIPPED_TONE_CHI2)
            if patch.is_clipped
            else (_LEARN_BLUR_PX, _TONE_CHI2)
        )
        for _ in range(_MAX_STEPS):
            residual = self._linearise(patch, estimate, J)
            if not J[_LIGHT.start].any():  # all is clipped
                return None
            equations = _normal_equations(J, residual, estimate.tone)
            try:
                step = equations.step(estimate.rows)
            except np.linalg.LinAlgError:
                return None
            blur = estimate.blur
            motion_px = self._move(patch, estimate, step)
            pose = estimate.pose
            if not np.isfinite(step).all() or pose.t[2] <= 0 or pose.normal @ pose.t <= 0:
                return None
            # Not of the blur: its step has no effect until the print is blurred anew.
            reduction = float(step @ equations.gradient - step[_BLUR] * equations.gradient[_BLUR])
            if motion_px < toned_px and not estimate.is_toned:
                estimate.is_toned = equations.tone_gain() > toned_chi2
                if estimate.is_toned:
                    continue
            is_done = reduction < _CONVERGED * equations.sigma**2 and (
                abs(estimate.blur - blur) < _CONVERGED_BLUR * blur
            )
            if motion_px < _CONVERGED_PX and (is_done or not has_rival):
                break
        return equations

    def _linearise(self, patch: Patch, estimate: _Estimate, J: F64) -> F64:
        """Write the derivatives (rows, n) of the model's grey levels; return the residual (n,)."""
        pose, light = estimate.pose, estimate.light
        blurred = self._finer if patch.is_thinned else self._blurred
        spread = _on_print(blurred.per_m * patch.pixel, pose)
        layers = blurred.layers(estimate.blur * spread, estimate.blur)
        north, east = on_plane(patch.rays, pose)
        value, slope_n, slope_e, J[_BLUR] = blurred.at(layers, north, east)
        shade = 1.0 + light[2] * patch.x + light[3] * patch.y
        value, slope, by_tone = toned(value, estimate.tone)
        level = light[0] + light[1] * value
        contrast = light[1] * shade
        J[_TONE] = contrast * by_tone
        contrast = contrast * slope
        pose_slope(J[_POSE], pose, north, east, contrast * slope_n, contrast * slope_e)
        J[_BLUR] *= contrast
        black, difference, along_x, along_y = J[_LIGHT]
        black[:] = shade
        np.multiply(shade, value, out=difference)
        np.multiply(patch.x, level, out=along_x)
        np.multiply(patch.y, level, out=along_y)
        grey = shade * level
        if patch.is_clipped:
            over = grey > FULL_SCALE
            grey[over], J[:, over] = FULL_SCALE, 0.0
        residual: F64 = patch.grey - grey
        return residual

    def _move(self, patch: Patch, estimate: _Estimate, step: NDArray[np.floating]) -> float:
        """Move an estimate; return by how much a corner moved at most, pixels."""
        pose = estimate.pose
        moved = pose.moved(np.concatenate([pose.R @ step[:3], pose.R @ step[3:6]]))
        corners = self.corner_rays(moved)
        motion_px = float(np.abs(corners - estimate.corners).max()) / patch.pixel
        estimate.pose, estimate.corners = moved, corners
        if motion_px < _LEARN_BLUR_PX:
            blur = estimate.blur
            least = _LEAST_BLUR * patch.blur if patch.is_thinned else 0.05
            estimate.blur = min(max(blur + float(step[_BLUR]), 0.5 * blur, least), 2.0 * blur)
        estimate.light = estimate.light + step[_LIGHT]
        estimate.tone = bounded(estimate.tone + step[_TONE])
        return motion_px

    def _judged(self, patch: Patch, estimate: _Estimate, equations: _NormalEquations) -> Fit | None:
        """Return the fit with its information and quality; None if the pixels leave it open."""
        pose, weight = estimate.pose, equations.weight
        excess = max(0.0, estimate.blur - patch.blur)
        bias = patch.bias + _UNSHARP_BIAS * math.sqrt(excess)
        squares = float(weight @ equations.residual**2)
        pixels = float(weight.sum())
        informing = weight * equations.informs
        left = float(informing @ equations.residual**2)
        left /= max(1.0, float(informing.sum()) - _ROWS)
        variance = max(_READ_NOISE**2, left)
        correlation = _correlation(equations)
        # Of residuals alike to either side and up and down, so many are one.
        together = ((1.0 + correlation) / (1.0 - correlation)) ** 2
        try:
            scatter = _scatter(patch, weight)
            matrix = equations.matrix[: estimate.rows, : estimate.rows]
            shift = _SHIFT_BIAS * edge_shift(estimate.tone, estimate.blur)
            if patch.is_clipped:
                shift = math.hypot(shift, _CLIPPED_SHIFT_BIAS * _clipped_shift(estimate))
            information = self._information(
                matrix,
                max(variance, together * left),
                pose,
                bias * patch.pixel,
                shift * patch.pixel,
            )
        except np.linalg.LinAlgError:
            return None
        fitted = Pose(pose.R, pose.t, information, 0.0)
        explained = 1.0 - squares / max(scatter, 1e-9)
        is_seen = estimate.is_toned and equations.tone_loss(estimate.tone) > _TONE_CHI2
        tone = estimate.tone if is_seen else LINEAR
        blur = estimate.blur / patch.blur
        return Fit(
            pose=fitted,
            explained=explained,
            squares=squares,
            variance=variance,
            correlation=correlation,
            tone=tone,
            blur=blur,
            contradiction=partial(self._contradicted, patch, estimate, equations.residual),
            pixels=pixels,
            reduction=patch.reduction,
        )

    def _contradicted(self, patch: Patch, estimate: _Estimate, residual: F64) -> float:
        """Return the share of what tells the print that is turned, see `Fit`."""
        telling = self._is_telling(*on_plane(patch.rays, estimate.pose))
        if not telling.any():
            return 0.0
        light = estimate.light
        shade = 1.0 + light[2] * patch.x + light[3] * patch.y
        contrast = light[1] * shade[telling]
        if patch.is_clipped:
            contrast = np.minimum(contrast, FULL_SCALE - light[0] * shade[telling])
        off = residual[telling] / np.maximum(contrast, 1e-9)
        turned = min(np.count_nonzero(off > _TURNED), np.count_nonzero(off < -_TURNED))
        return turned / len(off)

    def _information(
        self, matrix: F64, variance: float, pose: Pose, bias: float, shift: float
    ) -> F64:
        """Return the information of (dt, w) from the normal matrix (rows, rows) of the fit.

        `bias` is the error of the corners that no residual shows, `shift` that of all edges
        together, outwards; on the plane z = 1.

        Raises:
            LinAlgError: the pixels leave the pose open.
        """
        rest = solved(matrix[6:, 6:], matrix[6:, :6])
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = pose.R
        of_pose = turn @ (matrix[:6, :6] - matrix[:6, 6:] @ rest) @ turn.T
        nearer = np.concatenate([2.0 * shift * pose.t[2] / self._size * pose.t, np.zeros(3)])
        information: F64 = inverse(
            variance * inverse(of_pose)
            + inverse(corner_information(pose, self._size, bias))
            + outer(nearer, nearer)
        )
        return information


def _scatter(patch: Patch, weight: F64) -> float:
    """Return the weighted sum of squares that light alone, with its gradient, leaves over.

    Raises:
        LinAlgError: the pixels leave a gradient open.
    """
    root = np.sqrt(weight)
    light = np.array([root, root * patch.x, root * patch.y])
    grey = root * patch.grey
    left = grey - solved(light @ light.T, light @ grey) @ light
    return float(left @ left)


def _first_light(grey: F64) -> F64:
    """Return black, contrast and gradients (4,): a tenth of the pixels lies beyond each level."""
    n = len(grey)
    tenth = n // 10
    ordered = np.partition(grey, (tenth, n - 1 - tenth))
    dark, bright = ordered[tenth], ordered[n - 1 - tenth]
    return np.array([dark, bright - dark, 0.0, 0.0])


def _normal_equations(J: F64, residual: F64, tone: F64) -> _NormalEquations:
    size = np.abs(residual)
    informs = J[_LIGHT.start] != 0.0
    n = np.count_nonzero(informs)
    sigma = max(_READ_NOISE, SIGMA_PER_MAD * float(np.partition(size[informs], n // 2)[n // 2]))
    weight = np.minimum(1.0, _ROBUST_SIGMAS * sigma / np.maximum(size, 1e-9))
    JW = J * weight
    matrix = JW @ J.T
    gradient = JW @ residual
    matrix *= _DAMPED
    matrix += sigma**2 * _PRIOR
    gradient[_TONE] -= sigma**2 * TONE_SIGMA**-2 * tone
    return _NormalEquations(residual, weight, sigma, matrix, gradient, informs)


def ranked(fits: list[Fit]) -> list[Pose]:
    """Return the poses, best first: with cost 0, and for others the excess of chi-square."""
    fits = sorted(fits, key=per_pixel)
    best = fits[0]
    # n residuals with this correlation tell as much as n (1 - c) / (1 + c) independent ones.
    c = best.correlation
    unit = AMBIGUITY_CHI2 * best.variance * (1.0 + c) / (1.0 - c)
    costs = (best.pixels * (per_pixel(f) - per_pixel(best)) / unit for f in fits)
    return [
        Pose(f.pose.R, f.pose.t, f.pose.information, cost)
        for f, cost in zip(fits, costs, strict=True)
    ]


def per_pixel(fit: Fit) -> float:
    """Return the squared residual per pixel: under another pose a print covers more or fewer."""
    return fit.squares / fit.pixels


def _clipped_shift(estimate: _Estimate) -> float:
    """Return by how much the middle of an edge beside clipped white is shifted, pixels."""
    black, contrast = estimate.light[:2].tolist()
    share = (FULL_SCALE - black) / max(contrast, 1e-9)  # of the contrast, that is not clipped
    share = min(max(share, 0.01), 1.0)
    return NormalDist().inv_cdf(1.0 - 0.5 * share) * math.sqrt(estimate.blur)


def _correlation(equations: _NormalEquations) -> float:
    """Return the correlation of residuals next to each other in a row: of what no model has."""
    r = (equations.residual * np.sqrt(equations.weight))[equations.informs]
    return min(max(0.0, float(r[:-1] @ r[1:]) / max(float(r @ r), 1e-9)), _MAX_CORRELATION)


def _on_print(per_ray: float, pose: Pose) -> F64:
    """Return the covariance (2, 2) on the print (u, v), samples^2, of a blur of one pixel^2.

    `per_ray` is a pixel's width on z = 1 in samples of a print at the distance 1.
    """
    # A turn of the ray t by dr moves its point on the plane by t_z (dr - t n.dr / n.t).
    north, east, normal = pose.R.T
    along = normal[:2] / float(normal @ pose.t)
    A = np.empty((2, 2))
    A[0] = east[:2] - float(east @ pose.t) * along
    A[1] = float(north @ pose.t) * along - north[:2]
    A *= per_ray * float(pose.t[2])
    spread: F64 = A @ A.T
    return spread
