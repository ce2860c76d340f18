"""The brightness that exposure goes by."""

from dataclasses import replace

import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame, Light
from landerd.vision import Vision
from tests.vision.scenes import IDEAL_CAMERA, THESIS_PAD, Optics, Shadow, look, render

CAMERA = IDEAL_CAMERA


def shown(distance: float, optics: Optics) -> Light:
    view = look(CAMERA, distance, 0.5, pixel=(300.0, 230.0), heading=0.4)
    image = render(view, CAMERA, optics, np.random.default_rng(2), THESIS_PAD)
    vision = Vision(THESIS_PAD, CAMERA, VisionSection(), meters=True)
    light = vision.process(Frame(0.0, 0, image)).light
    assert light is not None
    return light


@pytest.mark.parametrize("distance", [1.0, 3.0, 10.0])
def test_on_the_pad_it_is_the_white_that_counts(distance: float) -> None:
    light = shown(distance, replace(Optics(), white=170.0, black=20.0))
    assert light.on_pad
    assert light.level == pytest.approx(170.0, abs=10.0)


def test_white_in_the_sun_counts_where_a_shadow_covers_a_part_of_the_pad() -> None:
    across = Shadow(factor=0.4, point_px=(300.0, 330.0), normal=(0.0, 1.0))
    light = shown(3.0, replace(Optics(), white=170.0, black=20.0, shadow=across))
    assert light.level == pytest.approx(170.0, abs=10.0)


def test_without_a_pad_it_is_what_most_of_the_picture_shows() -> None:
    image = np.full((480, 640), 90, np.uint8)
    image[:100] = 250  # sky
    vision = Vision(THESIS_PAD, CAMERA, VisionSection(), meters=True)
    assert vision.process(Frame(0.0, 0, image)).light == Light(90.0, on_pad=False)


def test_nobody_is_told_who_does_not_ask() -> None:
    vision = Vision(THESIS_PAD, CAMERA, VisionSection())
    image = np.full((480, 640), 90, np.uint8)
    assert vision.process(Frame(0.0, 0, image)).light is None
