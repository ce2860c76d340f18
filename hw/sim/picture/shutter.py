"""A rolling shutter: each row of the picture is exposed a little later than the one above it.

Each row therefore has its own pose, and its own homography to a plane. Along a row all values are
smooth: they are computed at a few columns and interpolated by a polynomial. `renderer` and
`pad_view` use it.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from random import Random
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import VibrationOptions
from hw.sim.picture.jpeg import SMALL_PRODUCT
from hw.sim.picture.view import F64, matrix
from hw.sim.snapshot import PadPose, Snapshot
from landerd.camera_model import CameraModel

F32 = NDArray[np.float32]
Block = tuple[slice, slice]  # rows and columns of a grid
EVERYTHING: Block = slice(None), slice(None)

# Time between poses that are interpolated linearly: of what turns at 20 rad/s^2 that is wrong by at
# most 0.06 mrad.
POSE_PERIOD_S = 0.005
COLUMNS = 10  # number of columns of each row at which values are computed
# Least depth of a row's nearest point over that of its farthest for which a polynomial is exact.
EVEN = 0.35


class Vibration:
    """A vibration that turns the camera about its x and its y axis, as a sine of time."""

    def __init__(self, options: VibrationOptions, rng: Random) -> None:
        """Take amplitude and frequency, and draw a random phase for each axis."""
        self._amplitude = math.radians(options.deg)
        self._hz = options.hz
        self._phases = np.array([rng.uniform(0.0, 2.0 * math.pi) for _ in range(2)])

    def turns(self, t: F64, exposure_s: float = 0.0) -> F64:
        """Return the angles about x and y, rad, (n, 2), each the mean over an exposure.

        Args:
            t: middles of the exposures, s, (n,).
            exposure_s: length of each.
        """
        angles = np.sin(2.0 * math.pi * self._hz * t[:, None] + self._phases)
        turns: F64 = self._amplitude * _kept(self._hz * exposure_s) * angles
        return turns

    def shaking(self, exposure_s: float) -> float:
        """Return the standard deviation of either angle about its mean in an exposure, rad.

        A sine's mean square is 1/2; of that, the mean over an exposure T keeps sinc(f T)^2.
        """
        kept = _kept(self._hz * exposure_s) ** 2
        return self._amplitude * math.sqrt(max(1.0 - kept, 0.0) / 2)


@lru_cache(maxsize=1)  # it is needed several times for each picture
def _kept(turned: float) -> float:
    """Return the factor on a sine's amplitude by averaging over a number of its periods."""
    return float(np.sinc(turned))


class RowGrid:
    """The rays of a picture's pixels at a few columns of each row."""

    def __init__(self, camera: CameraModel, x: F64, y: F64) -> None:
        """Compute the rays.

        Args:
            camera: the true one.
            x: columns of the grid, px, ascending, (m,).
            y: rows of the grid, px, ascending, (n,).
        """
        # A polynomial through Chebyshev's points does not oscillate.
        angles = math.pi * (np.arange(COLUMNS) + 0.5) / COLUMNS
        nodes = (x[0] + x[-1]) / 2 - (x[-1] - x[0]) / 2 * np.cos(angles)
        pixels = np.stack(np.meshgrid(nodes, y), axis=-1)
        rays = camera.rays(pixels.reshape(-1, 2)).reshape(len(y), COLUMNS, 2)
        depth = np.ones((len(y), COLUMNS, 1))
        rays = np.concatenate([rays, depth], axis=-1).transpose(0, 2, 1)
        self.rays = np.ascontiguousarray(rays)  # (n, 3, COLUMNS)
        self.rows = (y - (camera.height - 1) / 2) / camera.height  # -0.5 (top) to 0.5, (n,)
        self.nodes = nodes
        self.top = float(y[0])
        self.focal = np.array([camera.fx, camera.fy])
        # Values of Lagrange's polynomials at the columns x, in the barycentric form.
        scaled = 4.0 / (x[-1] - x[0]) * nodes
        weights = 1.0 / (scaled[:, None] - scaled + np.eye(COLUMNS)).prod(axis=1)
        parts = weights[:, None] / (x - nodes[:, None] + 1e-9)
        self.basis = (parts / parts.sum(axis=0)).astype(np.float32)  # (COLUMNS, m)
        self._weights: dict[int, F64] = {}

    def weights(self, k: int) -> F64:
        """Return the weights (n, k) of linear interpolation between k values at equal steps.

        The first value is that of the image's first row, the last that of its last row.
        """
        if k not in self._weights:
            at = (self.rows + 0.5)[:, None] * (k - 1)
            # Rows beyond the first and the last are extrapolated linearly.
            before = np.clip(np.floor(at), 0, max(k - 2, 0))
            share = (at - before) * (k > 1)
            places = np.arange(k)
            self._weights[k] = (1.0 - share) * (places == before) + share * (places == before + 1)
        return self._weights[k]


@dataclass(frozen=True)
class Readout:
    """The motion of camera and pad while one picture is read.

    Attributes:
        t: middle of the exposure of the middle row, s.
        readout_s: time from the exposure of the first row to that of the last.
        exposure_s: exposure time of each row.
        snapshots: the world at equal steps from the first row to the last; a single one: nothing
            moves.
        vibration: of the camera, in addition to its poses in the snapshots; None: there is none.
    """

    t: float
    readout_s: float
    exposure_s: float
    snapshots: tuple[Snapshot, ...]
    vibration: Vibration | None = None

    def homographies(self, grid: RowGrid, plane: PadPose, pad: PadPose | None) -> F64:
        """Return each row's `plane_homography` from rays to a plane, (rows, 3, 3).

        Args:
            grid: the rows.
            plane: pose of the plane at the middle of the exposure.
            pad: pose of the pad at that time, for a plane that moves with it; None: the plane
                stands still.
        """
        c, d = self._from_plane(plane, pad)
        height = np.minimum(c[:, 2:], -1e-3)  # a lens below the plane counts as just above it
        north = c[:, :1] * d[:, 2] - height * d[:, 0]
        east = c[:, 1:2] * d[:, 2] - height * d[:, 1]
        shots = np.concatenate([north, east, d[:, 2]], axis=1)
        H: F64 = (grid.weights(len(shots)) @ shots).reshape(-1, 3, 3)
        if self.vibration is not None:
            turns = self.vibration.turns(self.t + self.readout_s * grid.rows, self.exposure_s)
            H += H @ _across(turns)
        return H

    def _from_plane(self, plane: PadPose, pad: PadPose | None) -> tuple[F64, F64]:
        """Return the lens's position (k, 3), m, and R_plane_camera (k, 3, 3) in each snapshot.

        Both are in the frame of the plane; arguments are those of `homographies`.
        """
        cameras, looks, pads, turned = self.poses
        position, R = np.array(plane.position), matrix(plane.R_local_pad)
        if pad is None:
            return (cameras - position) @ R, R.T @ looks
        turned = turned @ matrix(pad.R_local_pad).T
        offset = position - np.array(pad.position)
        to_plane = (turned @ R).transpose(0, 2, 1)
        return (to_plane @ (cameras - pads - turned @ offset)[..., None])[..., 0], to_plane @ looks

    @property
    def shaking(self) -> float:
        """Standard deviation of the camera's angle about either axis in an exposure, rad."""
        return self.vibration.shaking(self.exposure_s) if self.vibration is not None else 0.0

    @cached_property
    def poses(self) -> tuple[F64, F64, F64, F64]:
        """Position (k, 3) and rotation (k, 3, 3) of the camera and of the pad in each snapshot."""
        cameras = [s.camera for s in self.snapshots]
        pads = [s.pad for s in self.snapshots]
        return (
            np.array([c.position for c in cameras]),
            np.array([c.R_local_camera for c in cameras]),
            np.array([p.position for p in pads]),
            np.array([p.R_local_pad for p in pads]),
        )


class RolledPlane:
    """Relates how a rolling shutter sees a plane to how it is seen from a single pose."""

    def __init__(self, grid: RowGrid, H: F64, rows: F64) -> None:
        """Take the homographies to the plane.

        Args:
            grid: the rows.
            H: `plane_homography` of the single pose, (3, 3).
            rows: that of each row, (rows, 3, 3).
        """
        self._grid = grid
        self._to_pose = np.linalg.inv(H) @ rows

    def rays(self, block: Block) -> F32:
        """Return the rays (n, m, 2) of the single pose to the points that a block sees."""
        rows, columns = block
        x, y = _divided(self._to_pose[rows] @ self._grid.rays[rows])
        basis = self._grid.basis[:, columns]
        return cast(F32, cv2.merge((_spread(x, basis), _spread(y, basis))))

    def corners(self, block: Block) -> F32:
        """Return those of `rays` at the corners of a block, (2, 2, 2)."""
        rows, columns = block
        ends = [0, -1]
        seen = _divided(self._to_pose[rows][ends] @ self._grid.rays[rows][ends])
        basis = self._grid.basis[:, columns][:, ends]
        return np.stack([part @ basis for part in seen], axis=-1)

    def texels(self, block: Block, to_texels: F64) -> tuple[F32, F32] | None:
        """Return the columns and the rows (n, m) of the texture that a block of pixels sees.

        None: the plane is so steep that they must be computed from `rays`.

        Args:
            block: of pixels.
            to_texels: homography (3, 3) from the single pose's rays to texels.
        """
        rows, columns = block
        seen = (to_texels @ self._to_pose[rows]) @ self._grid.rays[rows]
        depth = seen[:, 2]
        if (depth.min(axis=1) < EVEN * depth.max(axis=1)).any():
            return None
        u, v = _divided(seen)
        basis = self._grid.basis[:, columns]
        return _spread(u, basis), _spread(v, basis)

    def moved(self, pixels: F64) -> F64:
        """Return where points (n, 2), px, of the single pose's picture are seen, to some 0.1 px."""
        grid = self._grid
        seen = pixels
        for _ in range(2):
            row = np.clip(np.rint(seen[:, 1] - grid.top).astype(int), 0, len(grid.rays) - 1)
            column = np.abs(seen[:, :1] - grid.nodes).argmin(axis=1)
            rays = grid.rays[row, :, column]
            to_pose = (self._to_pose[row] @ rays[..., None])[..., 0]
            skew = to_pose[:, :2] / to_pose[:, 2:] - rays[:, :2]
            seen = pixels - skew * grid.focal
        return seen


def _across(turns: F64) -> F64:
    """Return the matrices (n, 3, 3) of the vector product with rotations (n, 2) about x and y."""
    x, y = turns.T
    zero = np.zeros_like(x)
    rows = [[zero, zero, y], [zero, zero, -x], [-y, x, zero]]
    return np.array(rows).transpose(2, 0, 1)


def _spread(nodes: F32, basis: F32) -> F32:
    """Return nodes (n, COLUMNS) times basis (COLUMNS, m), some rows at a time.

    OpenBLAS starts no threads for such small products; the threads would cost more than they save.
    """
    whole = np.empty((len(nodes), basis.shape[1]), np.float32)
    rows = max(SMALL_PRODUCT // basis.size, 1)
    for top in range(0, len(nodes), rows):
        np.dot(nodes[top : top + rows], basis, out=whole[top : top + rows])
    return whole


def _divided(seen: F64) -> tuple[F32, F32]:
    """Return x and y, (n, k) each, of homogeneous points (n, 3, k)."""
    depth = seen[:, 2]
    return (seen[:, 0] / depth).astype(np.float32), (seen[:, 1] / depth).astype(np.float32)
