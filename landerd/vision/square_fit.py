"""Pose of a square marker by least squares on its pixels.

The whole print is known, so every edge of every cell helps, not only the four corners. The model
image is the print seen under a pose, blurred by the camera and lit with a linear gradient; pose,
blur and light are fitted together (Gauss-Newton). Its information matrix is the pose's after
blur and light are eliminated.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.pad import Square
from landerd.vision.pose import Pose
from landerd.vision.square_pose import corner_information

Image = NDArray[np.uint8]

_PER_CELL = 6  # samples of the print along a cell
_MARGIN_CELLS = 2  # white round the print
_USED_MARGIN_CELLS = 0.9  # of it, what is compared with the image
_LARGEST_SIDE_PX = 48.0  # larger markers are fitted on a reduced image
_STEPS = 5
_LENS_NODES = 5
_ROBUST = 2.5  # residuals beyond this many sigma count less (Huber)
_READ_NOISE = 1.0  # grey levels: no residual is trusted to be smaller
_EDGE_BIAS_PX = 0.02  # what lens model, light and pixels leave out, as an error of the corners
# Neighbouring residuals share the model's small errors, so n pixels tell less than n times one.
_INFLATION = 1.5


# A fit that explains less of the pixels' variance is no better than the corners.
_EXPLAINED = 0.85
_SAME_NORMAL = math.cos(math.radians(1.0))


@dataclass(frozen=True)
class Fit:
    """A fitted pose and how well it explains the pixels."""

    pose: Pose
    explained: float  # share of the pixels' variance, 1 at best
    squares: float  # weighted sum of squared residuals, grey levels^2
    variance: float  # of one residual, grey levels^2


class SquarePrint:
    """The print of one square marker, ready to be compared with images."""

    def __init__(self, square: Square, cells: NDArray[np.bool_]) -> None:
        """Prepare from the print's cells (n, n): True is white, top row first, border included."""
        self._size = square.size_m
        self._cells = cells.shape[0]
        padded = np.pad(cells.astype(np.float64), _MARGIN_CELLS, constant_values=1.0)
        fine = np.kron(padded, np.ones((_PER_CELL, _PER_CELL)))
        n = fine.shape[0]
        self._spectrum = np.fft.rfft2(fine)
        self._ku = 2.0 * math.pi * np.fft.rfftfreq(n)[None, :]
        self._kv = 2.0 * math.pi * np.fft.fftfreq(n)[:, None]

    def fit(self, image: Image, camera: CameraModel, start: Pose) -> Fit | None:
        """Return the pose that explains the pixels round a start near it; None if none does."""
        patch = self._patch(image, camera, start)
        if patch is None:
            return None
        grey, rays, blur = patch
        pose = start
        light = np.array([*np.percentile(grey, (10.0, 90.0)), 0.0, 0.0])
        light[1] -= light[0]
        x, y = _normalised(rays[:, 0]), _normalised(rays[:, 1])
        for _ in range(_STEPS):
            value, slope_n, slope_e, slope_b = self._seen(rays, pose, blur)
            shade = 1.0 + light[2] * x + light[3] * y
            level = light[0] + light[1] * value
            residual = grey - shade * level
            J = np.empty((len(grey), 11))
            J[:, :6] = _pose_slope(
                rays, pose, shade * light[1] * slope_n, shade * light[1] * slope_e
            )
            J[:, 6] = shade * light[1] * slope_b
            J[:, 7] = shade
            J[:, 8] = shade * value
            J[:, 9] = x * level
            J[:, 10] = y * level
            sigma = max(_READ_NOISE, 1.4826 * float(np.median(np.abs(residual))))
            weight = np.minimum(1.0, _ROBUST * sigma / np.maximum(np.abs(residual), 1e-9))
            JW = J.T * weight
            normal = JW @ J
            gradient = JW @ residual
            normal[np.diag_indices(11)] *= 1.0 + 1e-6
            try:
                step = np.linalg.solve(normal, gradient)
            except np.linalg.LinAlgError:
                return None
            pose = pose.moved(step[:6])
            blur = min(max(blur + step[6], 0.25 * blur, 0.05), 4.0 * blur)
            light = light + step[7:]
            if not np.isfinite(step).all() or pose.t[2] <= 0 or pose.normal @ pose.t <= 0:
                return None
            if np.abs(step[:3]).max() < 1e-5 * pose.t[2] and np.abs(step[3:6]).max() < 1e-4:
                break
        squares = float(weight @ residual**2)
        variance = max(_READ_NOISE**2, squares / max(1.0, float(weight.sum()) - 11.0))
        bias = _EDGE_BIAS_PX / (0.5 * (camera.fx + camera.fy))
        try:
            of_pose = normal[:6, :6] - normal[:6, 6:] @ np.linalg.solve(
                normal[6:, 6:], normal[6:, :6]
            )
            information = np.linalg.inv(
                _INFLATION * variance * np.linalg.inv(of_pose)
                + np.linalg.inv(corner_information(pose, self._size, bias))
            )
        except np.linalg.LinAlgError:
            return None
        spread = float(weight @ (grey - np.average(grey, weights=weight)) ** 2)
        return Fit(
            Pose(pose.R, pose.t, information, 0.0),
            1.0 - squares / max(spread, 1e-9),
            squares,
            variance,
        )

    def refined(self, image: Image, camera: CameraModel, starts: list[Pose]) -> list[Pose]:
        """Return the starts fitted to the pixels, best first; the starts if that fails.

        The cost of the best is 0, that of the other how much worse it explains the pixels.
        """
        fits = [f for s in starts if (f := self.fit(image, camera, s)) is not None]
        fits.sort(key=lambda f: f.squares)
        if not fits or fits[0].explained < _EXPLAINED:
            return starts
        unit = _INFLATION * fits[0].variance
        poses: list[Pose] = []
        for f in fits:
            if not any(float(p.normal @ f.pose.normal) > _SAME_NORMAL for p in poses):
                cost = (f.squares - fits[0].squares) / unit
                poses.append(Pose(f.pose.R, f.pose.t, f.pose.information, cost))
        return poses

    def _patch(
        self, image: Image, camera: CameraModel, pose: Pose
    ) -> tuple[F64, F64, float] | None:
        """Return grey levels (n,), rays (n, 2) of the marker's pixels, and the blur's variance."""
        reach = 0.5 * self._size * (1.0 + 2.0 * _USED_MARGIN_CELLS / self._cells)
        corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * reach
        outline = pose.t + corners @ pose.R[:, :2].T
        if outline[:, 2].min() < 0.05:
            return None
        px = camera.pixels(outline)
        low = np.maximum(np.floor(px.min(axis=0)), 0).astype(int)
        high = np.minimum(np.ceil(px.max(axis=0)) + 1, (camera.width, camera.height)).astype(int)
        area = cv2.contourArea(px.astype(np.float32))
        reduce = max(1, round(math.sqrt(area) / _LARGEST_SIDE_PX))
        columns, rows = (high - low) // reduce
        if columns < 4 or rows < 4:
            return None
        crop = image[low[1] : low[1] + rows * reduce, low[0] : low[0] + columns * reduce]
        if reduce > 1:
            size = (int(columns), int(rows))
            crop = np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        rays = _lens_grid(camera, low, (int(columns), int(rows)), reduce)
        u, v = self._plane(rays, pose)
        inside = (np.abs(u) < reach) & (np.abs(v) < reach)
        if int(inside.sum()) < 50:
            return None
        # Variance of a sharp lens's spread and of the pixel's box, in the reduced image's pixels.
        blur = 0.36 / reduce**2 + 1.0 / 12.0
        self._step = reduce / (0.5 * (camera.fx + camera.fy))
        return crop.reshape(-1)[inside].astype(np.float64), rays[inside], blur

    def _plane(self, rays: F64, pose: Pose) -> tuple[F64, F64]:
        """Return where rays (n, 2) meet the marker's plane: north and east, m, (n,) each."""
        H = np.linalg.inv(np.column_stack([pose.R[:, 0], pose.R[:, 1], pose.t]))
        q = rays @ H[:, :2].T + H[:, 2]
        return q[:, 0] / q[:, 2], q[:, 1] / q[:, 2]

    def _seen(self, rays: F64, pose: Pose, blur: float) -> tuple[F64, F64, F64, F64]:
        """Return the blurred print at rays (n, 2), and its slopes by north, east (1/m) and blur."""
        north, east = self._plane(rays, pose)
        per_m = self._cells * _PER_CELL / self._size
        centre = 0.5 * self._cells * _PER_CELL + _MARGIN_CELLS * _PER_CELL - 0.5
        u = (centre + east * per_m).astype(np.float32)[None, :]
        v = (centre - north * per_m).astype(np.float32)[None, :]
        spread = self._spread(pose, per_m)
        square = (
            spread[0, 0] * self._ku**2
            + 2.0 * spread[0, 1] * self._ku * self._kv
            + spread[1, 1] * self._kv**2
        )
        blurred = self._spectrum * np.exp(-0.5 * blur * square)
        n = self._spectrum.shape[0]
        layers = np.fft.irfft2(
            np.stack(
                [blurred, blurred * (1j * self._ku), blurred * (1j * self._kv), blurred * square]
            ),
            s=(n, n),
        ).astype(np.float32)
        at = [cv2.remap(layer, u, v, cv2.INTER_LINEAR)[0].astype(np.float64) for layer in layers]
        return at[0], -at[2] * per_m, at[1] * per_m, -0.5 * at[3]

    def _spread(self, pose: Pose, per_m: float) -> F64:
        """Return the covariance (2, 2) on the print (u, v) of a blur of one pixel's variance."""
        centre = pose.t[:2] / pose.t[2]
        rays = centre + self._step * np.array([[0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]])
        north, east = self._plane(rays, pose)
        A = per_m * np.array(
            [[east[0] - east[1], east[2] - east[3]], [north[1] - north[0], north[3] - north[2]]]
        )
        return A @ A.T


def _pose_slope(rays: F64, pose: Pose, slope_n: F64, slope_e: F64) -> F64:
    """Return the derivative (n, 6) of grey levels by (dt, w) from their slopes on the plane.

    At a fixed ray a plane moved by m = dt + w x arm carries the point -g m along north and
    east, g being the axis less its part along the ray seen edge-on.
    """
    r_n, r_e, normal = pose.R[:, 0], pose.R[:, 1], pose.normal
    ray = np.column_stack([rays, np.ones(len(rays))])
    across = ray @ normal
    q = ray * ((normal @ pose.t) / across)[:, None] - pose.t
    along = slope_n * (ray @ r_n) + slope_e * (ray @ r_e)
    g = np.outer(slope_n, r_n) + np.outer(slope_e, r_e) - np.outer(along / across, normal)
    return -np.hstack([g, np.cross(q, g)])


def _lens_grid(camera: CameraModel, low: NDArray[np.int_], size: tuple[int, int], step: int) -> F64:
    """Return the rays (rows * columns, 2) of a grid of pixels.

    The lens's map is smooth: it is computed at a few nodes and interpolated by polynomials.
    """
    weights, nodes = [], []
    for first, n in zip(low, size, strict=True):
        centres = first + (np.arange(n) + 0.5) * step - 0.5
        node = np.linspace(centres[0], centres[-1], _LENS_NODES)
        nodes.append(node)
        weights.append(_lagrange(node, centres))
    gx, gy = np.meshgrid(nodes[0], nodes[1])
    at = camera.rays(np.column_stack([gx.ravel(), gy.ravel()])).T.reshape(2, *gx.shape)
    grid = weights[1] @ at @ weights[0].T
    return np.ascontiguousarray(grid.reshape(2, -1).T)


def _lagrange(nodes: F64, x: F64) -> F64:
    """Return the weights (len(x), len(nodes)) of polynomial interpolation."""
    weights = np.ones((len(x), len(nodes)))
    for j in range(len(nodes)):
        for k in range(len(nodes)):
            if k != j:
                weights[:, j] *= (x - nodes[k]) / (nodes[j] - nodes[k])
    return weights


def _normalised(x: F64) -> F64:
    centred: F64 = (x - x.mean()) / max(float(np.ptp(x)), 1e-9)
    return centred
