"""Dappled shade: flecks of sun between shadows of leaves, which lie still on the ground."""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.options import RenderOptions
from hw.sim.picture.fractal import blotches, generator
from hw.sim.picture.textured_plane import TexturedPlane
from hw.sim.picture.view import F64
from hw.sim.snapshot import PadPose
from landerd.camera_model import CameraModel
from landerd.geometry import IDENTITY

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

SIZE = 512  # texels along a side
OCTAVES = 4  # a fleck is 2**(OCTAVES - 1) texels wide
SHADED = 0.5  # share of the ground
REDUCED = 2  # pixels of the image to one of the shade's: its edges are soft
SPACING = 4  # of those, between rays that are followed


class LeafShade:
    """Takes the share `leaf_shade` of the light away under leaves."""

    def __init__(
        self, options: RenderOptions, camera: CameraModel, sunlight: F64, seed: int
    ) -> None:
        """Make the pattern.

        Args:
            options: share of the light, size of the flecks.
            camera: whose images are shaded.
            sunlight: direction it travels, local NED (3,).
            seed: of the pattern.
        """
        # Through a gap the sun draws its own round image, so edges are as soft as flecks are small.
        leaves = blotches(generator(seed, "leaf shade"), SIZE, OCTAVES, SHADED, 0.8)
        light = np.rint(255.0 * (1.0 - options.leaf_shade * leaves)).astype(np.uint8)
        texel_m = options.leaf_m / 2 ** (OCTAVES - 1)
        self.plane = TexturedPlane(light, texel_m, camera, reduced=REDUCED, spacing=SPACING)
        self._sunlight = sunlight
        self._ground_down = options.ground_down_m

    def falls_on(self, pad: PadPose) -> PadPose:
        """Return the level plane through the pad, its origin under the light of the ground's.

        What is drawn beside the pad is shaded as if it lay as high: a little aside of the truth.
        """
        down = pad.position[2]
        way = (down - self._ground_down) / self._sunlight[2]
        north, east = (way * self._sunlight[:2]).tolist()
        return PadPose((north, east, down), IDENTITY)

    def darken(self, image: U8, to_plane: F64, rays: F32 | None = None) -> None:
        """Darken an image (height, width) in place, seen by a `plane_homography` to the plane.

        Rays: as for `TexturedPlane.draw`.
        """
        light = self.plane.draw(to_plane, 255, rays)
        light = cast(U8, cv2.resize(light, image.shape[::-1], interpolation=cv2.INTER_LINEAR))
        cv2.multiply(image, light, dst=image, scale=1 / 255)
