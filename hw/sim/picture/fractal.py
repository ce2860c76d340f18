"""Random textures that repeat without a seam: clouds of noise, and blotches of a given share.

The grounds, leaves, dirt and wet spots of simulated pictures are made of them.
"""

from collections.abc import Sequence
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]

_UNIFORM_SD = 256 / 12**0.5  # standard deviation of a random byte


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the random generator of one texture, which no other texture shares.

    Args:
        seed: of the simulated world.
        name: of the texture.
    """
    return np.random.default_rng(list(f"{seed}:{name}".encode()))


def cloud(rng: np.random.Generator, size: int, amplitudes: Sequence[float]) -> F32:
    """Return value noise (size, size) that repeats in both directions.

    Args:
        rng: source of the noise.
        size: number of texels along a side, divisible by 2 to the number of octaves less one.
        amplitudes: standard deviation of each octave, the finest (single texels) first. Equal ones
            give the amplitude spectrum 1/f of natural scenes (Field, "Relations between the
            statistics of natural images and the response properties of cortical cells", 1987).
    """
    coarsest = len(amplitudes) - 1
    field = np.zeros((size >> coarsest, size >> coarsest), np.float32)
    for octave in range(coarsest, -1, -1):
        if octave < coarsest:
            field = enlarged(field)
        if amplitudes[octave] == 0.0:
            continue
        n = size >> octave
        noise = np.frombuffer(rng.bytes(n * n), np.uint8).reshape(n, n)
        scale = amplitudes[octave] / _UNIFORM_SD
        cv2.addWeighted(noise, scale, field, 1.0, -127.5 * scale, dst=field, dtype=cv2.CV_32F)
    return field


FRAYED = (0.0625, 0.125, 0.25, 0.5, 1.0)  # amplitudes of blotches with ragged outlines


def blotches(
    rng: np.random.Generator, size: int, amplitudes: Sequence[float], share: float, edge: float
) -> F32:
    """Return random blotches that repeat in both directions (size, size): 0 bare, 1 covered.

    Args:
        rng: source of the noise.
        size: number of texels along a side, as for `cloud`.
        amplitudes: of the noise's octaves, the finest first; the strongest gives the blotches'
            size.
        share: of the texels that are at least half covered, 0 to 1.
        edge: width of the transition from 0 to 1, in standard deviations of the noise.
    """
    field = cloud(rng, size, amplitudes)
    covered = np.quantile(field[::3, ::3], 1.0 - share)
    slope = 1.0 / (edge * float(field.std()))
    cover = np.clip(0.5 + (field - np.float32(covered)) * np.float32(slope), 0.0, 1.0)
    return cast(F32, cover)


def enlarged(field: F32) -> F32:
    """Return a field (n, n) that repeats at twice the resolution, (2 n, 2 n)."""
    n = field.shape[0]
    border = 4
    wide = cv2.copyMakeBorder(field, border, border, border, border, cv2.BORDER_WRAP)
    wide = cv2.resize(wide, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(wide[2 * border : 2 * (border + n), 2 * border : 2 * (border + n)])
