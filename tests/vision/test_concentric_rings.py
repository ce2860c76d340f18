"""Pads with several round markers about one centre, which look alike but for their size."""

import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import Marker, PadLayout, Plate, Ring, WhyCode
from landerd.vision import Vision
from tests.vision import scenes

CAMERA = scenes.THESIS_CAMERA
CODE = WhyCode(kind="whycode", outer_diameter_m=0.3, bits=6, id=5)


def rings(*outer_diameters_m: float, inner_ratio: float = 0.5) -> tuple[Ring, ...]:
    return tuple(
        Ring(kind="whycon", outer_diameter_m=d, inner_ratio=inner_ratio) for d in outer_diameters_m
    )


@pytest.mark.parametrize(
    "markers",
    [
        rings(1.0, 0.25, inner_ratio=0.41),
        rings(1.4, 0.45, 0.14),
        (
            *rings(1.0, inner_ratio=0.41),
            WhyCode(kind="whycode", outer_diameter_m=0.3, bits=6, id=5),
        ),
    ],
    ids=["two rings", "three rings", "a WhyCode in a ring"],
)
def test_the_pad_is_as_far_away_as_all_of_them_say_together(markers: tuple[Marker, ...]) -> None:
    plate = Plate(north_m=0.8, south_m=0.8, east_m=0.8, west_m=0.8)
    layout = PadLayout(name="concentric", markers=markers, plate=plate)
    rng = np.random.default_rng(5)
    for i in range(8):
        distance = float(rng.choice([2.0, 4.0, 6.0, 8.0]))
        pixel = (rng.uniform(150, 490), rng.uniform(120, 360))
        view = scenes.look(CAMERA, distance, rng.uniform(0.0, 0.6), pixel=pixel)
        image = scenes.render(view, CAMERA, scenes.Optics(background="grass"), rng, layout)
        pad = Vision(layout, CAMERA, VisionSection()).process(Frame(0.0, i, image)).pad
        assert np.linalg.norm(pad[0].position) == pytest.approx(distance, rel=0.02)
