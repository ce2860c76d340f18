"""A pad's heading from the print of a square beside a ring that is seen.

A decoder needs a square's whole border and code. Where a ring of the pad tells place and tilt, only
the heading is open: the picture is sampled in polar coordinates on the pad's plane about the ring's
centre, where a heading is a shift in angle, and compared with the print at each. Where dirt hides
the code, or a glare lies on it, the place of the square tells the heading, and the edges between
its cells, as far as they are seen, that it is the pad's and no other.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.messages import PoseSolution
from landerd.pad import Ring, Square
from landerd.vision.arrays import Image
from landerd.vision.linear import inverse
from landerd.vision.patch import is_any_in_picture, levels_at
from landerd.vision.pose import Pose, rotation_2d, rotation_from, wrapped
from landerd.vision.square_edges import square_edges

_STEP_CELLS = 0.5  # between samples, along radii and, at the square, between them
_MARGIN_CELLS = 1.0  # of the white round the print that is compared
_PER_CELL = 8  # samples of the print along a cell, and
_BLUR_CELLS = 0.4  # sigma of its blur: what a lens makes of cells of 1.5 px
_MIN_CELL_PX = 1.2
_MIN_IN_IMAGE = 0.8  # share of the print
_NEXT_END = 8  # angles
_MIN_SCATTER = 4.0  # grey levels, rms: less is noise
# Correlations, set by trial: of the code as of the whole, or another square would do, and above
# that at any heading which is not next to the best.
_MIN_CORRELATION = 0.57
_MIN_LEAD = 0.15
# Out of focus the code's turns are like one another: of 960 looks at other ids, at 0.18 m from
# 2.3 m through a blur of 2.4 px, the best gave 0.69, one's own 0.77 to 0.81 with leads from 0.09.
_SURE_CORRELATION, _SURE_LEAD = 0.73, 0.07
_NEXT = math.radians(12.0)
# Of a print whose code is hidden in part: its edges tell the rest, and lie in the ring's plane.
_MIN_WHOLE, _SAME_PLANE_COS = 0.35, math.cos(math.radians(10.0))
# How surely the pose is known besides the heading. All of that is the ring's, which is counted
# already: a cell and a share of the range that the print was compared to, as good as nothing.
_RANGE_SHARE, _TILT_SIGMA = 0.05, 0.3
# Of the heading, angles between samples: on pads of 1.2 to 9 m, in focus and out of it, it was off
# by 0.07 of one (in a ring's heart) to 0.35 (0.75 m beside it), rms, under dirt by up to 0.35.
_HEADING_SIGMA = 0.4


class SquareBeside:
    """The print of a square as it lies beside a ring of its pad."""

    def __init__(self, square: Square, cells: NDArray[np.bool_], ring: Ring) -> None:
        """Prepare from the print's cells (n, n): True is white, top row first, border included."""
        self._heading = math.radians(square.heading_deg)
        self._place = np.array(square.position_m) - np.array(ring.position_m)
        self._cell = square.size_m / len(cells)
        half = 0.5 * square.size_m + _MARGIN_CELLS * self._cell
        distance = float(np.linalg.norm(self._place))
        step = _STEP_CELLS * self._cell
        count = math.ceil(2.0 * math.pi * max(distance, half) / step)
        self._angles = np.arange(count) * (2.0 * math.pi / count)
        reach = math.sqrt(2.0) * half
        self._radii = np.arange(max(0.0, distance - reach) + 0.5 * step, distance + reach, step)
        along = np.stack([np.cos(self._angles), np.sin(self._angles)], axis=-1)
        # Wherever it is about the ring, so far reaches what must be in the picture.
        self._ends: F64 = (distance + 0.25 * square.size_m) * along[::_NEXT_END]
        self._points: F64 = self._radii[:, None, None] * along  # on the plane, (radii, angles, 2)
        at = (self._points - self._place) @ rotation_2d(self._heading)
        print_ = _sampled(cells, at / self._cell)
        off = np.abs(at).max(axis=-1)
        code = 0.5 * square.size_m - self._cell
        self._edges = square_edges(cells, square.size_m)
        self._kernels = [
            _kernels(print_, self._radii[:, None] * (off < limit)) for limit in (half, code)
        ]

    def find(
        self, image: Image, camera: CameraModel, ring: tuple[PoseSolution, ...]
    ) -> Pose | None:
        """Return the square's pose beside a ring with these solutions; None: it is not seen.

        Its heading is measured, the rest is the ring's.

        Args:
            image: grey image (height, width).
            camera: the lens.
            ring: its solutions.
        """
        focal = camera.focal
        best: tuple[float, Pose] | None = None
        for s in ring:
            t, normal = np.array(s.position), np.array(s.normal)
            if float(normal @ t) * focal * self._cell < _MIN_CELL_PX * float(t @ t):
                continue
            R = rotation_from(normal)
            if not is_any_in_picture(camera, t + self._ends @ R[:, :2].T):
                continue
            found = self._heading_in(image, camera, t, R)
            if found is not None and (best is None or found[0] > best[0]):
                best = (found[0], self._pose(s, R, found[1]))
        return None if best is None else best[1]

    def _heading_in(
        self, image: Image, camera: CameraModel, t: F64, R: F64
    ) -> tuple[float, float] | None:
        """Return correlation and heading, about the axes R (3, 3) of a ring at t; None: no."""
        points = (t + self._points @ R[:, :2].T).reshape(-1, 3)
        grey = levels_at(image, camera, points)
        is_seen = ~np.isnan(grey)
        if not is_seen.any():
            return None
        grey = np.where(is_seen, grey - grey[is_seen].mean(), 0.0)
        shape = self._points.shape[:2]
        spectra = [
            np.fft.rfft(x.reshape(shape), axis=1) for x in (is_seen.astype(float), grey, grey**2)
        ]
        whole, code = (_correlations(k, spectra, shape[1]) for k in self._kernels)
        return self._peak(np.minimum(whole, code)) or self._hidden(image, camera, t, R, whole)

    def _peak(self, scores: F64) -> tuple[float, float] | None:
        k = int(np.argmax(scores))
        top = float(scores[k])
        away = np.abs(wrapped(self._angles - self._angles[k]))
        lead = top - float(scores[away > _NEXT].max())
        is_sure = top > _SURE_CORRELATION and lead > _SURE_LEAD
        if not is_sure and (top < _MIN_CORRELATION or lead < _MIN_LEAD):
            return None
        before, after = float(scores[k - 1]), float(scores[(k + 1) % len(scores)])
        bend = 2.0 * top - before - after
        step = self._angles[1] * 0.5 * (after - before) / max(bend, 1e-9)
        return top, float(self._angles[k]) + step

    def _hidden(
        self, image: Image, camera: CameraModel, t: F64, R: F64, whole: F64
    ) -> tuple[float, float] | None:
        """Return the same where the edges between cells must tell whose print it is."""
        k = int(np.argmax(whole))
        if whole[k] < _MIN_WHOLE:
            return None
        north = R[:, :2] @ rotation_2d(float(self._angles[k]))
        start = self._square(R[:, 2], t, north, np.zeros((6, 6)))
        found = self._edges.fit_hidden(image, camera, start)
        if found is None or float(found.pose.normal @ R[:, 2]) < _SAME_PLANE_COS:
            return None
        top = R[:, :2].T @ found.pose.R[:, 0]
        return float(whole[k]), math.atan2(top[1], top[0]) - self._heading

    def _square(self, normal: F64, t: F64, north: F64, information: F64) -> Pose:
        """Return the square's pose beside a ring at t, under axes north (3, 2) of the pad."""
        top = north @ rotation_2d(self._heading)[:, 0]
        return Pose(rotation_from(normal, top), t + north @ self._place, information, 0.0)

    def _pose(self, ring: PoseSolution, R: F64, heading: float) -> Pose:
        """Return the square's pose beside a ring whose axes R (3, 3) the pad is turned against."""
        north = R[:, :2] @ rotation_2d(heading)
        t = np.array(ring.position)
        C = np.zeros((6, 6))
        C[:3, :3] = (
            np.array(ring.covariance) + np.eye(3) * self._cell**2 + np.outer(t, t) * _RANGE_SHARE**2
        )
        normal = np.array(ring.normal)
        across = np.eye(3) - np.outer(normal, normal)
        sigma = _HEADING_SIGMA * float(self._angles[1])
        C[3:, 3:] = across * _TILT_SIGMA**2 + np.outer(normal, normal) * sigma**2
        return self._square(normal, t, north, inverse(C))


def _sampled(cells: NDArray[np.bool_], at: F64) -> F64:
    """Return a print, 1 white and -1 black, blurred, at points (..., 2) north and east, cells."""
    margin = 3
    fine = np.kron(
        np.pad(2.0 * cells - 1.0, margin, constant_values=1.0), np.ones((_PER_CELL, _PER_CELL))
    )
    blurred = cv2.GaussianBlur(fine.astype(np.float32), (0, 0), _BLUR_CELLS * _PER_CELL)
    middle = 0.5 * (len(blurred) - 1)
    u, v = (middle + at[..., 1] * _PER_CELL), (middle - at[..., 0] * _PER_CELL)
    sampled = cv2.remap(blurred, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
    return np.asarray(sampled, dtype=np.float64)


def _kernels(print_: F64, weight: F64) -> list[NDArray[np.complex128]]:
    """Return the conjugate spectra of weight, and of it times print and squared print."""
    weight = weight / weight.sum()
    return [np.conj(np.fft.rfft(weight * x, axis=1)) for x in (np.ones(1), print_, print_**2)]


def _correlations(
    kernels: list[NDArray[np.complex128]], spectra: list[NDArray[np.complex128]], count: int
) -> F64:
    """Return the correlation coefficients (count,) of print and image at every shift in angle.

    Of what is in the image at a shift; where that is too little, -1.

    Args:
        kernels: of the print, as `_kernels` has them.
        spectra: of what is in the image, its grey levels and their squares, (radii, ...).
        count: of angles.
    """

    def summed(kernel: NDArray[np.complex128], spectrum: NDArray[np.complex128]) -> F64:
        return np.fft.irfft((kernel * spectrum).sum(axis=0), n=count)

    weight, of_print, of_square = kernels
    inside, grey, squared = spectra
    seen = summed(weight, inside)
    is_told = seen > _MIN_IN_IMAGE
    seen = np.where(is_told, seen, 1.0)
    mean, print_mean = summed(weight, grey) / seen, summed(of_print, inside) / seen
    scatter = summed(weight, squared) / seen - mean**2
    print_scatter = summed(of_square, inside) / seen - print_mean**2
    both = summed(of_print, grey) / seen - mean * print_mean
    is_told &= scatter > _MIN_SCATTER**2
    scale = np.sqrt(np.maximum(scatter * print_scatter, 1e-9))
    correlations: F64 = np.where(is_told, both / scale, -1.0)
    return correlations
