"""Pads whose ring is broken up by shade and dirt, found by the outline of their plate."""

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import PadLayout
from landerd.vision import Vision
from landerd.vision.plate_search import PlateSearch
from landerd.vision.pyramid import levels
from tests.vision.scenes import (
    THESIS_CAMERA,
    THESIS_PAD,
    Optics,
    View,
    look,
    random_view,
    render,
)

U8 = NDArray[np.uint8]
RING = THESIS_PAD.rings[0]


def found(image: U8, layout: PadLayout = THESIS_PAD) -> tuple[float, ...] | None:
    """Return where the plate's outline says that the pad's ring is."""
    coarse = list(levels(image, THESIS_CAMERA, None, None))[:-1]
    pose = PlateSearch(layout, layout.rings[0]).find(image, coarse, THESIS_CAMERA)
    return None if pose is None else tuple(pose[0])


def ring_at(view: View) -> list[float]:
    """Return the centre of the thesis pad's ring, camera frame, m."""
    at = view.R_camera_pad[:, :2] @ np.array(RING.position_m) + view.position
    return [float(x) for x in at]


@pytest.mark.parametrize("heading", [0.1, 1.7, 3.3, 5.0])
@pytest.mark.parametrize("tilt", [0.2, 0.7])
def test_the_outline_of_a_plate_tells_where_its_ring_is(heading: float, tilt: float) -> None:
    for distance in (4.0, 6.0):
        at = look(THESIS_CAMERA, distance, tilt, pixel=(250.0, 260.0), heading=heading)
        rng = np.random.default_rng(1)
        optics = Optics(background="asphalt", black=40.0, blur_px=0.8)
        where = found(render(at, THESIS_CAMERA, optics, rng))
        assert where is not None
        assert math.dist(where, ring_at(at)) < 0.08 * distance


def test_small_blurred_plates_show_the_ring_within_two_percent_of_the_range() -> None:
    near = 0
    for seed in range(20):
        rng = np.random.default_rng([5, seed])
        distance = rng.uniform(12.0, 22.0)
        at = random_view(rng, THESIS_CAMERA, distance, rng.uniform(0.4, 1.0), RING)
        assert at is not None
        image = render(at, THESIS_CAMERA, Optics(background="asphalt", blur_px=1.0), rng)
        pose = PlateSearch(THESIS_PAD, RING).find(
            image, levels(image, THESIS_CAMERA, None, None), THESIS_CAMERA
        )
        near += pose is not None and math.dist(pose[0], ring_at(at)) < 0.02 * distance
    assert near >= 15  # of 20; 6 by the corners of their hulls


def test_a_plate_with_something_else_on_it_is_not_the_pad() -> None:
    at = look(THESIS_CAMERA, 8.0, 0.4, pixel=(250.0, 260.0))
    optics = Optics(background="asphalt", black=40.0, blur_px=0.8)
    tag_alone = THESIS_PAD.model_copy(update={"markers": THESIS_PAD.squares})
    dark_disc = THESIS_PAD.model_copy(
        update={"markers": (RING.model_copy(update={"inner_ratio": 0.15}),)}
    )
    for layout in (tag_alone, dark_disc):
        image = render(at, THESIS_CAMERA, optics, np.random.default_rng(1), layout)
        assert found(image) is None


def shaded_and_dirty(seed: int) -> tuple[View, U8]:
    """Return a view of a pad, 5 to 16 m away, and its picture, in leaf shade, dirt on it."""
    rng = np.random.default_rng([31, seed])
    distance = rng.uniform(5.0, 16.0)
    at = random_view(rng, THESIS_CAMERA, distance, rng.uniform(0.2, 0.95), RING)
    assert at is not None
    image = render(
        at, THESIS_CAMERA, Optics(background="asphalt", black=45.0, blur_px=0.8), rng
    ).astype(np.float64)
    px_per_m = THESIS_CAMERA.fx / at.position[2]

    def spots(size_m: float) -> NDArray[np.float64]:
        noise = cv2.GaussianBlur(rng.normal(size=image.shape), (0, 0), max(0.6, size_m * px_per_m))
        evened: NDArray[np.float64] = noise / noise.std()
        return evened

    shade = cv2.GaussianBlur(np.where(spots(rng.uniform(0.05, 0.12)) > 0, 1.0, 0.45), (0, 0), 0.7)
    image = np.where(spots(0.06) > 1.2, 0.5 * image + 30.0, image)
    return at, np.clip(image * shade, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", [20, 81])
def test_a_pad_is_seen_whose_ring_shade_and_dirt_have_broken_up(seed: int) -> None:
    at, image = shaded_and_dirty(seed)
    vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    # In the second or, in texture, the third: a thorough search takes several pictures.
    looks = (vision.process(Frame(k / 30, k, image)) for k in range(3))
    seen = next(look for look in looks if look.pad)
    error = np.array(seen.pad[0].position) - at.position
    covariance = np.array(seen.pad[0].covariance)
    assert math.sqrt(error @ error) < 0.05 * at.position[2]
    assert float(error @ np.linalg.solve(covariance, error)) < 11.3  # 99 %
