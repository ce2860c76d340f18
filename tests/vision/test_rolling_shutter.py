"""The stated uncertainty covers what a rolling shutter does to a picture."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame, PoseSolution
from landerd.pad import PadLayout, Square
from landerd.vision import Vision
from tests.vision import scenes

CAMERA = scenes.THESIS_CAMERA
READOUT_S, FRAME_S = 0.02, 1 / 30
CHI2_95 = 7.815
PICTURES = 8
TAG = Square(kind="apriltag", dictionary="APRILTAG_36h11", id=0, size_m=0.6)


def sheared(image: scenes.U8, view: scenes.View, skew_px: float) -> scenes.U8:
    """Return a picture whose rows moved to the right by `skew_px` from top to bottom.

    The row of the landing point stays.
    """
    row = float(CAMERA.pixels(np.array([view.position]))[0, 1])
    k = skew_px / CAMERA.height
    M = np.array([[1.0, k, -k * row], [0.0, 1.0, 0.0]])
    moved = cv2.warpAffine(image, M, image.shape[::-1], flags=cv2.INTER_CUBIC)
    return np.asarray(moved, dtype=np.uint8)


def scene(k: int, layout: PadLayout) -> tuple[scenes.U8, scenes.View]:
    rng = np.random.default_rng([5, k])
    view = None
    while view is None:
        tilt = math.radians(rng.uniform(0.0, 45.0))
        distance = (2.0, 4.0, 7.0)[k % 3]
        view = scenes.random_view(rng, CAMERA, distance, tilt, scenes.THESIS_PAD.rings[0])
    optics = replace(scenes.random_optics(rng), noise=1.0)
    return scenes.render(view, CAMERA, optics, rng, layout), view


def chi_square(seen: PoseSolution, view: scenes.View) -> float:
    error = np.array(seen.position) - np.array(view.position)
    return float(error @ np.linalg.solve(np.array(seen.covariance), error))


EXACT = scenes.THESIS_PAD.model_copy(
    update={"print_scale_sigma": 0.0, "placement_sigma_m": 0.0, "flatness_deg": 0.0}
)


@pytest.mark.parametrize(
    "layout",
    [scenes.alone(scenes.THESIS_PAD.rings[0]), scenes.alone(TAG), EXACT],
    ids=["ring", "tag", "both"],
)
def test_sigma_covers_a_shear_of_four_pixels(layout: PadLayout) -> None:
    """Of both markers of a pad, too: it is one motion that bends them."""
    rolling = VisionSection(focal_sigma=0.0, readout_s=READOUT_S)
    whole = VisionSection(focal_sigma=0.0, readout_s=0.0)
    inside = inside_if_global = 0
    for k in range(PICTURES):
        image, view = scene(k, layout)
        frame = Frame(0.0, 0, sheared(image, view, 4.0))
        seen = Vision(layout, CAMERA, rolling).process(frame).pad[0]
        inside += chi_square(seen, view) < CHI2_95
        seen = Vision(layout, CAMERA, whole).process(frame).pad[0]
        inside_if_global += chi_square(seen, view) < CHI2_95
    assert inside >= PICTURES - 1
    assert inside_if_global <= PICTURES // 2


def test_a_pad_that_is_seen_to_stand_still_is_as_exact_as_with_a_global_shutter() -> None:
    layout = scenes.alone(scenes.THESIS_PAD.rings[0])
    image, _ = scene(2, layout)
    sigmas = []
    for readout in (READOUT_S, 0.0):
        vision = Vision(layout, CAMERA, VisionSection(focal_sigma=0.0, readout_s=readout))
        seen = [vision.process(Frame(i * FRAME_S, i, image)).pad[0] for i in range(3)]
        sigmas.append([math.sqrt(float(np.trace(np.array(s.covariance)))) for s in seen])
    rolling, whole = sigmas
    assert rolling[0] > 3.0 * whole[0]
    assert rolling[2] < 1.5 * whole[2]
