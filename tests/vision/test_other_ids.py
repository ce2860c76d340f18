"""Another pad of the same print: nothing but the id of its tag tells it from the pad."""

import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame, PadPrior, Prior
from landerd.pad import PadLayout
from landerd.vision import Vision
from tests.vision.scenes import IDEAL_CAMERA, THESIS_PAD, Optics, View, look, render, with_tag

GRASS = Optics(background="grass", blur_px=0.8)
SMEARED = Optics(background="grass", blur_px=3.0)  # its id cannot be read
OTHER = with_tag(id=7)


def pictures(pad: PadLayout, distance: float, optics: Optics = GRASS) -> list[Frame]:
    image = render(at(distance), IDEAL_CAMERA, optics, np.random.default_rng(2), pad)
    return [Frame(i / 30.0, i, image) for i in range(4)]


def at(distance: float) -> View:
    return look(IDEAL_CAMERA, distance, 0.3, pixel=(300.0, 230.0), tilt_towards=1.0, heading=0.9)


@pytest.mark.parametrize("distance", [1.5, 3.0, 5.0])
def test_a_pad_whose_tag_has_another_id_is_not_taken_for_the_pad(distance: float) -> None:
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    others = [vision.process(frame) for frame in pictures(OTHER, distance)]
    assert not any(seen.pad for seen in others)
    assert {seen.other_id for seen in others} >= {7}
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    own = [vision.process(frame) for frame in pictures(THESIS_PAD, distance)]
    assert any(seen.pad for seen in own)
    assert {seen.other_id for seen in own} == {None}


def test_after_another_id_was_read_the_pad_is_not_taken_in_a_smeared_picture() -> None:
    clear, *_ = pictures(OTHER, 3.0)
    _, smeared, *_ = pictures(OTHER, 3.0, SMEARED)
    prior = Prior(pad=PadPrior(at(3.0).position, 0.05, None))
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    assert vision.process(smeared, prior).pad  # by its ring
    assert not vision.process(Frame(0.1, 3, clear.image), prior).pad
    after = vision.process(Frame(0.2, 4, smeared.image), prior)
    assert (after.pad, after.other_id) == ((), 7)
