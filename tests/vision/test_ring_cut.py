"""Rings that the image's edge cuts, where nothing is known of the pad."""

import math

import cv2
import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.vision import Vision
from landerd.vision.whycon import find_rings
from tests.vision import scenes

CAMERA = scenes.THESIS_CAMERA
RING = scenes.THESIS_PAD.rings[0]
CHI2_99 = 11.345  # three degrees of freedom


@pytest.mark.parametrize("pixel", [(40.0, 80.0), (560.0, 150.0), (300.0, 440.0)])
@pytest.mark.parametrize("distance", [0.8, 1.1])
def test_a_ring_just_under_the_camera_is_found_by_the_arcs_that_are_in_the_image(
    pixel: tuple[float, float], distance: float
) -> None:
    """Of its outline 35 to 60 % are in the image, and its hole is cut, too."""
    view = scenes.look(CAMERA, distance, math.radians(20.0), pixel=pixel, tilt_towards=1.0)
    optics = scenes.Optics(background="grass", blur_px=1.0)
    image = scenes.render(view, CAMERA, optics, np.random.default_rng(2), scenes.THESIS_PAD)
    found = find_rings(image, RING, CAMERA)
    assert len(found) == 1
    pose = found[0].solutions[0]
    error = np.array(pose.position) - view.position
    assert float(np.linalg.norm(error)) < 0.01 * distance
    assert float(error @ np.linalg.solve(np.array(pose.covariance), error)) < CHI2_99


@pytest.mark.parametrize(("pixel", "distance"), [((300.0, 8.0), 3.0), ((620.0, 300.0), 8.0)])
def test_a_ring_that_is_cut_a_little_is_as_exact_as_a_whole_one(
    pixel: tuple[float, float], distance: float
) -> None:
    """The outline of what is left of it is none of a circle, and the first fit begins beside it."""
    camera = scenes.IDEAL_CAMERA
    at = scenes.look(camera, distance, 0.0, pixel=pixel, heading=0.4)
    optics = scenes.Optics(background="plain", blur_px=0.8)
    image = scenes.render(at, camera, optics, np.random.default_rng(1), scenes.THESIS_PAD)
    (found, *_) = find_rings(image, RING, camera, thorough=True)
    assert math.dist(found.solutions[0].position, at.position) < 7e-4 * distance


@pytest.mark.parametrize("pixel", [(4.0, 100.0), (560.0, 478.0), (636.0, 300.0)])
@pytest.mark.parametrize("distance", [2.5, 4.0, 7.0])
def test_a_ring_that_the_edge_cuts_in_two_is_found_in_a_search_from_metres_off(
    pixel: tuple[float, float], distance: float
) -> None:
    camera = scenes.IDEAL_CAMERA
    at = scenes.look(camera, distance, 0.3, pixel=pixel, tilt_towards=1.0, heading=0.4)
    optics = scenes.Optics(background="grass", blur_px=1.0)
    image = scenes.render(at, camera, optics, np.random.default_rng(1), scenes.THESIS_PAD)
    vision = Vision(scenes.THESIS_PAD, camera, VisionSection())
    found = [s.pad[0] for i in range(5) if (s := vision.process(Frame(i / 30.0, i, image))).pad]
    assert found
    assert math.dist(found[0].position, at.position) < 0.01 * distance


@pytest.mark.parametrize("ratio", [0.0, 0.6])
@pytest.mark.parametrize(("middle", "radius"), [((80, 120), 220), ((8, 120), 60)])
def test_discs_and_rings_of_another_ratio_that_are_cut_are_not_taken(
    middle: tuple[int, int], radius: int, ratio: float
) -> None:
    image = np.full((480, 640), 190, np.uint8)
    cv2.circle(image, middle, radius, 40, -1, cv2.LINE_AA)
    cv2.circle(image, middle, round(radius * ratio), 190, -1 if ratio else 1, cv2.LINE_AA)
    assert not find_rings(cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.uint8), RING, CAMERA)
