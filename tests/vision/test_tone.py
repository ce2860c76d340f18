"""Squares and WhyCodes behind a camera's tone curve, and with white blown out."""

import math
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import Marker, Square, WhyCode
from landerd.vision import Vision
from tests.vision import scenes

CHI2_95 = 7.815
PICTURES = 12
CODE = WhyCode(kind="whycode", outer_diameter_m=1.0, bits=6, id=5)
TAG = Square(kind="apriltag", dictionary="APRILTAG_36h11", id=0, size_m=0.6)


def bent(image: scenes.U8, white: float, gamma: float) -> scenes.U8:
    """Return a picture as a camera with this tone curve stores it; white paper 1 is full scale."""
    light = np.clip(np.arange(256) / 220.0 * white, 0.0, 1.0)
    curve = np.rint(255.0 * light ** (1.0 / gamma)).astype(np.uint8)
    return np.asarray(cv2.LUT(image, curve), dtype=np.uint8)


@cache
def picture(marker: Marker, k: int) -> tuple[scenes.U8, scenes.View]:
    """Return a picture of a marker alone on its plate, which each curve bends, and its view."""
    rng = np.random.default_rng([15, k])
    view = None
    while view is None:
        tilt = math.radians(rng.uniform(0.0, 45.0))
        view = scenes.random_view(
            rng, scenes.THESIS_CAMERA, (2.0, 4.0, 6.0)[k % 3], tilt, scenes.THESIS_PAD.rings[0]
        )
    optics = replace(scenes.random_optics(rng), white=220.0, black=30.0, noise=1.5)
    return scenes.render(view, scenes.THESIS_CAMERA, optics, rng, scenes.alone(marker)), view


@cache
def measured(marker: Marker, white: float, gamma: float) -> tuple[float, int]:
    """Return the median error over the range, and in how many pictures it is within the sigma."""
    errors, inside = [], 0
    vision_pad = scenes.alone(marker)
    for k in range(PICTURES):
        image, view = picture(marker, k)
        vision = Vision(vision_pad, scenes.THESIS_CAMERA, VisionSection(focal_sigma=0.0))
        seen = vision.process(Frame(0.0, 0, bent(image, white, gamma))).pad
        assert seen
        error = np.array(seen[0].position) - np.array(view.position)
        errors.append(float(np.linalg.norm(error)) / math.hypot(*view.position))
        inside += float(error @ np.linalg.solve(np.array(seen[0].covariance), error)) < CHI2_95
    return float(np.median(errors)), inside


@pytest.mark.parametrize("marker", [TAG, CODE], ids=["tag", "whycode"])
@pytest.mark.parametrize(
    ("white", "gamma", "limit"),
    [(0.85, 1.0, 0.0006), (0.85, 2.2, 0.0008), (1.6, 1.0, 0.0006), (1.6, 2.2, 0.0006)],
    ids=["linear", "gamma", "clipped", "gamma and clipped"],
)
def test_behind_a_tone_curve_errors_stay_small_and_within_sigma(
    marker: Marker, white: float, gamma: float, limit: float
) -> None:
    error, inside = measured(marker, white, gamma)
    assert error < limit
    assert inside >= PICTURES - 2


@pytest.mark.parametrize("marker", [TAG, CODE], ids=["tag", "whycode"])
@pytest.mark.parametrize("white", [1.6, 2.5])
def test_clipped_white_costs_little_accuracy(marker: Marker, white: float) -> None:
    """How far white is over full scale shows in the dark halves of the edges."""
    plain, _ = measured(marker, 0.85, 1.0)
    clipped, inside = measured(marker, white, 1.0)
    assert clipped < 2.5 * plain
    assert inside >= PICTURES - 2
