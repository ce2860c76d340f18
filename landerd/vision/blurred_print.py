"""A marker's print, blurred as an image shows it, with the derivatives that `print_fit` needs.

The print is an image of samples with its own axes, in samples: u to its right, v down.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.vision.arrays import F32

# Change of the blur's covariance on the print, over its largest element, and of its variance in the
# image, over itself, below which the last blurred print is used again.
_MAX_BLUR_CHANGE = 0.1
_MAX_SAMPLE = 1e5  # largest coordinate, samples: a float32 still resolves a hundredth there

# Kernels of the derivatives of a sampled print by u; their transposes are those by v.
_SLOPE_U = np.array([[1.0, -8.0, 0.0, 8.0, -1.0]]) / 12.0
_SECOND_U = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 1.0], [0.0, 0.0, 0.0]])
# Twice the mixed derivative by u and v.
_MIXED = np.array([[1.0, 0.0, -1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 1.0]]) / 2.0


class BlurredPrint:
    """A print that can be blurred by any Gaussian.

    Keeps the last result, because the next blur is likely nearly the same. The result therefore
    depends on earlier calls, by less than a tenth of the blur.
    """

    def __init__(self, fine: NDArray[np.floating], per_m: float) -> None:
        """Prepare to blur a print.

        Args:
            fine: samples (n, n) of the print, its centre in the middle, and of the white round it:
                1 white, 0 black, the top row first.
            per_m: samples per metre.
        """
        n = fine.shape[0]
        self.per_m = per_m
        # Covariance and variance of the last blur, and its layers.
        self._made: tuple[F64, float, F32] | None = None
        self._centre = 0.5 * n - 0.5
        self._spectrum = np.fft.rfft2(fine)
        self._ku = 2.0 * math.pi * np.fft.rfftfreq(n)[None, :]
        self._kv = 2.0 * math.pi * np.fft.fftfreq(n)[:, None]
        self._ku_square, self._kv_square = self._ku**2, self._kv**2

    def layers(self, spread: F64, blur: float) -> F32:
        """Return the print with about this blur: its value and three derivatives, (n, n, 4).

        The derivatives are those by u, by v, and by the variance of the blur in the image.

        Args:
            spread: covariance of the blur on the print (u, v), samples^2, (2, 2).
            blur: variance of the same blur in the image, pixels^2.
        """
        if self._made is not None:
            made, made_blur, layers = self._made
            is_near = abs(blur - made_blur) < _MAX_BLUR_CHANGE * made_blur
            if is_near and np.abs(spread - made).max() < _MAX_BLUR_CHANGE * made.max():
                return layers
        layers = self._blurred(spread, blur)
        self._made = (spread, blur, layers)
        return layers

    def _blurred(self, spread: F64, blur: float) -> F32:
        square = (
            spread[0, 0] * self._ku_square
            + 2.0 * spread[0, 1] * self._ku * self._kv
            + spread[1, 1] * self._kv_square
        )
        n = self._spectrum.shape[0]
        spectrum = self._spectrum * np.exp(-0.5 * square)
        value = np.fft.irfft(np.fft.ifft(spectrum, axis=0), n).astype(np.float32)
        # As in the heat equation, the derivative by a Gaussian's variance is half the Laplacian.
        heat = spread[0, 0] * _SECOND_U + spread[1, 1] * _SECOND_U.T + spread[0, 1] * _MIXED
        slopes = (_SLOPE_U, _SLOPE_U.T, (0.5 / blur) * heat)
        layers = cv2.merge([value, *(cv2.filter2D(value, -1, kernel) for kernel in slopes)])
        return np.asarray(layers, dtype=np.float32)

    def at(self, layers: F32, north: F64, east: F64) -> tuple[F64, F64, F64, F64]:
        """Return value and derivatives of the blurred print at points of the marker's plane.

        Args:
            layers: as `layers` returns them.
            north: of the points, from the print's centre, m, (n,).
            east: of the points, likewise.

        Returns:
            value, and its derivatives by north and east, 1/m, and by the blur, each (n,).
        """
        # Under a pose that a step has put far off, coordinates may be too large for a float32.
        u = _bounded(self._centre + east * self.per_m)
        v = _bounded(self._centre - north * self.per_m)
        at = cv2.remap(layers, u[None, :], v[None, :], cv2.INTER_LINEAR)[0].T.astype(np.float64)
        return at[0], -self.per_m * at[2], self.per_m * at[1], at[3]


def _bounded(sample: F64) -> F32:
    """Return coordinates (n,), samples, bounded to `_MAX_SAMPLE`; numpy's `clip` takes longer."""
    return np.minimum(np.maximum(sample, -_MAX_SAMPLE), _MAX_SAMPLE).astype(np.float32)
