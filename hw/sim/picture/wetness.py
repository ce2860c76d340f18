"""Wet spots: darker than the dry surface, with a little of the sky mirrored in them."""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.fractal import FRAYED, blotches

U8 = NDArray[np.uint8]

# A film of water halves the light that a rough, porous surface gives back: Twomey, Bohren and
# Mergenthaler, "Reflectance and albedo differences between wet and dry surfaces" (1986).
DARKENED = 0.5
# Water mirrors 2 to 6 % of the sky (Fresnel, up to 60 degrees), itself about as bright as white.
SHEEN = 8  # grey levels
COVER = 512  # texels of the spots' outlines along a side
SPOTS = (0.0, 0.0, *FRAYED)  # a tile is 8 of them wide


def wet_cover(share: float, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return how wet a texture is (COVER, COVER), 0 to 1; it repeats without a seam."""
    return blotches(rng, COVER, SPOTS, share, 0.3)


def wetted(dry: U8, share: float, rng: np.random.Generator) -> U8:
    """Return a texture that is wet on the given share of it; the same one if that is 0."""
    if share == 0.0:
        return dry
    size = (dry.shape[1], dry.shape[0])
    wet = cv2.resize(wet_cover(share, rng), size, interpolation=cv2.INTER_LINEAR)
    grey = dry * (1.0 - (1.0 - DARKENED) * wet) + SHEEN * wet
    return cast(U8, np.rint(grey).astype(np.uint8))
