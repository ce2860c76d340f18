"""A pad's heading from the print of a square beside a ring that is seen.

A decoder needs a square's whole border and code. But once a ring of the pad tells place and tilt,
only the heading is open. The picture is sampled in polar coordinates on the pad's plane about the
ring's centre, where a heading is a shift in angle, and correlated with the print at each. If dirt
or glare hides the code, the place of the square still tells the heading, and those edges between
its cells that are seen (`print_edges`) tell that it is the pad's square and no other.

`search` turns to it for rings round which no square was decoded; the sighting has stage BESIDE, as
only its heading was measured.
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

_STEP_CELLS = 0.5  # distance of samples along radii and, at the square, between them
_MARGIN_CELLS = 1.0  # width of the white round the print that is compared
_PER_CELL = 8  # samples of the print along a cell
_BLUR_CELLS = 0.4  # sigma of the print's blur: what a lens makes of cells of 1.5 px
_MIN_CELL_PX = 1.2
_MIN_IN_IMAGE = 0.8  # share of the print
_NEXT_END = 8  # samples in angle from one point that is tested for being in the picture to the next
_MIN_SCATTER = 4.0  # grey levels, rms: less is noise
# Least correlation, set by trial: that of the code as well as that of the whole print, or another
# square would do; and its least lead over any heading farther than _NEXT from the best.
_MIN_CORRELATION = 0.57
_MIN_LEAD = 0.15
_NEXT = math.radians(12.0)
# The lead that is enough for a higher correlation. Out of focus a code is like itself when turned:
# of 960 looks at other ids, at tags of 0.18 m from 2.3 m through a blur of 2.4 px, the best gave
# 0.69, the right id 0.77 to 0.81 with leads from 0.09.
_SURE_CORRELATION, _SURE_LEAD = 0.73, 0.07
# A print whose code is hidden in part: least correlation of the whole print, and the angle within
# which the pose fitted to its edges must lie in the ring's plane.
_MIN_WHOLE, _SAME_PLANE_COS = 0.35, math.cos(math.radians(10.0))
# Sigmas of the pose except its heading: a share of the range (and a cell, aside), and rad. Place
# and tilt are the ring's, which counts by itself, so these are large enough to tell nothing.
_RANGE_SHARE, _TILT_SIGMA = 0.05, 0.3
# Sigma of the heading, in angles between samples: on pads of 1.2 to 9 m, in focus and out of it, it
# was off by 0.07 of one (at a ring's centre) to 0.35 (0.75 m beside it), rms, under dirt by up to
# 0.35.
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
        # Points to which the print reaches at each heading: one must be in the picture.
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

        Only its heading is measured, the rest is the ring's.

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
        """Return correlation and heading about the axes R (3, 3) of a ring at t; None: not seen."""
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
        """Return the best score and its heading, interpolated; None: too low, or little lead."""
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
        """Return correlation and heading if the edges between cells show the print to be the pad's.

        `whole` are the correlations of the whole print at each angle.
        """
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
        """Return the square's pose beside a ring at t; `north` are the pad's axes (3, 2)."""
        top = north @ rotation_2d(self._heading)[:, 0]
        return Pose(rotation_from(normal, top), t + north @ self._place, information, 0.0)

    def _pose(self, ring: PoseSolution, R: F64, heading: float) -> Pose:
        """Return the square's pose beside a ring, by the pad's heading about the axes R (3, 3)."""
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

    Each is over the part of the print that is in the image at that shift; -1 if that is too little.

    Args:
        kernels: of the print, as `_kernels` returns them.
        spectra: of the mask of what is in the image, its grey levels and their squares, (radii, n).
        count: number of angles.
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
