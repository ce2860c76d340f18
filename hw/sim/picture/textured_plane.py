"""A texture that repeats on a horizontal plane, as a camera sees it."""

import math
from typing import NamedTuple, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.view import F64, NO_SECOND_MAP, footprint, level_of_detail, rays_at
from landerd.camera_model import CameraModel

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

LEVELS = 7  # of detail, each of half the resolution of the one before
LEAST_DESCENT = 0.02  # of a ray, per unit of depth, that still meets what can be seen
BANDS = 5  # of a coarse picture, each drawn from one level of detail
ROWS = 80  # of a fine picture drawn from one level of detail
SPACING = 8  # pixels of a fine picture between rays that are followed
LARGEST = 2048  # texels of a tile that is repeated twice at its full resolution


class Tile:
    """A texture that repeats, in falling resolution.

    Attributes:
        texel_m: side of a texel of the finest level.
        size_m: of the tile, rows to the north, columns to the east.
        corner_m: north, east of the first texel's outer corner.
        levels: the texture, repeated so often that samples seldom lie beyond it: they are slow.
    """

    def __init__(
        self, texture: U8, texel_m: float, corner_m: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Take a texture whose sides are divisible by 2**(LEVELS - 1)."""
        self.texel_m = texel_m
        self.size_m = np.array(texture.shape) * texel_m
        self.corner_m = np.array(corner_m)
        repeats = 2 if max(texture.shape) <= LARGEST else 1
        self.levels: list[U8] = []
        for level in range(LEVELS):
            self.levels.append(np.tile(texture, (repeats * 2 ** max(level - 1, 0),) * 2))
            size = (texture.shape[1] // 2, texture.shape[0] // 2)
            texture = cast(U8, cv2.resize(texture, size, interpolation=cv2.INTER_AREA))

    def to_texels(self, level: int, about: F64) -> F64:
        """Return the matrix (3, 3) from north, east to a level's texels near a place (2,)."""
        texel = self.texel_m * 2**level
        # Whole tiles off the coordinates bring them to the middle of the repeated texture.
        middle_m = texel * np.array(self.levels[level].shape) / 2
        tiles = np.round((about - self.corner_m - middle_m) / self.size_m)
        north, east = (self.corner_m + tiles * self.size_m).tolist()
        return np.array(
            [
                [0.0, 1 / texel, -east / texel - 0.5],
                [1 / texel, 0.0, -north / texel - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )


class _Sampling(NamedTuple):
    """How part of a picture is drawn."""

    level: int  # of detail
    interpolation: int  # OpenCV's
    halved: bool  # at every second pixel along each side, smoothed between


class TexturedPlane:
    """Draws the plane into pictures of one size.

    Attributes:
        shape: rows and columns of the pictures.
        x, y: columns and rows of the camera's image whose rays are followed.
        rays: (rows, columns, 2) there.
    """

    def __init__(self, tile: Tile, camera: CameraModel, *, fine: bool) -> None:
        """Follow the rays.

        Args:
            tile: the texture.
            camera: whose image a picture fills.
            fine: a pixel of the picture is one of the camera's, else two along each side. Then
                places are interpolated between some of the pixels, and small texels sampled singly:
                that makes up for the time.
        """
        self._tile, self._fine = tile, fine
        reduced, self._spacing = (1, SPACING) if fine else (2, 1)
        self.shape = (-(-camera.height // reduced), -(-camera.width // reduced))
        rows, columns = self.shape
        self._step = ROWS if fine else math.ceil(rows / BANDS)
        self.x = (_centres(columns, self._spacing) + 0.5) * camera.width / columns - 0.5
        self.y = (_centres(rows, self._spacing) + 0.5) * camera.height / rows - 0.5
        self.rays = rays_at(camera, self.x, self.y)
        half = len(self.x) // 2
        middle = self.rays[len(self.y) // 2, :, 0]
        self._pitch = abs(float(middle[half] - middle[0])) / half / self._spacing

    def draw(self, H: F64, beyond: int, rays: F32 | None = None) -> U8:
        """Return the picture for a `plane_homography` H.

        Rays that do not meet the plane, or only far away, are drawn in the grey `beyond`. In place
        of the camera's own rays through x and y others may be given.
        """
        rays = self.rays if rays is None else rays
        det = float(np.linalg.det(H))
        plane = H[2].astype(np.float32)
        image = np.full(self.shape, beyond, np.uint8)
        for top in range(0, self.shape[0], self._step):
            band = image[top : top + self._step]
            seen = self._rows(rays, top, top + len(band))
            corners = seen[:: seen.shape[0] - 1, :: seen.shape[1] - 1].reshape(-1, 2)
            descents = corners @ plane[:2] + plane[2]
            if descents.max() < LEAST_DESCENT:
                continue
            x, y = seen[seen.shape[0] // 2, seen.shape[1] // 2].tolist()
            centre = H @ np.array([x, y, 1.0])
            descent = max(centre[2], LEAST_DESCENT)
            sampling = self._sampling(footprint(det, descent, self._pitch))
            to_texels = self._tile.to_texels(sampling.level, centre[:2] / descent)
            self._draw_band(band, seen, to_texels @ H, sampling)
            if descents.min() < LEAST_DESCENT:
                every = _spread(seen @ plane[:2] + plane[2], self._spacing, band.shape)
                np.copyto(band, np.uint8(beyond), where=every < LEAST_DESCENT)
        return image

    def _sampling(self, apart_m: float) -> _Sampling:
        """Return how to sample at places so far apart."""
        texel_m = self._tile.texel_m
        if not self._fine:
            level = level_of_detail(apart_m, texel_m, LEVELS)
            return _Sampling(level, cv2.INTER_LINEAR, halved=False)
        # Texels of half a sample to a whole one; the finest may be larger.
        level = level_of_detail(apart_m / math.sqrt(2.0), texel_m, LEVELS)
        if texel_m * 2**level < math.sqrt(2.0) * apart_m:
            return _Sampling(level, cv2.INTER_NEAREST, halved=False)
        return _Sampling(level, cv2.INTER_LINEAR, halved=True)

    def _rows(self, rays: F32, top: int, bottom: int) -> F32:
        """Return the rays that rows of the picture need."""
        s = self._spacing
        # Where places are interpolated, the array of rays begins outside of the picture.
        return rays[top // s : math.ceil(bottom / s) + (2 if s > 1 else 0)]

    def _draw_band(self, band: U8, rays: F32, to_texels: F64, sampling: _Sampling) -> None:
        """Draw some rows; to_texels leads from rays to the texels of their level."""
        target, spacing = band, self._spacing
        if sampling.halved:
            target = np.empty((-(-band.shape[0] // 2), -(-band.shape[1] // 2)), np.uint8)
            spacing //= 2
        cv2.remap(
            self._tile.levels[sampling.level],
            _spread(cv2.perspectiveTransform(rays, to_texels), spacing, target.shape),
            NO_SECOND_MAP,
            sampling.interpolation,
            dst=target,
            borderMode=cv2.BORDER_WRAP,
        )
        if target is not band:
            cv2.resize(target, band.shape[::-1], dst=band, interpolation=cv2.INTER_LINEAR)


def _spread(values: cv2.typing.MatLike, spacing: int, shape: tuple[int, ...]) -> F32:
    """Return what is known at every so many pixels, and at one beyond, for all of a shape."""
    if spacing == 1:
        return cast(F32, values)
    wide = cv2.resize(values, None, fx=spacing, fy=spacing, interpolation=cv2.INTER_LINEAR)
    return cast(F32, wide[spacing : spacing + shape[0], spacing : spacing + shape[1]])


def _centres(pixels: int, spacing: int) -> F64:
    """Middles of groups of so many pixels, with one group more on either side."""
    if spacing == 1:
        return np.arange(float(pixels))
    return (np.arange(-1.0, math.ceil(pixels / spacing) + 1) + 0.5) * spacing - 0.5
