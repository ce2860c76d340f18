"""What motion during an exposure does to an edge, against the convolution that it is."""

import math

import cv2
import numpy as np
import pytest

from hw.sim.picture.renderer import drawn_out


@pytest.mark.parametrize(
    ("sigma", "motion"),
    [(0.6, (2.0, 1.0)), (1.5, (1.0, 0.5)), (2.4, (2.0, 1.0)), (2.5, (5.0, 3.0))],
)
def test_a_spot_drawn_out_is_the_convolution(sigma: float, motion: tuple[float, float]) -> None:
    image = np.full((120, 160), 30, np.uint8)
    cv2.circle(image, (75, 60), 35, (250.0,), -1)
    seen = drawn_out(image.copy(), sigma, *motion).astype(float)
    assert np.abs(seen - _convolved(image, sigma, motion)).max() < 6.0


def _convolved(image: np.ndarray, sigma: float, motion: tuple[float, float]) -> np.ndarray:
    """Return the mean of Gaussian blurs of the image moved along the motion, in floats."""
    height, width = image.shape
    x, y = np.fft.fftfreq(width), np.fft.fftfreq(height)[:, None]
    spot = np.exp(-2.0 * (math.pi * sigma) ** 2 * (x * x + y * y))
    path = np.sinc(x * motion[0] + y * motion[1])
    whole: np.ndarray = np.fft.ifft2(np.fft.fft2(image) * spot * path).real
    return whole
