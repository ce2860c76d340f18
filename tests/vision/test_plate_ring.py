"""Rings found by their plate alone, on level ground."""

import math
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.config.models import VisionSection
from landerd.geometry import Vec3
from landerd.messages import PLATE, Frame, PadPrior, Prior, Sightings
from landerd.pad import PadLayout, Plate
from landerd.vision import Vision
from tests.vision.scenes import IDEAL_CAMERA, THESIS_PAD, Optics, View, look, render
from tests.vision.test_plate_check import plate_mask

U8 = NDArray[np.uint8]
RING = THESIS_PAD.rings[0]
_SHADE, _MUD, _LEAF_STROKES, _MUD_STROKES = 0.3, 0.18, 0.22, 0.35


def view(distance: float, heading: float) -> View:
    return look(IDEAL_CAMERA, distance, 0.5, pixel=(340.0, 250.0), heading=heading)


def in_leaf_shade(at: View, seed: int) -> U8:
    """Paint a muddy pad on dark ground, in the shade of leaves finer than its ring's stroke."""
    rng = np.random.default_rng(seed)
    plain = Optics(background="plain", blur_px=1.0)
    is_plate = plate_mask(THESIS_PAD, at)
    image = np.where(is_plate, render(at, IDEAL_CAMERA, plain, rng, THESIS_PAD), 50)
    stroke_px = 0.3 * IDEAL_CAMERA.fx / math.dist(at.position, (0.0, 0.0, 0.0))

    def patches(strokes: float, share: float) -> NDArray[np.bool_]:
        soft = cv2.GaussianBlur(rng.normal(0.0, 1.0, image.shape), (0, 0), strokes * stroke_px)
        return np.asarray(soft > np.quantile(soft, 1.0 - share))

    image = np.where(patches(_MUD_STROKES, _MUD) & is_plate, 60, image)
    light = np.where(patches(_LEAF_STROKES, 0.5), 1.0, _SHADE)
    shaded = cv2.GaussianBlur(0.8 * image * light, (0, 0), 1.2)
    return np.asarray(np.clip(shaded + rng.normal(0.0, 4.0, image.shape), 0, 255), dtype=np.uint8)


def gravity(at: View) -> Vec3:
    x, y, z = at.normal.tolist()
    return x, y, z


def looks(image: U8, prior: Prior) -> Iterator[Sightings]:
    """Look at a picture sixteen times: yield what shows the pad."""
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    for i in range(16):
        seen = vision.process(Frame(i / 30.0, i, image), prior)
        if seen.pad:
            yield seen


def sights(image: U8, prior: Prior) -> list[Sightings]:
    return list(looks(image, prior))


@pytest.mark.parametrize(
    ("distance", "heading", "seed"),
    [(9.0, 0.4, 8), (9.0, 2.0, 8), (12.0, 0.4, 0), (12.0, 2.0, 8)],
)
def test_a_ring_broken_up_by_leaf_shade_is_where_its_plate_is(
    distance: float, heading: float, seed: int
) -> None:
    at = view(distance, heading)
    image = in_leaf_shade(at, seed)
    found = sights(image, Prior(down=gravity(at)))
    assert found
    assert found[0].markers[0].stage == PLATE
    for s in found:
        off = math.dist(s.pad[0].position, at.position)
        assert off < 0.05 * distance
        assert off < 2.0 * math.sqrt(np.trace(np.array(s.pad[0].covariance)))
    assert not sights(image, Prior())  # where no gravity tells how it is foreshortened


def test_a_ring_broken_up_by_leaf_shade_is_tracked_where_it_is_expected() -> None:
    at = view(9.0, 2.0)
    image = in_leaf_shade(at, 8)
    x, y, z = at.position
    pad = PadPrior((x + 0.3, y - 0.2, z + 0.4), 0.3, normal=gravity(at), north=None)
    assert len(sights(image, Prior(pad=pad, down=gravity(at)))) == 16


@pytest.mark.parametrize(("distance", "tilt", "azimuth"), [(5.0, 0.4, 0.0), (8.0, 0.6, 2.36)])
def test_a_clear_ring_of_another_ratio_that_is_tilted_is_not_taken(
    distance: float, tilt: float, azimuth: float
) -> None:
    """On level ground its square plate would be as long as the pad's: a sign on a wall."""
    side = Plate(north_m=0.62, south_m=0.62, east_m=0.62, west_m=0.62)
    other = PadLayout(
        name="other", markers=(RING.model_copy(update={"inner_ratio": 0.3}),), plate=side
    )
    at = look(IDEAL_CAMERA, distance, 0.1, pixel=(200.0, 150.0), heading=0.3)
    plain = Optics(background="plain")
    image = render(at, IDEAL_CAMERA, plain, np.random.default_rng(3), other)
    image = np.where(plate_mask(other, at), image, 60).astype(np.uint8)
    aside = math.sin(tilt) * np.array((math.cos(azimuth), math.sin(azimuth)))
    down = (float(aside[0]), float(aside[1]), math.cos(tilt))
    assert not sights(image, Prior(down=down))
