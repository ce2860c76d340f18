"""Pose of a square marker by least squares on its pixels.

The whole print is known, so every edge of every cell helps, not only the four corners. The model
image is the print seen under a pose, blurred by the camera and lit with a linear gradient; pose,
blur and light are fitted together (Gauss-Newton). Its information matrix is the pose's after
blur and light are eliminated.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.pad import Square
from landerd.vision.pose import CONTINUED, SAME_NORMAL, Pose
from landerd.vision.square_pose import (
    corner_information,
    planar_poses,
    poses_from_corners,
    square_points,
)

Image = NDArray[np.uint8]

_PER_CELL = 6  # samples of the print along a cell
_MARGIN_CELLS = 2  # white round the print
_USED_MARGIN_CELLS = 0.9  # of it, what is compared with the image
_LARGEST_SIDE_PX = 30.0  # larger markers are fitted on a reduced image
_STEPS = 8
_DAMPED = 1.0 + 1e-6 * np.eye(11)
# A last step moves the corners by less than this and gains less than this in chi-square: along the
# way to the other solution corners hardly move.
_CONVERGED_PX = 0.03
_CONVERGED = 20.0
_NEAR_PX = 0.2  # motion of the corners by a step: before, being off the print looks like blur
_BLUR_CHANGED = 0.1  # relative; less than that and the blurred print is kept
_LENS_NODES = 5
_FAR_OFF = 1e5  # samples of the print
_ROBUST = 2.5  # residuals beyond this many sigma count less (Huber)
_READ_NOISE = 1.0  # grey levels: no residual is trusted to be smaller
# What lens model, light and sampling leave out, as an error of the corners in fitted pixels.
_EDGE_BIAS_PX = 0.006
_REDUCED_BIAS_PX = 0.001  # and for each pixel of the image along a fitted one: no box is a Gaussian
_UNSHARP_BIAS = 0.05  # and as a share of the blur beyond a sharp lens's, which no Gaussian fits

# Between two solutions the errors of light, blur and motion in the model tell as much as the pixels
# do: their difference in chi-square is worth a tenth, and gravity decides where that is not enough.
_RIVALS = 10.0

# A solution whose corners are off by this much is told from the true one by the pixels for sure.
_TOLD_PX = 0.5
_CORNER_SIGMA_PX = 0.7  # of corners that stand without a fit to the pixels
# A fit that explains less of the pixels' variance is no better than the corners.
EXPLAINED = 0.85
_TRACKED = 0.93  # and one that nothing decoded must explain more
# Gravity alone tells two solutions apart where one is so level and the other leans so much: pads
# lean by 15 degrees at most.
_LEVEL = math.cos(math.radians(6.0))
_LEANING = math.cos(math.radians(17.0))

# Derivatives of a sampled print, as kernels along u (their transposes: along v).
_SLOPE_U = np.array([[1.0, -8.0, 0.0, 8.0, -1.0]]) / 12.0
_CURVED_U = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 1.0], [0.0, 0.0, 0.0]])
_TWISTED = np.array([[1.0, 0.0, -1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 1.0]]) / 2.0  # both, doubled


@dataclass(frozen=True)
class Fit:
    """A fitted pose and how well it explains the pixels."""

    pose: Pose
    explained: float  # share of the pixels' variance, 1 at best
    squares: float  # weighted sum of squared residuals, grey levels^2
    variance: float  # of one residual, grey levels^2


@dataclass(frozen=True)
class _Patch:
    """The marker's pixels."""

    grey: F64  # (n,)
    rays: F64  # homogeneous, (3, n)
    pixel: float  # width of one on the plane z = 1
    blur: float  # variance to start from, pixels^2: a sharp lens's spread and the pixel's box
    bias: float  # error of the corners that no residual shows, pixels, with a sharp lens


class SquarePrint:
    """The print of one square marker, ready to be compared with images."""

    def __init__(self, square: Square, cells: NDArray[np.bool_]) -> None:
        """Prepare from the print's cells (n, n): True is white, top row first, border included."""
        count, size = cells.shape[0], square.size_m
        padded = np.pad(cells.astype(np.float64), _MARGIN_CELLS, constant_values=1.0)
        fine = np.kron(padded, np.ones((_PER_CELL, _PER_CELL)))
        reach = 0.5 * size * (1.0 + 2.0 * _USED_MARGIN_CELLS / count)
        self._prepare(fine, size, count * _PER_CELL / size, reach)

    def _prepare(self, fine: NDArray[np.floating], size: float, per_m: float, reach: float) -> None:
        """Take the print (n, n), 1 white and 0 black.

        Args:
            fine: samples of the print and of the white round it, its centre in the middle.
            size: of the print, m.
            per_m: samples a metre.
            reach: how far from the centre print and image are compared, m.
        """
        self._size, self._per_m, self._reach = size, per_m, reach
        self._corners = square_points(size)
        self._blur = 1.0  # of the last fit, in a sharp lens's: the next is likely alike
        n = fine.shape[0]
        self._made: tuple[F64, NDArray[np.float32]] | None = None  # a spread and its blurred print
        self._centre = 0.5 * n - 0.5
        self._spectrum = np.fft.rfft2(fine)
        self._ku = 2.0 * math.pi * np.fft.rfftfreq(n)[None, :]
        self._kv = 2.0 * math.pi * np.fft.fftfreq(n)[:, None]

    def poses(
        self,
        image: Image,
        camera: CameraModel,
        corners: F64,
        down: Vec3 | None = None,
        known_normal: Vec3 | None = None,
        first: Fit | None = None,
    ) -> list[Pose]:
        """Return the one or two poses that explain the pixels, best first.

        The cost of the best is 0, that of the other how much worse it explains them. Where the
        print is too disturbed to be fitted, the poses that explain the corners alone.

        Args:
            image: grey image (height, width).
            camera: the lens.
            corners: (4, 2) pixels, top left first, clockwise as printed.
            down: unit vector of gravity, camera frame; a second solution far from level is not
                worth its fit.
            known_normal: into the pad as the frame before or a ring told it, camera frame; a pose
                that agrees needs no second one beside it.
            first: a fit that found the square; None: it is made from the corners.
        """
        if first is None:
            starts = planar_poses(camera.rays(corners), self._size)
            first = self.fit(image, camera, starts[0][0]) if starts else None
        if first is None or first.explained < EXPLAINED:
            return poses_from_corners(corners, self._size, camera, _CORNER_SIGMA_PX)
        if known_normal is not None and first.pose.normal @ np.array(known_normal) > CONTINUED:
            return [first.pose]
        fits = [first]
        # The other solution, of the corners as they are now known.
        focal = 0.5 * (camera.fx + camera.fy)
        for start, error in planar_poses(self._corner_rays(first.pose), self._size):
            if down is not None and _is_told_by_gravity(first.pose, start, np.array(down)):
                continue
            if float(start.normal @ first.pose.normal) < SAME_NORMAL and error * focal < _TOLD_PX:
                other = self.fit(image, camera, start)
                if other is not None and other.pose.normal @ first.pose.normal < SAME_NORMAL:
                    fits.append(other)
        fits.sort(key=lambda f: f.squares)
        unit = _RIVALS * fits[0].variance
        return [
            Pose(f.pose.R, f.pose.t, f.pose.information, (f.squares - fits[0].squares) / unit)
            for f in fits
        ]

    def track(self, image: Image, camera: CameraModel, expected: Pose) -> Fit | None:
        """Return the fit of the square where it is expected, to a cell; None: it is not there.

        The whole print must be explained, so that nothing else is taken for it.
        """
        fit = self.fit(image, camera, expected, has_rival=False)
        return fit if fit is not None and fit.explained > _TRACKED else None

    def fit(
        self, image: Image, camera: CameraModel, start: Pose, *, has_rival: bool = True
    ) -> Fit | None:
        """Return the pose that explains the pixels round a start near it; None if none does.

        With a rival it will be compared with another fit by how well each explains the pixels.
        """
        patch = self._patch(image, camera, start)
        if patch is None:
            return None
        n = len(patch.grey)
        grey, pose = patch.grey, start
        blur = max(patch.blur, self._blur * patch.blur)
        tenth = n // 10
        ordered = np.partition(grey, (tenth, n - 1 - tenth))
        dark, bright = ordered[tenth], ordered[n - 1 - tenth]
        light = np.array([dark, bright - dark, 0.0, 0.0])  # black, contrast, gradients
        x, y = _normalised(patch.rays[0]), _normalised(patch.rays[1])
        J = np.empty((11, n))
        for _ in range(_STEPS):
            layers = self._layers(blur * self._spread(patch, pose), blur)
            north, east = _plane(patch.rays, pose)
            value, slope_n, slope_e, J[6] = self._seen(layers, north, east)
            shade = 1.0 + light[2] * x + light[3] * y
            level = light[0] + light[1] * value
            contrast = light[1] * shade
            _pose_slope(J[:6], pose, north, east, contrast * slope_n, contrast * slope_e)
            J[6] *= contrast
            J[7] = shade
            np.multiply(shade, value, out=J[8])
            np.multiply(x, level, out=J[9])
            np.multiply(y, level, out=J[10])
            residual = grey - shade * level
            size = np.abs(residual)
            sigma = max(_READ_NOISE, 1.4826 * float(np.partition(size, n // 2)[n // 2]))
            weight = np.minimum(1.0, _ROBUST * sigma / np.maximum(size, 1e-9))
            JW = J * weight
            normal = JW @ J.T
            gradient = JW @ residual
            normal *= _DAMPED
            try:
                step = np.linalg.solve(normal, gradient)
            except np.linalg.LinAlgError:
                return None
            # Not of the blur: its step has no effect until the print is blurred anew.
            gain = float(step @ gradient - step[6] * gradient[6])
            moved = pose.moved(np.concatenate([pose.R @ step[:3], pose.R @ step[3:6]]))
            motion_px = np.abs(self._corner_rays(moved) - self._corner_rays(pose)) / patch.pixel
            pose = moved
            if float(motion_px.max()) < _NEAR_PX:
                blur = min(max(blur + float(step[6]), 0.5 * blur, 0.05), 2.0 * blur)
            light = light + step[7:]
            if not np.isfinite(step).all() or pose.t[2] <= 0 or pose.normal @ pose.t <= 0:
                return None
            settled = float(motion_px.max()) < _CONVERGED_PX
            if settled and (gain < _CONVERGED * sigma**2 or not has_rival):
                break
        self._blur = blur / patch.blur
        bias = patch.bias + _UNSHARP_BIAS * math.sqrt(max(0.0, blur - patch.blur))
        squares = float(weight @ residual**2)
        variance = max(_READ_NOISE**2, squares / max(1.0, float(weight.sum()) - 11.0))
        try:
            information = self._information(normal, variance, pose, bias * patch.pixel)
        except np.linalg.LinAlgError:
            return None
        scatter = float(weight @ (grey - np.average(grey, weights=weight)) ** 2)
        fitted = Pose(pose.R, pose.t, information, 0.0)
        return Fit(fitted, 1.0 - squares / max(scatter, 1e-9), squares, variance)

    def _corner_rays(self, pose: Pose) -> F64:
        """Return the rays (4, 2) of the corners under a pose, on z = 1."""
        p = pose.t + self._corners @ pose.R[:, :2].T
        rays: F64 = p[:, :2] / p[:, 2:]
        return rays

    def _information(self, normal: F64, variance: float, pose: Pose, bias: float) -> F64:
        """Return the information of (dt, w) from the normal matrix (11, 11) of the fit.

        `bias` is the error of the corners that no residual shows, on the plane z = 1.

        Raises:
            LinAlgError: the pixels leave the pose open.
        """
        light = np.linalg.solve(normal[6:, 6:], normal[6:, :6])
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = pose.R
        of_pose = turn @ (normal[:6, :6] - normal[:6, 6:] @ light) @ turn.T
        information: F64 = np.linalg.inv(
            variance * np.linalg.inv(of_pose)
            + np.linalg.inv(corner_information(pose, self._size, bias))
        )
        return information

    def _patch(self, image: Image, camera: CameraModel, pose: Pose) -> _Patch | None:
        """Return the marker's pixels under a pose, reduced if they are many."""
        corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * self._reach
        outline = pose.t + corners @ pose.R[:, :2].T
        if outline[:, 2].min() < 0.05:
            return None
        px = camera.pixels(outline)
        low = np.maximum(np.floor(px.min(axis=0)), 0).astype(int)
        high = np.minimum(np.ceil(px.max(axis=0)) + 1, (camera.width, camera.height)).astype(int)
        in_image = float(np.prod(np.maximum(high - low, 0)))
        area = min(cv2.contourArea(px.astype(np.float32)), in_image)
        reduce = max(1, round(math.sqrt(area) / _LARGEST_SIDE_PX))
        size = (int(high[0] - low[0]) // reduce, int(high[1] - low[1]) // reduce)
        if min(size) < 4:
            return None
        crop = image[low[1] : low[1] + size[1] * reduce, low[0] : low[0] + size[0] * reduce]
        if reduce > 1:
            crop = np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        rays = _lens_grid(camera, low, size, reduce)
        north, east = _plane(rays, pose)
        inside = self._is_used(north, east)
        if np.count_nonzero(inside) < 50:
            return None
        pixel = reduce / (0.5 * (camera.fx + camera.fy))
        blur = 0.36 / reduce**2 + 1.0 / 12.0
        bias = math.hypot(_EDGE_BIAS_PX, _REDUCED_BIAS_PX * reduce)
        grey = crop.reshape(-1)[inside].astype(np.float64)
        return _Patch(grey, rays[:, inside], pixel, blur, bias)

    def _is_used(self, north: F64, east: F64) -> NDArray[np.bool_]:
        """Tell which points (n,) of the plane are compared with the image."""
        used: NDArray[np.bool_] = (np.abs(north) < self._reach) & (np.abs(east) < self._reach)
        return used

    def _spread(self, patch: _Patch, pose: Pose) -> F64:
        """Return the covariance (2, 2) on the print (u, v) of a blur of one pixel's variance."""
        # A turn of the ray t by dr moves its point on the plane by t_z (dr - t n.dr / n.t).
        north, east, normal = pose.R.T
        along = normal[:2] / float(normal @ pose.t)
        A = np.array(
            [east[:2] - float(east @ pose.t) * along, float(north @ pose.t) * along - north[:2]]
        ) * (self._per_m * patch.pixel * float(pose.t[2]))
        spread: F64 = A @ A.T
        return spread

    def _layers(self, spread: F64, blur: float) -> NDArray[np.float32]:
        """Return the blurred print as made last if its blur was nearly this one, else a new one."""
        if self._made is not None:
            made, layers = self._made
            if np.abs(spread - made).max() < _BLUR_CHANGED * made.max():
                return layers
        self._made = (spread, self._blurred(spread, blur))
        return self._made[1]

    def _blurred(self, spread: F64, blur: float) -> NDArray[np.float32]:
        """Return the print (n, n, 4) after a blur: its value and slopes by u, v and the blur."""
        square = (
            spread[0, 0] * self._ku**2
            + 2.0 * spread[0, 1] * self._ku * self._kv
            + spread[1, 1] * self._kv**2
        )
        n = self._spectrum.shape[0]
        spectrum = self._spectrum * np.exp(-0.5 * square)
        value = np.fft.irfft2(spectrum, s=(n, n)).astype(np.float32)
        # A Gaussian's variance spreads as heat does: its slope is half the Laplacian.
        heat = spread[0, 0] * _CURVED_U + spread[1, 1] * _CURVED_U.T + spread[0, 1] * _TWISTED
        slopes = (_SLOPE_U, _SLOPE_U.T, (0.5 / blur) * heat)
        layers = cv2.merge([value, *(cv2.filter2D(value, -1, kernel) for kernel in slopes)])
        return np.asarray(layers, dtype=np.float32)

    def _seen(
        self, layers: NDArray[np.float32], north: F64, east: F64
    ) -> tuple[F64, F64, F64, F64]:
        """Return the blurred print at points (n,), and its slopes by north, east (1/m) and blur."""
        # A pose that a step has thrown far off sees points that no float32 can hold.
        u = np.clip(self._centre + east * self._per_m, -_FAR_OFF, _FAR_OFF).astype(np.float32)
        v = np.clip(self._centre - north * self._per_m, -_FAR_OFF, _FAR_OFF).astype(np.float32)
        at = cv2.remap(layers, u[None, :], v[None, :], cv2.INTER_LINEAR)[0].T.astype(np.float64)
        return at[0], -self._per_m * at[2], self._per_m * at[1], at[3]


def _plane(rays: F64, pose: Pose) -> tuple[F64, F64]:
    """Return where homogeneous rays (3, n) meet the marker's plane: north and east, m, (n,)."""
    H = np.linalg.inv(np.column_stack([pose.R[:, 0], pose.R[:, 1], pose.t]))
    q = H @ rays
    return q[0] / q[2], q[1] / q[2]


def _pose_slope(out: F64, pose: Pose, north: F64, east: F64, slope_n: F64, slope_e: F64) -> None:
    """Write the derivative (6, n) of grey levels by (dt, w), both on the marker's own axes.

    At a fixed ray a plane moved by m = dt + w x arm carries the point -g . m along its axis r,
    g = r - normal (r . ray) / (normal . ray); in the marker's axes g and arm are plain.
    """
    t = pose.R.T @ pose.t
    lift = (slope_n * (north + t[0]) + slope_e * (east + t[1])) / t[2]
    np.negative(slope_n, out=out[0])
    np.negative(slope_e, out=out[1])
    out[2] = lift
    np.multiply(east, lift, out=out[3])
    np.multiply(north, -lift, out=out[4])
    np.subtract(east * slope_n, north * slope_e, out=out[5])


def _lens_grid(camera: CameraModel, low: NDArray[np.int_], size: tuple[int, int], step: int) -> F64:
    """Return the homogeneous rays (3, rows * columns) of a grid of pixels.

    The lens's map is smooth: it is computed at a few nodes and interpolated by polynomials.
    """
    columns, rows = (
        first + np.linspace(0.5, n - 0.5, _LENS_NODES) * step - 0.5
        for first, n in zip(low.tolist(), size, strict=True)
    )
    nodes = np.empty((_LENS_NODES, _LENS_NODES, 2))
    nodes[..., 0] = columns
    nodes[..., 1] = rows[:, None]
    at = camera.rays(nodes.reshape(-1, 2)).T.reshape(2, _LENS_NODES, _LENS_NODES)
    rays = np.ones((3, size[0] * size[1]))
    rays[:2] = (_lagrange(size[1]) @ at @ _lagrange(size[0]).T).reshape(2, -1)
    return rays


@lru_cache
def _lagrange(n: int) -> F64:
    """Return the weights (n, nodes) of polynomial interpolation at n even steps between nodes."""
    powers = np.vander(np.linspace(-1.0, 1.0, _LENS_NODES), increasing=True)
    x = np.linspace(-1.0, 1.0, n)
    weights: F64 = np.vander(x, _LENS_NODES, increasing=True) @ np.asarray(np.linalg.inv(powers))
    return weights


def _normalised(x: F64) -> F64:
    centred: F64 = (x - x.mean()) / max(float(x.max() - x.min()), 1e-9)
    return centred


def _is_told_by_gravity(pose: Pose, other: Pose, down: F64) -> bool:
    return float(pose.normal @ down) > _LEVEL and float(other.normal @ down) < _LEANING
