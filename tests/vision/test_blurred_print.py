"""Blurred prints that are used again for the next blur."""

import numpy as np

from landerd.vision.blurred_print import BlurredPrint


def _print() -> BlurredPrint:
    fine = np.ones((64, 64))
    fine[16:48, 16:48] = 0.0
    return BlurredPrint(fine, per_m=32.0)


def test_a_blur_that_is_wider_in_the_image_has_derivatives_of_its_own() -> None:
    """As wide on the print, seen from nearer: a larger step in pixels changes it as much."""
    spread = 4.0 * np.eye(2)
    kept = _print()
    kept.layers(spread, 1.0)
    assert np.allclose(kept.layers(spread, 4.0), _print().layers(spread, 4.0))


def test_nearly_the_same_blur_is_not_computed_again() -> None:
    kept = _print()
    first = kept.layers(4.0 * np.eye(2), 1.0)
    assert kept.layers(4.1 * np.eye(2), 1.05) is first
