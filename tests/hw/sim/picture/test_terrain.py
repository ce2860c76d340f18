"""Procedural grounds: each is its seed's, as bright as measured ones, and without a seam."""

import numpy as np
import pytest

from hw.sim.picture.fractal import generator
from hw.sim.picture.terrain import TERRAINS

MEAN = {  # reflectance against the pad's white, as the module's sources have it; things apart
    "meadow": (0.14, 0.14),
    "gravel": (0.26, 0.30),
    "paving": (0.35, 0.35),
    "canopy": (0.07, 0.07),
    "roof": (0.14, 0.52),  # bitumen to a light membrane
    "car_park": (0.12, 0.32),  # with cars of any paint
    "water": (0.055, 0.055),
}


def test_every_kind_of_ground_has_its_mean() -> None:
    assert TERRAINS.keys() == MEAN.keys()


@pytest.mark.parametrize("kind", list(MEAN))
def test_a_ground_depends_on_its_seed_has_its_mean_and_no_seam(kind: str) -> None:
    made = [TERRAINS[kind](generator(seed, "terrain")) for seed in (1, 2, 1)]
    least, most = MEAN[kind]
    for texture in made:
        assert least - 0.012 < texture.mean() / 200.0 < most + 0.012
        for axis in (0, 1):
            before = np.roll(texture, 1, axis=axis).astype(int)
            steps = np.abs(texture - before).mean(axis=1 - axis)
            # A joint, a lap or a painted line may lie on the border, as it lies elsewhere.
            assert steps[0] <= 1.4 * steps[1:].max()
    assert (made[0] == made[2]).all()
    assert (made[0] != made[1]).mean() > 0.5
