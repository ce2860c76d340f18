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
from landerd.vision.pose import Pose, circle
from landerd.vision.rolling_shutter import RollingShutter
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


def test_a_landing_point_abreast_of_the_lens_does_not_blind_it_to_the_markers() -> None:
    """As it passes the lens on touch-down, how fast it moves in the image says nothing."""
    ring = scenes.THESIS_PAD.rings[0]
    pose = Pose(np.diag([1.0, -1.0, 1.0]), np.array([0.1, 0.0, 0.3]), 1e4 * np.eye(6), 0.0)
    abreast = [np.array([0.1, 0.0, z]) for z in (-0.01, 0.01)]
    fresh, passed = RollingShutter(CAMERA, READOUT_S), RollingShutter(CAMERA, READOUT_S)
    for i, at in enumerate(abreast):
        passed.saw(i * FRAME_S, at)
    outline = circle(ring.radius_m)
    unknown = fresh.of_pose(2 * FRAME_S, pose, outline, pose.t)
    for at in (*abreast, pose.t):
        seen = passed.of_pose(2 * FRAME_S, pose, outline, at)
        assert np.linalg.norm(seen.shared) < 2.0 * np.linalg.norm(unknown.shared)


def grown(image: scenes.U8, view: scenes.View, share: float) -> scenes.U8:
    """Return a picture that grew about the landing point by a share from top to bottom."""
    x, y = CAMERA.pixels(np.array([view.position]))[0]
    v, u = np.indices(image.shape)
    size = 1.0 + share * (v - y) / CAMERA.height
    at = (x + (u - x) / size).astype(np.float32), (y + (v - y) / size).astype(np.float32)
    return np.asarray(cv2.remap(image, *at, cv2.INTER_CUBIC), dtype=np.uint8)


@pytest.mark.parametrize("heading", [0.4, 0.8, 1.2])
def test_a_fast_descent_tilts_no_pad_further_than_stated(heading: float) -> None:
    """The lower rows see it from nearer, as if it leaned by 1.4 degrees."""
    vision = Vision(scenes.alone(TAG), CAMERA, VisionSection(focal_sigma=0.0, readout_s=READOUT_S))
    rng, growth = np.random.default_rng(6), 1.5
    for i in range(4):
        distance = 1.3 * math.exp(-growth * i * FRAME_S)
        view = scenes.look(CAMERA, distance, 0.05, pixel=(310.0, 235.0), heading=heading)
        image = scenes.render(view, CAMERA, scenes.Optics(), rng, scenes.alone(TAG))
        frame = Frame(i * FRAME_S, i, grown(image, view, growth * READOUT_S))
        seen = vision.process(frame).pad[0]
    lean = math.acos(min(1.0, float(np.dot(seen.normal, view.normal))))
    assert math.radians(0.8) < lean < 2.5 * seen.sigma_tilt
    assert seen.sigma_tilt < math.radians(2.5)
    assert chi_square(seen, view) < CHI2_95
