"""Which of the found markers belong to one pad."""

import math

import cv2
import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame, MarkerSighting, PoseSolution, Prior
from landerd.pad import PadLayout, Plate, Ring
from landerd.vision import Vision
from landerd.vision.choice import Candidate, choose
from landerd.vision.marker_errors import MarkerErrors
from landerd.vision.pad_pose import ring_measurement
from tests.vision.scenes import (
    IDEAL_CAMERA,
    THESIS_CAMERA,
    THESIS_PAD,
    U8,
    Bar,
    Optics,
    look,
    render,
)

LARGE = Ring(kind="whycon", outer_diameter_m=1.0)
SMALL = Ring(kind="whycon", outer_diameter_m=0.2, inner_ratio=0.5)
PLATE = Plate(north_m=0.62, south_m=0.62, east_m=0.62, west_m=0.62)
NESTED = PadLayout(name="nested", markers=(LARGE, SMALL), plate=PLATE)
N = 1.0 / math.sqrt(3.0)


def candidate(ring: Ring, distance: float) -> Candidate:
    """Return an outline 60 px wide read as one of the rings, seen along (1, 1, 1)."""
    variance = 1e-4
    seen = PoseSolution(
        position=(0.0, 0.0, distance),
        normal=(N, N, N),
        north=None,
        covariance=((variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, variance)),
        sigma_yaw=None,
        sigma_tilt=0.01,
        cost=0.0,
    )
    outline = ((290.0, 220.0), (350.0, 220.0), (350.0, 260.0), (290.0, 260.0))
    sighting = MarkerSighting("whycon", None, (seen,), outline)
    return Candidate(
        ring, sighting, ring_measurement(0 if ring == LARGE else 1, ring.position_m, (seen,))
    )


def test_a_ring_is_not_taken_for_the_one_of_two_whose_neighbour_would_be_in_view() -> None:
    # Far off and the large one, or near and the small one? Far off both would be wholly in the
    # image, near the large one is not.
    far, near = candidate(LARGE, 3.0), candidate(SMALL, 0.6)
    chosen, poses = choose(
        [far, near], NESTED, IDEAL_CAMERA, MarkerErrors(NESTED, 0.0), Prior(), None
    )
    assert chosen == [near]
    assert np.allclose(poses[0].position, (0.0, 0.0, 0.6))


def of_two_rings(large_north_m: float, small_north_m: float) -> PadLayout:
    """Return a pad of two rings that differ only in size, one of them at the landing point."""
    large = Ring(kind="whycon", outer_diameter_m=0.6, position_m=(large_north_m, 0.0))
    small = Ring(kind="whycon", outer_diameter_m=0.15, position_m=(small_north_m, 0.0))
    plate = Plate(north_m=0.9, south_m=0.4, east_m=0.4, west_m=0.4)
    return PadLayout(name="two", markers=(large, small), plate=plate)


def seen_of(layout: PadLayout, distance: float, seed: int, shown: PadLayout) -> tuple[bool, float]:
    """Return whether a still of what is shown shows the layout's pad, and the error, m."""
    rng = np.random.default_rng(seed)
    view = look(
        THESIS_CAMERA,
        distance,
        rng.uniform(0.0, 0.6),
        pixel=(THESIS_CAMERA.cx + rng.uniform(-60, 60), THESIS_CAMERA.cy + rng.uniform(-40, 40)),
        heading=rng.uniform(0.0, 6.0),
    )
    image = render(view, THESIS_CAMERA, Optics(background="grass"), rng, shown)
    pad = Vision(layout, THESIS_CAMERA, VisionSection()).search_still(Frame(0.0, 0, image)).pad
    return bool(pad), math.dist(pad[0].position, view.position) if pad else 0.0


@pytest.mark.parametrize("distance", [1.25, 1.75])
@pytest.mark.parametrize(("large_north_m", "small_north_m"), [(0.0, 0.5), (0.5, 0.0)])
def test_a_large_ring_is_not_taken_for_the_small_one_beside_it(
    distance: float, large_north_m: float, small_north_m: float
) -> None:
    """A pad 1.5 m away was seen at 0.4 m: the search ended with the large ring, for either."""
    layout = of_two_rings(large_north_m, small_north_m)
    for seed in range(4):
        is_seen, error_m = seen_of(layout, distance, seed, layout)
        assert is_seen
        assert error_m < 0.03


def test_a_large_ring_alone_is_not_taken_for_the_small_one_that_is_covered() -> None:
    layout = of_two_rings(0.5, 0.0)
    shown = layout.model_copy(update={"markers": layout.markers[:1]})
    for seed in range(1, 6):
        _, error_m = seen_of(layout, 1.5, seed, shown)
        assert error_m < 0.15


def wobbling(image: U8, period: float, phase: float) -> U8:
    """Return a picture whose rows a vibration has moved by 2 px; a period in rows, a phase, rad."""
    y, x = np.indices(image.shape, dtype=np.float32)
    wave = 2.0 * math.pi * y / period + phase
    at = (x + 2.0 * np.sin(wave)).astype(np.float32), (y + 0.7 * np.cos(wave)).astype(np.float32)
    bent = cv2.remap(image, *at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(bent, dtype=np.uint8)


@pytest.mark.parametrize(
    ("seed", "most_m"), [(4, 0.15), (7, 0.15), (12, 0.15), (14, 0.15), (16, 0.2), (20, 0.15)]
)
def test_a_ring_is_not_given_up_for_a_tag_bent_by_a_wobbling_rolling_shutter(
    seed: int, most_m: float
) -> None:
    """By the tag alone the pad was 0.2 to 0.5 m off, with a sigma of 5 cm."""
    rng = np.random.default_rng([3, seed])
    towards, heading = rng.uniform(0.0, 2.0 * math.pi, 2)
    view = look(
        THESIS_CAMERA, 4.5, 0.4, pixel=(300.0, 230.0), tilt_towards=towards, heading=heading
    )
    image = render(view, THESIS_CAMERA, Optics(), np.random.default_rng(seed))
    bent = wobbling(image, rng.uniform(40.0, 90.0), rng.uniform(0.0, 6.28))
    x, y, z = view.normal.tolist()
    seen = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection()).process(
        Frame(0.0, 0, bent), Prior(down=(x, y, z))
    )
    assert {m.kind for m in seen.markers} == {"whycon", "apriltag"}
    pad = seen.pad[0]
    error = np.array(pad.position) - np.array(view.position)
    assert np.linalg.norm(error) < most_m
    assert error @ np.linalg.solve(np.array(pad.covariance), error) < 16.3  # 99.9 %
    assert pad.north is not None
    assert np.dot(pad.north, view.R_camera_pad[:, 0]) > math.cos(math.radians(8.0))


def test_a_leg_across_the_tag_does_not_turn_the_pad_over_beside_a_clear_ring() -> None:
    """The tag alone told its mirrored pose, surely: the pad was 0.65 m off, the ring left out."""
    view = look(THESIS_CAMERA, 5.63, 0.637, pixel=(300.0, 230.0), tilt_towards=0.89, heading=0.234)
    tag = np.array(view.position) + 0.75 * view.R_camera_pad[:, 0]
    x, y = THESIS_CAMERA.pixels(tag[None])[0]
    leg = Bar((x + 8.1, y + 10.1), (math.cos(2.46), math.sin(2.46)), 5.86, 57.9)
    optics = Optics(white=170.0, black=71.9, noise=1.69, blur_px=0.854, bar=leg)
    image = render(view, THESIS_CAMERA, optics, np.random.default_rng(125))
    seen = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection()).process(Frame(0.0, 0, image))
    assert {m.kind for m in seen.markers} == {"whycon", "apriltag"}
    assert math.dist(seen.pad[0].position, view.position) < 0.05
