"""The brightness that exposure goes by."""

import math
from dataclasses import replace

import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame, Light, PoseSolution, Prior
from landerd.vision import Vision
from landerd.vision.metering import Meter
from landerd.vision.pose import rotation_from
from tests.vision.scenes import (
    IDEAL_CAMERA,
    THESIS_CAMERA,
    THESIS_PAD,
    Optics,
    Shadow,
    View,
    look,
    render,
)

CAMERA = IDEAL_CAMERA
NORTH = np.array([0.0, -0.85, 0.53])


def shown(distance: float, optics: Optics) -> Light:
    view = look(CAMERA, distance, 0.5, pixel=(300.0, 230.0), heading=0.4)
    image = render(view, CAMERA, optics, np.random.default_rng(2), THESIS_PAD)
    vision = Vision(THESIS_PAD, CAMERA, VisionSection(), meters=True)
    light = vision.process(Frame(0.0, 0, image)).light
    assert light is not None
    return light


@pytest.mark.parametrize("distance", [1.0, 3.0, 10.0])
def test_with_the_pad_in_sight_the_brightness_is_that_of_its_white(distance: float) -> None:
    light = shown(distance, replace(Optics(), white=170.0, black=20.0))
    assert light.on_pad
    assert light.level == pytest.approx(170.0, abs=10.0)


def test_white_in_the_sun_counts_where_a_shadow_covers_a_part_of_the_pad() -> None:
    across = Shadow(factor=0.4, point_px=(300.0, 330.0), normal=(0.0, 1.0))
    light = shown(3.0, replace(Optics(), white=170.0, black=20.0, shadow=across))
    assert light.level == pytest.approx(170.0, abs=10.0)


def test_without_a_pad_the_brightness_is_the_median_of_the_ground() -> None:
    image = np.full((480, 640), 90, np.uint8)
    image[:100] = 250  # sky
    vision = Vision(THESIS_PAD, CAMERA, VisionSection(), meters=True)
    light = vision.process(Frame(0.0, 0, image)).light
    assert light is not None
    assert light.level == 90.0
    assert not light.on_pad


def test_the_sky_is_not_the_ground_where_gravity_is_known() -> None:
    image = np.full((480, 640), 90, np.uint8)
    image[:300] = 255  # most of it
    vision = Vision(THESIS_PAD, CAMERA, VisionSection(), meters=True)
    down = (0.0, math.cos(0.15), math.sin(0.15))  # the horizon at row 140 or so
    leaning = (0.0, math.cos(-0.2), math.sin(-0.2))  # at row 330 or so
    light = vision.process(Frame(0.0, 0, image), Prior(down=leaning)).light
    assert light == Light(90.0, on_pad=False, clipped=0.0)
    light = vision.process(Frame(0.1, 1, image), Prior(down=down)).light
    assert light is not None
    assert light.clipped > 0.3


def test_a_far_overexposed_pad_counts_in_the_clipped_share() -> None:
    image = np.full((480, 640), 60, np.uint8)
    vision = Vision(THESIS_PAD, CAMERA, VisionSection(), meters=True)
    plain = vision.process(Frame(0.0, 0, image)).light
    image[200:216, 300:312] = 255
    glaring = vision.process(Frame(0.1, 1, image)).light
    assert plain is not None
    assert glaring is not None
    assert plain.clipped == 0.0
    assert glaring.clipped == pytest.approx(16 * 12 / image.size, rel=0.1)


def test_the_brightness_is_measured_only_if_asked_for() -> None:
    vision = Vision(THESIS_PAD, CAMERA, VisionSection())
    image = np.full((480, 640), 90, np.uint8)
    assert vision.process(Frame(0.0, 0, image)).light is None


@pytest.mark.parametrize("height", [0.75, 0.65, 0.5])
def test_white_counts_where_corners_of_the_plate_are_far_outside_of_the_picture(
    height: float,
) -> None:
    """Just over the pad, at its tag: the lens's distortion folds far corners into the picture."""
    view = View((0.0, 0.5, height), rotation_from(np.array([0.0, 0.53, 0.85]), NORTH))
    optics = replace(Optics(), white=170.0, black=20.0)
    image = render(view, THESIS_CAMERA, optics, np.random.default_rng(2), THESIS_PAD)
    down = tuple(view.normal.tolist())
    none = ((0.0,) * 3,) * 3
    pad = PoseSolution(view.position, down, tuple(NORTH.tolist()), none, 0.01, 0.01, 1.0)
    light = Meter(THESIS_CAMERA, THESIS_PAD.plate).light(image, pad, None)
    assert light.on_pad
    assert light.level == pytest.approx(170.0, abs=10.0)
