"""Rings that a hard shadow lies across, searched with nothing known beforehand but gravity."""

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.messages import Prior
from tests.vision.scenes import IDEAL_CAMERA, THESIS_PAD, Optics, View, render
from tests.vision.test_plate_check import plate_mask
from tests.vision.test_plate_ring import gravity, looks, view

_SHADE, _GROUND = 0.2, 110


def half_in_shade(at: View, way: float, edge_radii: float) -> NDArray[np.uint8]:
    """Shade what lies beyond a line across the ring, as far off its centre."""
    rng = np.random.default_rng(1)
    plain = Optics(background="plain", blur_px=1.0)
    pad = render(at, IDEAL_CAMERA, plain, rng, THESIS_PAD)
    image = np.where(plate_mask(THESIS_PAD, at), pad, _GROUND)
    centre = IDEAL_CAMERA.pixels(np.array([at.position]))[0]
    radius_px = THESIS_PAD.rings[0].radius_m * IDEAL_CAMERA.fx / float(np.linalg.norm(at.position))
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    aside = (x - centre[0]) * math.cos(way) + (y - centre[1]) * math.sin(way)
    lit = image * np.where(aside > edge_radii * radius_px, 0.9, 0.9 * _SHADE)
    shaded = cv2.GaussianBlur(lit, (0, 0), 1.0) + rng.normal(0.0, 3.0, image.shape)
    return np.asarray(np.clip(shaded, 0, 255), dtype=np.uint8)


@pytest.mark.parametrize("edge_radii", [0.0, 0.4])
@pytest.mark.parametrize("way", [0.3, 1.2, 2.5, 3.6, 4.8, 5.7])
def test_a_hard_shadow_across_a_far_ring_does_not_hide_it(way: float, edge_radii: float) -> None:
    at = view(13.0, 0.4)
    found = next(looks(half_in_shade(at, way, edge_radii), Prior(down=gravity(at))), None)
    assert found is not None
    assert math.dist(found.pad[0].position, at.position) < 0.05 * 13.0


@pytest.mark.parametrize("dirt_way", [0.5, 2.6, 4.7])
@pytest.mark.parametrize("way", [1.2, 2.5, 3.6])
def test_a_hard_shadow_with_dirt_on_the_hole_does_not_hide_a_far_ring(
    way: float, dirt_way: float
) -> None:
    at = view(9.0, 0.4)
    image = half_in_shade(at, way, 0.2)
    ring = THESIS_PAD.rings[0]
    hole_px = (
        ring.inner_ratio * ring.radius_m * IDEAL_CAMERA.fx / float(np.linalg.norm(at.position))
    )
    x, y = IDEAL_CAMERA.pixels(np.array([at.position]))[0]
    middle = x + 0.75 * hole_px * math.cos(dirt_way), y + 0.75 * hole_px * math.sin(dirt_way)
    cv2.circle(image, (round(middle[0]), round(middle[1])), round(0.6 * hole_px), 30, cv2.FILLED)
    found = next(looks(image, Prior(down=gravity(at))), None)
    assert found is not None
    assert math.dist(found.pad[0].position, at.position) < 0.05 * 9.0


@pytest.mark.parametrize(("way", "edge_radii"), [(3.6, 0.0), (4.8, 0.4)])
def test_all_sizes_are_matched_within_a_search(way: float, edge_radii: float) -> None:
    """A pad that is flown past is in sight for one or two searches."""
    at = view(18.1, 0.4)
    found = next(looks(half_in_shade(at, way, edge_radii), Prior(down=gravity(at))), None)
    assert found is not None
    assert found.seq < 5
