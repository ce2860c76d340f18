"""Wet spots: how much is wet, and how dark it is."""

import numpy as np
import pytest

from hw.sim.picture.fractal import generator
from hw.sim.picture.wetness import wetted


@pytest.mark.parametrize("share", [0.1, 0.3, 0.7])
def test_the_share_is_wet_half_as_bright_but_for_a_sheen(share: float) -> None:
    dry = np.full((256, 256), 120, np.uint8)
    seen = wetted(dry, share, generator(3, "wet ground"))
    dark = 120 // 2 + 8
    assert seen.min() == dark
    assert seen.max() == 120
    assert (seen < (120 + dark) / 2).mean() == pytest.approx(share, abs=0.01)


def test_a_dry_ground_stays_as_it_was_and_draws_no_random_number() -> None:
    dry = np.full((64, 64), 120, np.uint8)
    rng = generator(3, "wet ground")
    assert wetted(dry, 0.0, rng) is dry
    assert rng.bytes(8) == generator(3, "wet ground").bytes(8)
