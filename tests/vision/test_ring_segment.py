"""Where a ring could be: ink is even, texture that happens to be round is not."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.vision.ring_segment import (
    STROKE_PX,
    Candidate,
    Look,
    Segmentation,
    dark_between,
    dark_by_mean,
    hole_candidates,
    ring_candidates,
)

DARK = dark_between(STROKE_PX)
RATIO = 0.4
CENTRE, RADIUS_PX = (60, 50), 16
WHITE, BLACK = 200.0, 40.0
BAR_PX = 4  # a leg's shadow across the ring


def picture(stroke: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return a picture (100, 120) of a ring with a stroke of such levels (100, 120)."""
    mask = np.zeros((100, 120), np.uint8)
    cv2.circle(mask, CENTRE, RADIUS_PX, 255, -1, cv2.LINE_AA)
    cv2.circle(mask, CENTRE, round(RATIO * RADIUS_PX), 0, -1, cv2.LINE_AA)
    share = mask / 255.0
    return np.rint(WHITE + share * (stroke - WHITE)).astype(np.uint8)


def looked(image: NDArray[np.uint8], segment: Segmentation) -> Look:
    return Look(image, segment(image))


def candidates(image: NDArray[np.uint8], segment: Segmentation) -> list[Candidate]:
    return ring_candidates([looked(image, segment)], RATIO)[0]


def test_a_ring_of_even_ink_is_proposed_with_its_outline() -> None:
    found = candidates(picture(np.full((100, 120), BLACK)), DARK)
    assert len(found) == 1
    assert np.abs(found[0].outline.centre - CENTRE).max() < 0.5
    assert np.abs(found[0].outline.axes - RADIUS_PX * np.eye(2)).max() < 1.5


@pytest.mark.parametrize(("smallest_px", "proposed"), [(1.8 * RADIUS_PX, 1), (2.2 * RADIUS_PX, 0)])
def test_a_ring_smaller_than_is_wanted_is_not_proposed(smallest_px: float, proposed: int) -> None:
    image = picture(np.full((100, 120), BLACK))
    look = Look(image, DARK(image), smallest_px=smallest_px)
    assert len(ring_candidates([look], RATIO)[0]) == proposed
    assert len(hole_candidates([look], RATIO)[0]) == proposed


def test_a_ring_with_something_across_it_is_proposed() -> None:
    stroke = np.full((100, 120), BLACK)
    stroke[:, CENTRE[0] : CENTRE[0] + BAR_PX] = 80.0
    assert len(candidates(picture(stroke), DARK)) == 1


@pytest.mark.parametrize("shade", [0.2, 0.5])
@pytest.mark.parametrize("column", range(CENTRE[0] - RADIUS_PX, CENTRE[0] + RADIUS_PX + 1, 8))
def test_a_ring_across_which_a_shadows_edge_runs_is_proposed(shade: float, column: int) -> None:
    light = np.where(np.arange(120) < column, 1.0, shade)
    half_shaded = np.rint(picture(np.full((100, 120), BLACK)) * light).astype(np.uint8)
    through_a_lens = np.asarray(cv2.GaussianBlur(half_shaded, (0, 0), 1.0), dtype=np.uint8)
    found = candidates(through_a_lens, DARK)
    assert len(found) == 1
    assert np.abs(found[0].outline.centre - CENTRE).max() < 0.3 * RADIUS_PX


def test_texture_that_happens_to_be_round_is_not_proposed() -> None:
    rng = np.random.default_rng(1)
    patches = rng.uniform(0.0, 150.0, (20, 24))
    stroke = patches.repeat(5, axis=0).repeat(5, axis=1)
    assert candidates(picture(stroke), dark_by_mean(0.86)) == []
    even = np.full_like(stroke, patches.mean())
    assert len(candidates(picture(even), dark_by_mean(0.86))) == 1


def test_candidates_of_an_image_do_not_depend_on_others_segmented_with_it() -> None:
    shown = picture(np.full((100, 120), BLACK))
    looks = [looked(shown[:, :90], DARK), looked(shown[20:], dark_by_mean(0.86))]
    alone = [ring_candidates([look], RATIO)[0] for look in looks]
    together = ring_candidates(looks, RATIO)
    assert [len(some) for some in together] == [1, 1]
    for (one,), (other,) in zip(alone, together, strict=True):
        assert np.abs(one.outline.centre - other.outline.centre).max() < 1e-9
        assert (one.share, one.score) == (other.share, other.score)
