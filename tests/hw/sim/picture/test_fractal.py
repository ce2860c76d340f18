"""Random textures: amplitudes, shares, seams, and whose random numbers they are."""

import numpy as np
import pytest

from hw.sim.picture.fractal import FRAYED, blotches, cloud, generator


def test_octaves_of_a_cloud_have_their_amplitudes_and_no_mean() -> None:
    fine = cloud(generator(1, "a"), 256, (3.0,))
    coarse = cloud(generator(1, "b"), 256, (0.0, 0.0, 0.0, 3.0))
    assert fine.std() == pytest.approx(3.0, rel=0.02)
    assert abs(fine.mean()) < 0.05
    # Eight texels have nearly the same value, and interpolation rounds the peaks.
    assert 0.6 * 3.0 < coarse.std() < 3.0
    assert np.abs(np.diff(coarse, axis=0)).mean() < 0.2 * np.abs(np.diff(fine, axis=0)).mean()


def test_a_cloud_repeats_without_a_seam() -> None:
    field = cloud(generator(2, "a"), 256, (0.1, 0.2, 0.5, 1.0, 1.0))
    for axis in (0, 1):
        steps = np.abs(field - np.roll(field, 1, axis=axis)).mean(axis=1 - axis)
        assert steps[0] < 1.5 * steps[1:].mean()


@pytest.mark.parametrize("share", [0.03, 0.12, 0.5, 0.9])
@pytest.mark.parametrize("seed", [1, 2])
def test_blotches_cover_their_share(share: float, seed: int) -> None:
    cover = blotches(generator(seed, "blotches"), 256, (0.0, *FRAYED), share, 0.2)
    assert (cover > 0.5).mean() == pytest.approx(share, abs=0.005)
    assert cover.min() >= 0.0
    assert cover.max() <= 1.0


def test_a_texture_has_random_numbers_of_its_seed_and_name() -> None:
    first = generator(7, "dirt").bytes(16)
    assert generator(7, "dirt").bytes(16) == first
    assert generator(8, "dirt").bytes(16) != first
    assert generator(7, "glare").bytes(16) != first
