"""Ground to the horizon, and the sky above it."""

import math
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.options import GroundKind, RenderOptions
from hw.sim.picture import terrain
from hw.sim.picture.fractal import generator
from hw.sim.picture.textured_plane import LEVELS, TexturedPlane
from hw.sim.picture.view import F64
from hw.sim.picture.wetness import wetted
from landerd.camera_model import CameraModel

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

TILE = 1024  # texels of a fractal ground
TEXEL_M = 0.015
SKY = 205
LARGEST_PHOTOGRAPH = 2048  # texels that are kept of its longer side
SPACING = 8  # pixels between those whose place on the ground is computed

# Mean grey, standard deviation, and exponent of the amplitude spectrum 1/f^k.
_LOOK = {"grass": (92.0, 24.0, 0.75), "asphalt": (78.0, 12.0, 0.5), "plain": (90.0, 0.0, 1.0)}


class Ground:
    """A textured horizontal plane: fractal, procedural, or from a photograph."""

    def __init__(
        self,
        options: RenderOptions,
        camera: CameraModel,
        seed: int,
        place_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Make the texture.

        Args:
            options: the kind of ground, or the photograph.
            camera: whose images it fills.
            seed: of the texture.
            place_m: north, east of the middle of a procedural texture or a photograph.

        Raises:
            ValueError: the photograph cannot be read.
        """
        kind = options.ground
        self._size = (camera.width, camera.height)
        if not isinstance(kind, Path) and kind in _LOOK:
            # Nothing in it is as small as a pixel: half resolution will do.
            tile = _fractal(kind, seed)
            tile = wetted(tile, options.wet, generator(seed, "wet ground"))
            self.plane = TexturedPlane(tile, TEXEL_M, camera, reduced=2)
            return
        if isinstance(kind, Path):
            tile, texel_m = photograph(kind, options.ground_m)
        else:
            texel_m = terrain.TEXEL_M
            tile = terrain.TERRAINS[kind](generator(seed, "terrain"))
        tile = wetted(tile, options.wet, generator(seed, "wet ground"))
        rows, columns = tile.shape
        corner_m = (place_m[0] - rows * texel_m / 2, place_m[1] - columns * texel_m / 2)
        self.plane = TexturedPlane(
            tile, texel_m, camera, reduced=1, spacing=SPACING, sharp=True, corner_m=corner_m
        )

    def draw(self, to_ground: F64 | None, rays: F32 | None = None) -> U8:
        """Return the picture (height, width) for a ray-to-ground matrix of `plane_homography`.

        None (a camera not above the ground) gives an even mid grey. In place of the camera's own
        rays others may be given, as to `TexturedPlane.draw`.
        """
        if to_ground is None:
            small = np.full(self.plane.shape, 90, np.uint8)
        else:
            small = self.plane.draw(to_ground, SKY, rays)
        if small.shape == self._size[::-1]:
            return small
        return cast(U8, cv2.resize(small, self._size, interpolation=cv2.INTER_LINEAR))


def photograph(path: Path, side_m: float) -> tuple[U8, float]:
    """Return a texture of a photograph and its mirror images, and the side of a texel in m.

    The photograph's longer side is side_m on the ground, its top lies to the north. Mirrored, it
    repeats without a seam.

    Raises:
        ValueError: it cannot be read.
    """
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ValueError(f"sim.render.ground: {path} cannot be read as a picture (JPEG, PNG, ...)")
    block = 2 ** (LEVELS - 1)
    longest = max(image.shape)
    scale = min(1.0, LARGEST_PHOTOGRAPH / longest)
    size = [max(block, round(scale * n / block) * block) for n in image.shape[::-1]]
    shrinks = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    image = cast(U8, cv2.resize(image, size, interpolation=shrinks))[::-1]
    mirrored = np.hstack([image, image[:, ::-1]])
    return np.vstack([mirrored, mirrored[::-1]]), side_m / max(size)


def _fractal(kind: GroundKind, seed: int) -> U8:
    """Return a texture (TILE, TILE) with a power law's spectrum."""
    mean, deviation, exponent = _LOOK[kind]
    rng = np.random.default_rng([seed, 1])
    f = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :]) * TILE
    f[0, 0] = math.inf
    spectrum = np.fft.rfft2(rng.standard_normal((TILE, TILE))) / f**exponent
    field = np.fft.irfft2(spectrum).astype(np.float32)
    field *= np.float32(deviation / field.std())
    field += np.float32(mean)
    return np.clip(field, 5, 250).astype(np.uint8)
