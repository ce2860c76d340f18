"""Where a ring could be: ink is even, texture that happens to be round is not."""

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.vision.ring_segment import dark_by_mean, dark_by_range, ring_candidates

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


def test_a_ring_of_even_ink_is_proposed_with_its_outline() -> None:
    found = ring_candidates(picture(np.full((100, 120), BLACK)), RATIO, dark_by_range)
    assert len(found) == 1
    assert np.abs(found[0].outline.centre - CENTRE).max() < 0.5
    assert np.abs(found[0].outline.axes - RADIUS_PX * np.eye(2)).max() < 1.5


def test_a_ring_with_something_across_it_is_proposed() -> None:
    stroke = np.full((100, 120), BLACK)
    stroke[:, CENTRE[0] : CENTRE[0] + BAR_PX] = 80.0
    assert len(ring_candidates(picture(stroke), RATIO, dark_by_range)) == 1


def test_texture_that_happens_to_be_round_is_not_proposed() -> None:
    rng = np.random.default_rng(1)
    patches = rng.uniform(0.0, 130.0, (20, 24))
    stroke = patches.repeat(5, axis=0).repeat(5, axis=1)
    assert ring_candidates(picture(stroke), RATIO, dark_by_mean(0.86)) == []
    even = np.full_like(stroke, patches.mean())
    assert len(ring_candidates(picture(even), RATIO, dark_by_mean(0.86))) == 1
