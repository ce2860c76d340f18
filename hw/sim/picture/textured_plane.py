"""A texture that repeats on a horizontal plane, as a camera sees it."""

import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.view import F64, NO_SECOND_MAP, footprint, level_of_detail, rays_at
from landerd.camera_model import CameraModel

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

LEVELS = 7  # of detail, each of half the resolution of the one before
BANDS = 5  # rows of the image drawn from one level of detail
LEAST_DESCENT = 0.02  # of a ray, per unit of depth, that still meets what can be seen
LARGEST = 2048  # texels of a tile that is repeated twice at its full resolution


class TexturedPlane:
    """Draws the plane into pictures of one size.

    Attributes:
        shape: rows and columns of the pictures.
        x, y: columns and rows of the camera's image whose rays are followed.
    """

    def __init__(
        self,
        tile: U8,
        texel_m: float,
        camera: CameraModel,
        *,
        reduced: int,
        spacing: int = 1,
        sharp: bool = False,
        corner_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Prepare the levels of detail.

        Args:
            tile: the texture, sides divisible by 2**(LEVELS - 1); its rows go to the north, its
                columns to the east.
            texel_m: side of a texel.
            camera: whose image a picture fills.
            reduced: pixels of the camera along a pixel of the pictures.
            spacing: pixels of a picture between those whose place is computed; between them it is
                interpolated, which is faster and less exact.
            sharp: sample the nearest of small texels, which is faster, in place of four large ones.
            corner_m: north, east of the tile's first texel's outer corner.
        """
        self.shape = (-(-camera.height // reduced), -(-camera.width // reduced))
        self._spacing, self._sharp = spacing, sharp
        self._texel_m = texel_m
        self._tile_m = np.array(tile.shape) * texel_m
        self._corner_m = np.array(corner_m)
        rows, columns = self.shape
        self.x = (_centres(columns, spacing) + 0.5) * camera.width / columns - 0.5
        self.y = (_centres(rows, spacing) + 0.5) * camera.height / rows - 0.5
        self._rays = rays_at(camera, self.x, self.y)
        half = len(self.x) // 2
        middle = self._rays[len(self.y) // 2, :, 0]
        self._pitch = abs(float(middle[half] - middle[0])) / half / spacing
        # Repeated, because samples beyond the texture's border are slow.
        repeats = 2 if max(tile.shape) <= LARGEST else 1
        self._levels: list[U8] = []
        for level in range(LEVELS):
            self._levels.append(np.tile(tile, (repeats * 2 ** max(level - 1, 0),) * 2))
            size = (tile.shape[1] // 2, tile.shape[0] // 2)
            tile = cast(U8, cv2.resize(tile, size, interpolation=cv2.INTER_AREA))

    def draw(self, H: F64, beyond: int, rays: F32 | None = None) -> U8:
        """Return the picture for a `plane_homography` H.

        Rays that do not meet the plane, or only far away, are drawn in the grey `beyond`. In place
        of the camera's own rays through x and y others may be given.
        """
        everything = self._rays if rays is None else rays
        rows, spacing = self.shape[0], self._spacing
        image = np.full(self.shape, beyond, np.uint8)
        step = math.ceil(rows / BANDS / spacing) * spacing
        for top in range(0, rows, step):
            band = image[top : top + step]
            # Where places are interpolated, the array of rays begins outside of the picture.
            last = top // spacing + math.ceil(len(band) / spacing) + (2 if spacing > 1 else 0)
            rays = everything[top // spacing : last]
            x, y = rays[rays.shape[0] // 2, rays.shape[1] // 2].tolist()
            centre = H @ np.array([x, y, 1.0])
            corners = rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1].reshape(-1, 2)
            descents = corners @ H[2, :2].astype(np.float32) + np.float32(H[2, 2])
            if descents.max() < LEAST_DESCENT:
                continue
            centre[2] = max(centre[2], LEAST_DESCENT)
            level, interpolation = self._sampling(footprint(H, centre[2], self._pitch))
            to_texels = self._to_texels(level, centre[:2] / centre[2])
            where = cast(F32, cv2.perspectiveTransform(rays, to_texels @ H))
            cv2.remap(
                self._levels[level],
                self._spread(where, len(band)),
                NO_SECOND_MAP,
                interpolation,
                dst=band,
                borderMode=cv2.BORDER_WRAP,
            )
            if descents.min() < LEAST_DESCENT:
                descent = rays @ H[2, :2].astype(np.float32) + np.float32(H[2, 2])
                band[self._spread(descent, len(band)) < LEAST_DESCENT] = beyond
        return image

    def _sampling(self, apart_m: float) -> tuple[int, int]:
        """Return level of detail and interpolation for samples so far apart."""
        if not self._sharp:
            return level_of_detail(apart_m, self._texel_m, LEVELS), cv2.INTER_LINEAR
        # Texels of half a sample to a whole one.
        level = level_of_detail(apart_m / math.sqrt(2.0), self._texel_m, LEVELS)
        small = self._texel_m * 2**level < 1.01 * apart_m
        return level, cv2.INTER_NEAREST if small else cv2.INTER_LINEAR

    def _to_texels(self, level: int, centre: F64) -> F64:
        """Return the matrix (3, 3) from north, east to a level's texels about centre (2,)."""
        texel = self._texel_m * 2**level
        # Whole tiles off the coordinates bring them to the middle of the repeated texture.
        middle_m = texel * np.array(self._levels[level].shape) / 2
        tiles = np.round((centre - self._corner_m - middle_m) / self._tile_m)
        north, east = self._corner_m + tiles * self._tile_m
        return np.array(
            [
                [0.0, 1 / texel, -east / texel - 0.5],
                [1 / texel, 0.0, -north / texel - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )

    def _spread(self, values: F32, rows: int) -> F32:
        """Return what was computed at every so many pixels for all pixels of some rows."""
        s = self._spacing
        if s == 1:
            return values
        wide = cast(F32, cv2.resize(values, None, fx=s, fy=s, interpolation=cv2.INTER_LINEAR))
        return wide[s : s + rows, s : s + self.shape[1]]


def _centres(pixels: int, spacing: int) -> F64:
    """Middles of groups of so many pixels, with one group more on either side."""
    if spacing == 1:
        return np.arange(float(pixels))
    return (np.arange(-1.0, math.ceil(pixels / spacing) + 1) + 0.5) * spacing - 0.5
