"""Rings as cameras show them that sharpen: with a halo along every edge."""

import math

import cv2
import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.vision import Vision
from tests.vision.scenes import IDEAL_CAMERA, THESIS_PAD, Optics, look, render

RING_PAD = THESIS_PAD.model_copy(update={"markers": THESIS_PAD.rings[:1]})
_BLACK, _WHITE, _GAMMA, _AMOUNT = 60.0, 200.0, 2.2, 2.0


@pytest.mark.parametrize("halo_px", [1.5, 2.0])
@pytest.mark.parametrize("distance", [9.0, 10.0, 11.0])
def test_the_halo_of_a_sharpened_ring_is_not_taken_for_a_second_ring(
    distance: float, halo_px: float
) -> None:
    at = look(IDEAL_CAMERA, distance, 0.3, pixel=(340.0, 250.0), heading=0.4)
    optics = Optics(background="plain", blur_px=0.6)
    light = render(at, IDEAL_CAMERA, optics, np.random.default_rng(1), THESIS_PAD)
    low, high = np.percentile(light, [1.0, 99.5])
    share = np.clip((light.astype(np.float32) - low) / (high - low), 0.0, 1.2)
    grey = _BLACK + (_WHITE - _BLACK) * share ** (1.0 / _GAMMA)
    sharp = grey + _AMOUNT * (grey - cv2.GaussianBlur(grey, (0, 0), halo_px))
    image = np.clip(sharp, 0.0, 255.0).astype(np.uint8)
    vision = Vision(RING_PAD, IDEAL_CAMERA, VisionSection())
    seen = [vision.process(Frame(i / 30.0, i, image)) for i in range(6)]
    found = [s.pad[0].position for s in seen if s.pad]
    assert found
    assert math.dist(found[0], at.position) < 0.01 * distance
