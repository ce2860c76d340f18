"""Draws a horizontal plane with a repeating texture as a camera sees it: the ground."""

import math
from typing import NamedTuple, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.view import F64, NO_SECOND_MAP, footprint, level_of_detail, rays_at
from landerd.camera_model import CameraModel

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

LEVELS = 7  # number of levels of detail, each with half the resolution of the one before
# Least descent of a ray per unit of depth; flatter ones meet the plane too far away to be seen.
LEAST_DESCENT = 0.02
BANDS = 5  # number of bands of a coarse picture, each drawn from one level of detail
ROWS = 80  # rows of a fine picture that are drawn from one level of detail
SPACING = 8  # distance of the rays that are computed for a fine picture, px
LARGEST = 2048  # largest tile, texels, that is repeated twice at its full resolution


class Tile:
    """A repeating texture in decreasing resolution.

    Attributes:
        texel_m: side of a texel of the finest level.
        size_m: north-south and east-west size of the tile, (2,).
        corner_m: north, east of the first texel's outer corner, local NED, (2,).
        levels: the texture of each level of detail; rows count to the north, columns to the east.
            It is repeated in the array so often that samples seldom lie outside, which is slow.
    """

    def __init__(
        self, texture: U8, texel_m: float, corner_m: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Make the levels of detail.

        Args:
            texture: grey levels (rows, columns), both divisible by 2**(LEVELS - 1).
            texel_m: side of a texel.
            corner_m: north, east of the first texel's outer corner, local NED.
        """
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
        """Return the matrix (3, 3) from (north, east, 1), m, to texels (column, row, 1).

        Args:
            level: of detail.
            about: north, east of a place in view, m, (2,): near it texels lie within the array.
        """
        texel = self.texel_m * 2**level
        # Shifted by whole tiles, the place comes to the middle of the repeated texture.
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
    interpolation: int  # OpenCV's constant
    halved: bool  # sampled at every second pixel along each side, and interpolated between


class TexturedPlane:
    """Draws the plane into pictures of one camera.

    Attributes:
        shape: numbers of rows and columns of the pictures.
        x, y: columns and rows of the camera's image at which rays are computed, px.
        rays: those rays, (rows, columns, 2).
    """

    def __init__(self, tile: Tile, camera: CameraModel, *, fine: bool) -> None:
        """Compute the rays.

        Args:
            tile: the texture.
            camera: the true one.
            fine: whether pictures have the camera's resolution, else half of it. To save time, a
                fine picture's places on the plane are interpolated between some pixels, and small
                texels are sampled without interpolation.
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
        """Return a picture of the plane.

        Args:
            H: `plane_homography` to the plane.
            beyond: grey level of rays that do not meet the plane, or only far away.
            rays: used instead of the camera's own at `x` and `y`, (rows, columns, 2).
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
        """Return how to sample places that are this far apart."""
        texel_m = self._tile.texel_m
        if not self._fine:
            level = level_of_detail(apart_m, texel_m, LEVELS)
            return _Sampling(level, cv2.INTER_LINEAR, halved=False)
        # Texels of half to once the distance of samples; those of the finest level may be larger.
        level = level_of_detail(apart_m / math.sqrt(2.0), texel_m, LEVELS)
        if texel_m * 2**level < math.sqrt(2.0) * apart_m:
            return _Sampling(level, cv2.INTER_NEAREST, halved=False)
        return _Sampling(level, cv2.INTER_LINEAR, halved=True)

    def _rows(self, rays: F32, top: int, bottom: int) -> F32:
        """Return the rays that are needed for rows of the picture, from top to below bottom."""
        s = self._spacing
        # If places are interpolated, the array of rays begins outside the picture.
        return rays[top // s : math.ceil(bottom / s) + (2 if s > 1 else 0)]

    def _draw_band(self, band: U8, rays: F32, to_texels: F64, sampling: _Sampling) -> None:
        """Draw some rows.

        Args:
            band: these rows of the picture; changed.
            rays: that they need.
            to_texels: homography (3, 3) from rays to the texels of the level.
            sampling: level and interpolation.
        """
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
    """Return values for all pixels of a shape, interpolated between some of them.

    Args:
        values: at every `spacing`-th pixel, and at one more on each side.
        spacing: px; 1: values are already those of all pixels.
        shape: rows and columns of the result.
    """
    if spacing == 1:
        return cast(F32, values)
    wide = cv2.resize(values, None, fx=spacing, fy=spacing, interpolation=cv2.INTER_LINEAR)
    return cast(F32, wide[spacing : spacing + shape[0], spacing : spacing + shape[1]])


def _centres(pixels: int, spacing: int) -> F64:
    """Return the centres of groups of `spacing` pixels, with one more group at each end.

    A spacing of 1 gives the pixels themselves.
    """
    if spacing == 1:
        return np.arange(float(pixels))
    return (np.arange(-1.0, math.ceil(pixels / spacing) + 1) + 0.5) * spacing - 0.5
