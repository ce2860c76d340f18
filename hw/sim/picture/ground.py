"""Draws the ground to the horizon, with the sky above it, for `renderer`."""

import math
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.options import RenderOptions
from hw.sim.picture import terrain
from hw.sim.picture.fractal import generator
from hw.sim.picture.look_alikes import painted, scattered
from hw.sim.picture.shade import LeafShade
from hw.sim.picture.textured_plane import LEVELS, TexturedPlane, Tile
from hw.sim.picture.view import F64
from hw.sim.picture.wetness import wetted
from landerd.camera_model import CameraModel
from landerd.pad import PadLayout

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

TILE = 1024  # texels along a side of a fractal ground
TEXEL_M = 0.015  # side of a texel of a fractal ground
SKY = 205  # grey level
LARGEST_PHOTOGRAPH = 2048  # largest number of texels along a photograph's longer side

# Mean grey level, standard deviation, and exponent k of the amplitude spectrum 1/f^k.
_LOOK = {"grass": (92.0, 24.0, 0.75), "asphalt": (78.0, 12.0, 0.5), "plain": (90.0, 0.0, 1.0)}


class Ground:
    """A textured horizontal plane: fractal, procedural, or from a photograph.

    Attributes:
        leaves: the leaves that shade it; None: there are none.
    """

    def __init__(
        self,
        options: RenderOptions,
        camera: CameraModel,
        layout: PadLayout,
        seed: int,
        place_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Make the texture.

        Args:
            options: the kind of ground, or its photograph; look-alikes, wetness and shade.
            camera: that sees the ground.
            layout: of the pad, from which all look-alikes differ.
            seed: of the texture.
            place_m: north, east of the pad at the start, local NED, m, where the middle of a
                procedural texture or of a photograph lies.

        Raises:
            ValueError: the photograph cannot be read.
        """
        self._size = (camera.width, camera.height)
        self.leaves: LeafShade | None = None
        if options.ground in _LOOK and not (
            options.look_alikes or options.wet or options.leaf_shade
        ):
            # It shows nothing as small as a pixel, so that half the resolution is enough.
            tile = Tile(_fractal(str(options.ground), seed), TEXEL_M)
            self.plane = TexturedPlane(tile, camera, fine=False)
            return
        texture, texel_m, middle = _texture(options, seed)
        north, east = (p - texel_m * m for p, m in zip(place_m, middle, strict=True))
        if options.look_alikes:
            reach_m = texel_m * min(middle)
            rng = generator(seed, "look-alikes")
            things = scattered(options.look_alikes, layout, place_m, reach_m, rng)
            texture = painted(texture, texel_m, (north, east), things)
        texture = wetted(texture, options.wet, generator(seed, "wet ground"))
        if options.leaf_shade:
            size_m = texel_m * np.array(texture.shape)
            rng = generator(seed, "leaf shade")
            self.leaves = LeafShade(options, size_m, (north, east), rng)
            texture = self.leaves.over(texture)
        tile = Tile(texture, texel_m, (north, east))
        self.plane = TexturedPlane(tile, camera, fine=True)

    def draw(self, to_ground: F64 | None, rays: F32 | None = None) -> U8:
        """Return the picture (height, width) of the ground and the sky.

        Args:
            to_ground: `plane_homography` from rays to the ground; None: the camera is not above
                the ground, and the picture is an even mid grey.
            rays: followed instead of the camera's own, see `TexturedPlane.draw`.
        """
        if to_ground is None:
            small = np.full(self.plane.shape, 90, np.uint8)
        else:
            small = self.plane.draw(to_ground, SKY, rays)
        if small.shape == self._size[::-1]:
            return small
        return cast(U8, cv2.resize(small, self._size, interpolation=cv2.INTER_LINEAR))


def _texture(options: RenderOptions, seed: int) -> tuple[U8, float, tuple[float, float]]:
    """Return a texture, the side of a texel, m, and row and column where the pad starts."""
    kind = options.ground
    if isinstance(kind, Path):
        texture, texel_m = photograph(kind, options.ground_m)
        # The photograph is the first quarter; the rest are its mirror images.
        return texture, texel_m, (texture.shape[0] / 4, texture.shape[1] / 4)
    if kind in _LOOK:
        # A finer texture, so that things and shadows on it have sharp edges.
        texture = _fractal(kind, seed)
        fine = cv2.resize(np.tile(texture, (3, 3)), None, fx=2.0, fy=2.0)
        n = 2 * TILE
        texture, texel_m = cast(U8, fine[n : 2 * n, n : 2 * n]), TEXEL_M / 2
    else:
        texture, texel_m = terrain.TERRAINS[kind](generator(seed, "terrain")), terrain.TEXEL_M
    return texture, texel_m, (texture.shape[0] / 2, texture.shape[1] / 2)


def photograph(path: Path, side_m: float) -> tuple[U8, float]:
    """Return a texture of a photograph, and the side of a texel, m.

    The photograph's top lies to the north. Its mirror images beside it let it repeat without a
    seam.

    Args:
        path: the photograph's file.
        side_m: length of the photograph's longer side on the ground.

    Raises:
        ValueError: the photograph cannot be read.
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


def _fractal(kind: str, seed: int) -> U8:
    """Return the texture (TILE, TILE) of a kind of ground with a power-law spectrum."""
    mean, deviation, exponent = _LOOK[kind]
    rng = np.random.default_rng([seed, 1])
    f = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :]) * TILE
    f[0, 0] = math.inf
    spectrum = np.fft.rfft2(rng.standard_normal((TILE, TILE))) / f**exponent
    field = np.fft.irfft2(spectrum).astype(np.float32)
    field *= np.float32(deviation / field.std())
    field += np.float32(mean)
    return np.clip(field, 5, 250).astype(np.uint8)
