import math

import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.vision import Vision
from landerd.vision.whycon import find_rings
from tests.vision import scenes

CAMERA = scenes.THESIS_CAMERA
RING = scenes.THESIS_PAD.rings[0]
CHI2_95 = 7.815  # three degrees of freedom


def test_a_range_that_a_mild_tone_curve_has_moved_is_stated_to_be_as_wrong() -> None:
    inside = 0
    for k in range(20):
        rng = np.random.default_rng([5, k])
        tilt = math.radians(rng.uniform(10.0, 40.0))
        view = scenes.look(CAMERA, (3.0, 6.0, 10.0)[k % 3], tilt, pixel=(330.0, 250.0))
        optics = scenes.Optics(white=170.0, black=80.0, noise=0.0)
        light = scenes.render(view, CAMERA, optics, rng) / 255.0
        level = 255.0 * light ** (1.0 / 1.6) + rng.normal(0.0, 2.0, light.shape)
        image = np.clip(np.rint(level), 0, 255).astype(np.uint8)
        best = find_rings(image, RING, CAMERA)[0].solutions[0]
        error = np.array(best.position) - view.position
        inside += bool(error @ np.linalg.solve(np.array(best.covariance), error) < CHI2_95)
    assert inside >= 17


def test_sigma_covers_the_error_of_strong_motion_blur() -> None:
    pad = scenes.alone(RING)
    found = inside = 0
    for k in range(6):
        rng = np.random.default_rng([0, k])
        distance = (7.0, 15.0)[k % 2]
        view = None
        while view is None:
            view = scenes.random_view(rng, CAMERA, distance, rng.uniform(0.0, 0.7), RING)
        way, path = rng.uniform(0.0, 2.0 * math.pi), min(15.0, 0.4 * CAMERA.fx / distance)
        optics = scenes.Optics(motion_px=(path * math.cos(way), path * math.sin(way)))
        image = scenes.render(view, CAMERA, optics, rng, pad)
        seen = Vision(pad, CAMERA, VisionSection(focal_sigma=0.0)).process(Frame(0.0, 0, image)).pad
        if seen:
            error = np.array(seen[0].position) - view.position
            found += 1
            inside += bool(error @ np.linalg.solve(np.array(seen[0].covariance), error) < CHI2_95)
    assert found >= 5
    assert inside == found


def glaring(image: scenes.U8, view: scenes.View, rng: np.random.Generator) -> scenes.U8:
    """Return a picture with a wide, weak spot of glare on the ring."""
    (middle,) = CAMERA.pixels(np.array([view.position]))
    radius = CAMERA.focal * RING.radius_m / view.position[2]
    way, off = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.3, 1.0) * radius
    x, y = middle + off * np.array([math.cos(way), math.sin(way)])
    v, u = np.indices(image.shape)
    wide = rng.uniform(0.3, 0.8) * radius
    spot = np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2.0 * wide**2))
    light = image + rng.uniform(15.0, 50.0) * spot
    return np.asarray(np.clip(light, 0.0, 255.0), dtype=np.uint8)


@pytest.mark.parametrize(("share", "least"), [(0.0, 37), (0.12, 34)])
def test_a_weak_spot_of_glare_moves_no_ring_further_than_stated(share: float, least: int) -> None:
    """With the camera still, or while the picture moves by a share of the ring's diameter."""
    inside = 0
    for k in range(40):
        rng = np.random.default_rng(k)
        distance, tilt = rng.uniform((3.0, 0.1), (6.0, 0.7))
        towards, way = rng.uniform(0.0, 2.0 * math.pi, 2)
        view = scenes.look(CAMERA, distance, tilt, pixel=(300.0, 230.0), tilt_towards=towards)
        path = share * CAMERA.focal * RING.outer_diameter_m / distance
        motion = (path * math.cos(way), path * math.sin(way))
        image = scenes.render(view, CAMERA, scenes.Optics(white=190.0, motion_px=motion), rng)
        best = find_rings(glaring(image, view, rng), RING, CAMERA)[0].solutions[0]
        error = np.array(best.position) - view.position
        inside += bool(error @ np.linalg.solve(np.array(best.covariance), error) < CHI2_95)
    assert inside >= least
