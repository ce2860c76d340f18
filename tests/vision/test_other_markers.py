"""What lies there instead of the pad of the pad file is told in words."""

from pathlib import Path

import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import Marker, PadLayout, Ring, Square, WhyCode, load_pad
from landerd.vision import Vision
from tests.vision.scenes import THESIS_CAMERA, THESIS_PAD, U8, Optics, alone, look, render

PADS = Path(__file__).parents[2] / "config" / "pads"
RING = Ring(kind="whycon", outer_diameter_m=1.0)
TAG = Square(kind="aruco", dictionary="4X4_100", id=3, size_m=0.4)
CODE = WhyCode(kind="whycode", outer_diameter_m=0.6, bits=6, id=5)


def ring(ratio: float) -> Ring:
    return RING.model_copy(update={"inner_ratio": ratio})


def tag(dictionary: str, number: int) -> Square:
    return TAG.model_copy(update={"dictionary": dictionary, "id": number})


def picture(layout: PadLayout, distance: float, optics: Optics | None = None) -> U8:
    view = look(THESIS_CAMERA, distance, 0.4, pixel=(300.0, 240.0), heading=0.6)
    light = optics or Optics(background="grass")
    return render(view, THESIS_CAMERA, light, np.random.default_rng(4), layout)


def said(there: PadLayout, told: PadLayout, distance: float, gamma: float = 1.0) -> list[str]:
    """Return what is said of a picture of one pad where the pad file tells another."""
    image = picture(there, distance)
    image = np.rint(255.0 * (image / 255.0) ** (1.0 / gamma)).astype(np.uint8)
    vision = Vision(told, THESIS_CAMERA, VisionSection())
    return vision.other_markers(image, vision.search_still(Frame(0.0, 0, image)))


@pytest.mark.parametrize(
    ("is_", "told", "distance", "gamma"),
    [
        (0.5, 0.41, 10.0, 1.0),
        (0.36, 0.5, 5.0, 2.2),
        (0.3, 0.45, 2.0, 1.0),
        (0.3, 0.45, 10.0, 2.2),
        (0.65, 0.36, 2.0, 2.2),
    ],
)
def test_a_ring_of_another_ratio_is_told_with_its_ratio(
    is_: float, told: float, distance: float, gamma: float
) -> None:
    (text,) = said(alone(ring(is_)), alone(ring(told)), distance, gamma)
    about = float(text.split("inner ratio is about ")[1].split()[0])
    assert about == pytest.approx(is_, rel=0.08)
    assert text.endswith(f"(the pad file has {told:g})")


def test_a_ring_of_another_ratio_is_told_even_if_the_tag_shows_the_pad() -> None:
    _, square = THESIS_PAD.markers
    other = THESIS_PAD.model_copy(update={"markers": (ring(0.5), square)})
    (text,) = said(other, THESIS_PAD, 2.5)
    assert text.startswith("a ring whose inner ratio is about ")


@pytest.mark.parametrize(
    ("there", "told", "text"),
    [
        (tag("4X4_100", 5), TAG, "tag 5 of 4X4_100 (the pad file has 3 of 4X4_100)"),
        (tag("APRILTAG_36h11", 3), TAG, "tag 3 of APRILTAG_36h11 (the pad file has 3 of 4X4_100)"),
        (tag("5X5_250", 3), TAG, "tag 3 of 5X5_1000 (the pad file has 3 of 4X4_100)"),
        (
            CODE.model_copy(update={"id": 11}),
            CODE,
            "WhyCode 11 of 6 bits (the pad file has 5 of 6 bits)",
        ),
    ],
)
def test_another_number_is_told(there: Marker, told: Marker, text: str) -> None:
    assert said(alone(there), alone(told), 2.0) == [text]


def test_one_tag_of_another_number_among_the_pads_own_is_told() -> None:
    pad = load_pad(PADS / "bundle.yaml")
    *others, last = pad.squares
    told = pad.model_copy(update={"markers": (*others, last.model_copy(update={"id": 24}))})
    (text,) = said(pad, told, 2.5)
    assert text.startswith("tag 14 of APRILTAG_36h11 (the pad file has 10, 11, 12, 13, 24 of ")


def test_a_whycode_is_not_told_as_a_ring_of_another_ratio() -> None:
    assert said(alone(CODE), alone(RING), 2.0) == ["WhyCode 5 of 6 bits (the pad file has none)"]
    both = alone(CODE).model_copy(update={"markers": (CODE, RING)})
    assert said(alone(CODE), both, 2.0) == []


def test_a_pad_of_a_long_whycode_takes_no_longer_to_tell() -> None:
    """It has 335 numbers; to draw a print of each took twelve seconds."""
    long = WhyCode(kind="whycode", outer_diameter_m=0.6, bits=12, id=5)
    (text,) = said(alone(long.model_copy(update={"id": 11})), alone(long), 1.2)
    assert text == "WhyCode 11 of 12 bits (the pad file has 5 of 12 bits)"


@pytest.mark.parametrize("marker", [RING, TAG, CODE])
def test_nothing_is_said_of_the_pad_itself(marker: Marker) -> None:
    assert said(alone(marker), alone(marker), 2.0) == []


@pytest.mark.parametrize("background", ["fractal", "grass", "asphalt"])
def test_nothing_is_said_of_the_ground(background: str) -> None:
    everything = THESIS_PAD.model_copy(update={"markers": (RING, TAG, CODE)})
    vision = Vision(everything, THESIS_CAMERA, VisionSection())
    image = render(None, THESIS_CAMERA, Optics(background=background), np.random.default_rng(8))
    assert vision.other_markers(image, vision.process(Frame(0.0, 0, image))) == []
