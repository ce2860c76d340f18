"""The loss of JPEG compression, applied to grey pictures without making JPEG files.

JPEG loses information only by quantising the cosine coefficients of blocks of 8x8 pixels (ITU-T
T.81), and only that is done here. The picture is libjpeg's to within the rounding of its
arithmetic, in half the time or less, and in the same time for a noisy picture as for a smooth one.
MJPEG cameras compress luma in this way.
"""

import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

# Number of multiplications in a matrix product up to which OpenBLAS starts no threads.
SMALL_PRODUCT = 2**18
# Quantisation steps for luminance at quality 50: T.81, table K.1.
_STEPS = [
    [16, 11, 10, 16, 24, 40, 51, 61],
    [12, 12, 14, 19, 26, 58, 60, 55],
    [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62],
    [18, 22, 37, 56, 68, 109, 103, 77],
    [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101],
    [72, 92, 95, 98, 112, 100, 103, 99],
]
# Matrix of the discrete cosine transform of 8 samples.
_DCT = np.array(
    [
        [
            math.sqrt((1 if k == 0 else 2) / 8) * math.cos((2 * x + 1) * k * math.pi / 16)
            for x in range(8)
        ]
        for k in range(8)
    ],
    np.float32,
)
_GREY = 8 * 128.0  # offset of the constant coefficient: T.81 codes grey levels less 128


def quantisation(quality: int) -> NDArray[np.int64]:
    """Return libjpeg's quantisation steps (8, 8) for a quality from 1 to 100."""
    percent = 5000 // quality if quality < 50 else 200 - 2 * quality
    steps: NDArray[np.int64] = np.clip((np.array(_STEPS) * percent + 50) // 100, 1, 255)
    return steps


class Jpeg:
    """Compresses and decompresses pictures of one size."""

    def __init__(self, width: int, height: int, quality: int) -> None:
        """Prepare for pictures of a size, px, and a quality from 1 to 100."""
        self._across, self._down = -width % 8, -height % 8
        columns = width + self._across
        blocks = max(SMALL_PRODUCT // (64 * columns), 1)  # rows of blocks in one strip
        self._rows = 8 * min(blocks, (height + self._down) // 8)
        steps = quantisation(quality).astype(np.float32)
        self._steps = np.tile(steps, (self._rows // 8, columns // 8))
        self._inverse = 1.0 / self._steps
        self._a = np.empty_like(self._steps)
        self._b = np.empty_like(self._steps)

    def compress(self, image: U8) -> None:
        """Replace a picture (height, width) by what compression leaves of it."""
        whole = image
        if self._across or self._down:
            border = (0, self._down, 0, self._across)
            whole = cast(U8, cv2.copyMakeBorder(image, *border, cv2.BORDER_REPLICATE))
        for top in range(0, len(whole), self._rows):
            self._strip(whole[top : top + self._rows])
        if whole is not image:
            image[:] = whole[: image.shape[0], : image.shape[1]]

    def _strip(self, image: U8) -> None:
        """Do the same to some rows of blocks."""
        rows, columns = image.shape
        a, b = self._a[:rows], self._b[:rows]
        steps, inverse = self._steps[:rows], self._inverse[:rows]
        a8, b8 = a.reshape(-1, 8), b.reshape(-1, 8)  # eight neighbours of a row
        a_blocks, b_blocks = (m.reshape(-1, 8, columns) for m in (a, b))
        np.copyto(a, image)
        np.dot(a8, _DCT.T, out=b8)
        np.matmul(_DCT, b_blocks, out=a_blocks)
        a[::8, ::8] -= _GREY
        np.multiply(a, inverse, out=a)
        np.rint(a, out=a)
        np.multiply(a, steps, out=a)
        a[::8, ::8] += _GREY
        np.matmul(_DCT.T, a_blocks, out=b_blocks)
        np.dot(b8, _DCT, out=a8)
        np.maximum(a, 0.0, out=a)
        cv2.convertScaleAbs(a, dst=image)
