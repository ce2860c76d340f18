"""Wet spots on ground and pad: darker than the dry surface, with a little reflected sky."""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.fractal import FRAYED, blotches

U8 = NDArray[np.uint8]

# A film of water halves the reflectance of a rough, porous surface: Twomey, Bohren and
# Mergenthaler, "Reflectance and albedo differences between wet and dry surfaces" (1986).
DARKENED = 0.5
# Grey levels added by reflected sky, which is about as bright as white: water reflects 2 to 6 % of
# it (Fresnel, up to 60 degrees).
SHEEN = 8
COVER = 512  # texels along a side of a cover
SPOTS = (0.0, 0.0, *FRAYED)  # amplitudes of the spots' noise; a tile is 8 spots wide


def wet_cover(share: float, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a cover of wet spots (COVER, COVER), 0 dry to 1 wet, that repeats without a seam."""
    return blotches(rng, COVER, SPOTS, share, 0.3)


def wetted(dry: U8, share: float, rng: np.random.Generator) -> U8:
    """Return a texture of which a share is wet; for a share of 0, the texture itself."""
    if share == 0.0:
        return dry
    size = (dry.shape[1], dry.shape[0])
    wet = cv2.resize(wet_cover(share, rng), size, interpolation=cv2.INTER_LINEAR)
    grey = dry * (1.0 - (1.0 - DARKENED) * wet) + SHEEN * wet
    return cast(U8, np.rint(grey).astype(np.uint8))
