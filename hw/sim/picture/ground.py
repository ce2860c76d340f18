"""Textured ground to the horizon, and the sky above it. Background: half resolution will do."""

import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.options import GroundKind
from hw.sim.picture.view import F64, NO_SECOND_MAP, level_of_detail

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

TILE = 1024  # texels; the texture repeats
TEXEL_M = 0.015
LEVELS = 7
BANDS = 5  # rows of the image drawn from one level of detail
SKY = 205
LEAST_DESCENT = 0.02  # of a ray, per unit of depth, that still meets visible ground

# Mean grey, standard deviation, and exponent of the amplitude spectrum 1/f^k.
_LOOK = {"grass": (92.0, 24.0, 0.75), "asphalt": (78.0, 12.0, 0.5), "plain": (90.0, 0.0, 1.0)}


class Ground:
    """Fractal texture on a horizontal plane."""

    def __init__(self, kind: GroundKind, rays: F32, seed: int) -> None:
        """Take rays (rows, columns, 2) of the pixels to be drawn."""
        self._rays = rays
        mean, deviation, exponent = _LOOK[kind]
        rng = np.random.default_rng([seed, 1])
        f = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :]) * TILE
        f[0, 0] = math.inf
        spectrum = np.fft.rfft2(rng.standard_normal((TILE, TILE))) / f**exponent
        field = np.fft.irfft2(spectrum).astype(np.float32)
        field *= np.float32(deviation / field.std())
        field += np.float32(mean)
        tile = np.clip(field, 5, 250).astype(np.uint8)
        self._levels = []
        for level in range(LEVELS):
            # Repeated, because samples beyond the texture's border are slow.
            self._levels.append(np.tile(tile, (2 ** max(level, 1),) * 2))
            size = (tile.shape[0] // 2,) * 2
            tile = cast(U8, cv2.resize(tile, size, interpolation=cv2.INTER_AREA))

    def draw(self, to_ground: F64 | None, rays: F32 | None = None) -> U8:
        """Return the picture (rows, columns) for a ray-to-ground matrix of `plane_homography`.

        None (a camera not above the ground) gives an even mid grey. Of its own rays others may take
        the place.
        """
        all_rays = self._rays if rays is None else rays
        rows, columns = all_rays.shape[:2]
        image = np.full((rows, columns), SKY if to_ground is not None else 90, np.uint8)
        if to_ground is None:
            return image
        pitch = abs(float(all_rays[rows // 2, columns // 2, 0] - all_rays[rows // 2, 0, 0]))
        pitch /= columns // 2
        step = math.ceil(rows / BANDS)
        for top in range(0, rows, step):
            band = slice(top, top + step)
            self._draw_band(image[band], all_rays[band], to_ground, pitch)
        return image

    def _draw_band(self, band: U8, rays: F32, H: F64, pitch: float) -> None:
        """Draw the ground into rows of sky; their rays (rows, columns, 2) are pitch apart."""
        columns = rays.shape[1]
        x, y = rays[rays.shape[0] // 2, columns // 2].tolist()
        centre = H @ np.array([x, y, 1.0])
        corners = rays[:: rays.shape[0] - 1, :: columns - 1].reshape(-1, 2)
        descents = corners @ H[2, :2].astype(np.float32) + np.float32(H[2, 2])
        if descents.max() < LEAST_DESCENT:
            return
        centre[2] = max(centre[2], LEAST_DESCENT)
        level = level_of_detail(H, centre[2], pitch, TEXEL_M, LEVELS)
        where = cv2.perspectiveTransform(rays, self._to_texels(level, centre) @ H)
        cv2.remap(
            self._levels[level],
            where,
            NO_SECOND_MAP,
            cv2.INTER_LINEAR,
            dst=band,
            borderMode=cv2.BORDER_WRAP,
        )
        if descents.min() < LEAST_DESCENT:
            descent = rays @ H[2, :2].astype(np.float32) + np.float32(H[2, 2])
            band[descent < LEAST_DESCENT] = SKY

    def _to_texels(self, level: int, centre: F64) -> F64:
        """Return the matrix (3, 3) from ground (north m, east m, 1) to texels of a level.

        centre (3,): what is to come to lie near the middle of the texture, homogeneous.
        """
        texel = TEXEL_M * 2**level
        tile_m = TILE * TEXEL_M
        # Whole tiles off the coordinates bring them to the middle of the repeated texture.
        middle_m = texel * self._levels[level].shape[0] / 2
        north, east = np.round((centre[:2] / centre[2] - middle_m) / tile_m) * tile_m
        return np.array(
            [
                [0.0, 1 / texel, -east / texel - 0.5],
                [1 / texel, 0.0, -north / texel - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )
