"""JPEG without the bytes against OpenCV's, which is libjpeg's."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hw.sim.picture.jpeg import Jpeg, quantisation

U8 = np.uint8


def scene(width: int, height: int) -> NDArray[np.uint8]:
    """Edges of all directions, texture, and noise."""
    rng = np.random.default_rng(1)
    rough = np.clip(rng.normal(90.0, 25.0, (height // 4, width // 4)), 0, 255).astype(U8)
    image = cv2.resize(rough, (width, height), interpolation=cv2.INTER_CUBIC)
    cv2.circle(image, (width // 2, height // 2), height // 3, (235.0,), -1, cv2.LINE_AA)
    cv2.circle(image, (width // 2, height // 2), height // 6, (15.0,), -1, cv2.LINE_AA)
    noisy: NDArray[np.uint8] = np.clip(image + rng.normal(0.0, 3.0, image.shape), 0, 255).astype(U8)
    return noisy


@pytest.mark.parametrize("quality", [20, 50, 75, 95])
@pytest.mark.parametrize("size", [(640, 480), (120, 90), (37, 21)])
def test_the_picture_is_libjpegs_to_the_rounding(quality: int, size: tuple[int, int]) -> None:
    image = scene(*size)
    _, packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    unpacked = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
    assert unpacked is not None
    true = unpacked.astype(float)
    seen = image.copy()
    Jpeg(*size, quality).compress(seen)
    # A coefficient half-way between two steps may go the other way, and takes its block along.
    assert (np.abs(seen - true) <= 1).mean() > 0.9
    assert np.abs(seen.astype(float) - image).mean() == pytest.approx(
        np.abs(true - image).mean(), rel=0.05, abs=0.05
    )


def test_steps_are_those_of_the_standard() -> None:
    assert quantisation(50)[0, 0] == 16
    assert quantisation(100).max() == 1
    assert quantisation(25)[7, 7] == 198
