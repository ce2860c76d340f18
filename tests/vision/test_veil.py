"""Pads behind fog and in the dark, and what is done to the levels of such pictures."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import Marker, PadLayout, Ring, Square, WhyCode
from landerd.vision import Vision
from landerd.vision.veil import spread
from tests.vision.scenes import IDEAL_CAMERA, THESIS_PAD, Optics, View, alone, look, render

U8 = NDArray[np.uint8]


def in_fog(at: View, pad: PadLayout, veil: float, noise: float = 1.0) -> U8:
    """Render a pad on grass of which fog leaves a sixteenth of all contrast, 10 grey levels."""
    rng = np.random.default_rng(2)
    clear = render(at, IDEAL_CAMERA, Optics(background="grass", noise=0.0), rng, pad)
    foggy = veil + clear / 16.0 + rng.normal(0.0, noise, clear.shape)
    return np.clip(foggy, 0.0, 255.0).astype(np.uint8)


AT = look(IDEAL_CAMERA, 3.0, 0.3, pixel=(300.0, 230.0), heading=0.3)
MARKERS: list[Marker] = [
    Ring(kind="whycon", outer_diameter_m=1.0),
    WhyCode(kind="whycode", outer_diameter_m=1.0, bits=6, id=5),
    Square(kind="apriltag", dictionary="APRILTAG_36h11", id=3, size_m=0.6),
    Square(kind="aruco", dictionary="4X4_50", id=7, size_m=0.6),
]


def errors_m(pad: PadLayout, image: U8) -> list[float]:
    """Return how far from AT the pad is seen in each of four frames in which it is seen."""
    vision = Vision(pad, IDEAL_CAMERA, VisionSection())
    seen = [s.pad[0] for i in range(4) if (s := vision.process(Frame(i / 30.0, i, image))).pad]
    return [math.dist(pose.position, AT.position) for pose in seen]


@pytest.mark.parametrize("veil", [90.0, 190.0])
@pytest.mark.parametrize("marker", MARKERS)
def test_a_pad_is_seen_in_fog_that_leaves_it_ten_grey_levels(marker: Marker, veil: float) -> None:
    pad = alone(marker)
    errors = errors_m(pad, in_fog(AT, pad, veil))
    assert errors
    assert max(errors) < 0.02


@pytest.mark.parametrize("marker", MARKERS)
def test_a_pad_is_seen_at_a_twentieth_of_full_scale(marker: Marker) -> None:
    pad = alone(marker)
    image = in_fog(AT, pad, 1.0)  # white paper at 13 grey levels, without a veil
    image[::37, ::41] = 255  # hot pixels
    errors = errors_m(pad, image)
    assert errors
    assert max(errors) < 0.02


def test_levels_in_fog_are_spread_about_the_middle_grey() -> None:
    at = look(IDEAL_CAMERA, 3.0, 0.3, pixel=(300.0, 230.0))
    image = in_fog(at, THESIS_PAD, 190.0)
    assert int(np.ptp(spread(image))) == 3 * int(np.ptp(image))


@pytest.mark.parametrize("veil", [25.0, 240.0])
def test_levels_are_left_where_the_picture_has_black_or_is_clipped(veil: float) -> None:
    at = look(IDEAL_CAMERA, 3.0, 0.3, pixel=(300.0, 230.0))
    image = in_fog(at, THESIS_PAD, veil)
    assert spread(image) is image


@pytest.mark.parametrize("level", [10.0, 200.0])
def test_the_noise_of_a_clear_sky_is_not_spread(level: float) -> None:
    rng = np.random.default_rng(2)
    sky = np.clip(rng.normal(level, 1.0, (480, 640)), 0.0, 255.0).astype(np.uint8)
    assert spread(sky) is sky
