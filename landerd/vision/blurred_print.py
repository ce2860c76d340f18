"""The print of a marker as a blurred image shows it, with its slopes.

The print's own axes: u to its right, v down, in samples.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.vision.arrays import F32

_MAX_BLUR_CHANGE = 0.1  # relative; less than that and the blurred print is kept
_MAX_SAMPLE = 1e5  # where a float32 still holds a hundredth of a sample

# Derivatives of a sampled print, as kernels along u (their transposes: along v).
_SLOPE_U = np.array([[1.0, -8.0, 0.0, 8.0, -1.0]]) / 12.0
_SECOND_U = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 1.0], [0.0, 0.0, 0.0]])
_MIXED = np.array([[1.0, 0.0, -1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 1.0]]) / 2.0  # both, doubled


class BlurredPrint:
    """A print, blurred as asked for.

    Keeps the last result, because the next blur is likely nearly the same: what is returned depends
    on the calls before, by less than a tenth of the blur.
    """

    def __init__(self, fine: NDArray[np.floating], per_m: float) -> None:
        """Take samples (n, n) of the print and of the white round it: 1 white, 0 black, top first.

        Its centre is in the middle; `per_m` samples make a metre.
        """
        n = fine.shape[0]
        self.per_m = per_m
        self._made: tuple[F64, F32] | None = None  # a spread, and the layers blurred by it
        self._centre = 0.5 * n - 0.5
        self._spectrum = np.fft.rfft2(fine)
        self._ku = 2.0 * math.pi * np.fft.rfftfreq(n)[None, :]
        self._kv = 2.0 * math.pi * np.fft.fftfreq(n)[:, None]

    def layers(self, spread: F64, blur: float) -> F32:
        """Return the print (n, n, 4) after about this blur: value, slopes by u, v and the blur.

        Args:
            spread: covariance of the blur on the print (u, v), samples^2, (2, 2).
            blur: its variance in the image; the last slope is by this.
        """
        if self._made is not None:
            made, layers = self._made
            if np.abs(spread - made).max() < _MAX_BLUR_CHANGE * made.max():
                return layers
        self._made = (spread, self._blurred(spread, blur))
        return self._made[1]

    def _blurred(self, spread: F64, blur: float) -> F32:
        square = (
            spread[0, 0] * self._ku**2
            + 2.0 * spread[0, 1] * self._ku * self._kv
            + spread[1, 1] * self._kv**2
        )
        n = self._spectrum.shape[0]
        spectrum = self._spectrum * np.exp(-0.5 * square)
        value = np.fft.irfft2(spectrum, s=(n, n)).astype(np.float32)
        # A Gaussian's variance spreads as heat does: its slope is half the Laplacian.
        heat = spread[0, 0] * _SECOND_U + spread[1, 1] * _SECOND_U.T + spread[0, 1] * _MIXED
        slopes = (_SLOPE_U, _SLOPE_U.T, (0.5 / blur) * heat)
        layers = cv2.merge([value, *(cv2.filter2D(value, -1, kernel) for kernel in slopes)])
        return np.asarray(layers, dtype=np.float32)

    def at(self, layers: F32, north: F64, east: F64) -> tuple[F64, F64, F64, F64]:
        """Return layers at points (n,), m: the value, and slopes by north, east (1/m) and blur."""
        # A pose that a step has thrown far off sees points that no float32 can hold.
        u = np.clip(self._centre + east * self.per_m, -_MAX_SAMPLE, _MAX_SAMPLE).astype(np.float32)
        v = np.clip(self._centre - north * self.per_m, -_MAX_SAMPLE, _MAX_SAMPLE).astype(np.float32)
        at = cv2.remap(layers, u[None, :], v[None, :], cv2.INTER_LINEAR)[0].T.astype(np.float64)
        return at[0], -self.per_m * at[2], self.per_m * at[1], at[3]
