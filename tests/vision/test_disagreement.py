"""Findings on pads whose markers contradict each other."""

import math

import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame, Sightings
from landerd.pad import PadLayout, Ring, Square
from landerd.vision import Vision
from landerd.vision.disagreement import Disagreement
from tests.vision.scenes import IDEAL_CAMERA, THESIS_PAD, Optics, View, look, render

CAMERA = IDEAL_CAMERA
VIEW = look(CAMERA, 2.5, 0.5, pixel=(320.0, 260.0), heading=0.6)


def printed(**changes: object) -> PadLayout:
    """Return the thesis's pad with a tag that is not as its file says."""
    markers = tuple(
        m.model_copy(update=changes) if isinstance(m, Square) else m for m in THESIS_PAD.markers
    )
    return THESIS_PAD.model_copy(update={"markers": markers})


def shown(vision: Vision, pad: PadLayout, view: View, number: int = 0) -> Sightings:
    image = render(view, CAMERA, Optics(), np.random.default_rng(3), pad)
    return vision.process(Frame(number / 30.0, number, image))


def told(pad: PadLayout) -> Disagreement | None:
    vision = Vision(THESIS_PAD, CAMERA, VisionSection())
    assert shown(vision, pad, VIEW).pad
    return vision.disagreement()


def test_a_pad_as_its_file_says_is_not_complained_of() -> None:
    assert told(THESIS_PAD) is None


def test_a_tag_printed_too_large_is_named_with_its_size() -> None:
    wrong = told(printed(size_m=0.3125 * 1.03))
    assert wrong is not None
    assert "apriltag 0 looks" in wrong.text
    assert "larger than the pad file says" in wrong.text
    assert abs(wrong.by - 0.03) < 0.005


def test_a_misplaced_tag_is_named_with_where_it_lies() -> None:
    wrong = told(printed(position_m=(0.78, 0.0)))
    assert wrong is not None
    assert wrong.what == "place"
    assert "30 mm to the north" in wrong.text


def test_a_turned_tag_is_named_with_its_angle() -> None:
    wrong = told(printed(heading_deg=4.0))
    assert wrong is not None
    assert wrong.what == "heading"
    assert "clockwise by 4.0 degrees" in wrong.text


def test_the_ring_says_where_the_landing_point_is_though_the_tag_lies_elsewhere() -> None:
    vision = Vision(THESIS_PAD, CAMERA, VisionSection())
    (pad, *_) = shown(vision, printed(position_m=(0.75, 0.01)), VIEW).pad
    assert math.dist(pad.position, VIEW.position) < 0.004


def test_an_error_of_the_tag_found_by_the_ring_is_remembered_without_the_ring() -> None:
    pad = printed(position_m=(0.75, 0.01))
    # With a rolling shutter the first picture, the motion not known yet, would teach less.
    vision = Vision(THESIS_PAD, CAMERA, VisionSection(readout_s=0.0))
    for number in range(0, 40, 5):
        shown(vision, pad, VIEW, number)
    tag_only = look(CAMERA, 0.9, 0.2, pixel=(320.0, 720.0), heading=0.0)
    seen = shown(vision, pad, tag_only, 41)
    assert [m.kind for m in seen.markers] == ["apriltag"]
    fresh = Vision(THESIS_PAD, CAMERA, VisionSection())
    shown(fresh, pad, tag_only)  # in texture squares are looked for thoroughly in the next picture
    unaware = shown(fresh, pad, tag_only, 1)
    assert math.dist(unaware.pad[0].position, tag_only.position) > 0.008
    assert math.dist(seen.pad[0].position, tag_only.position) < 0.006


TWO_ALIKE = tuple(
    Ring(kind="whycon", outer_diameter_m=0.4, position_m=place)
    for place in ((0.3, 0.0), (-0.3, 0.0))
)
THREE = (
    Ring(kind="whycon", outer_diameter_m=0.45),
    Ring(kind="whycon", outer_diameter_m=0.2, position_m=(0.4, 0.0)),
    Ring(kind="whycon", outer_diameter_m=0.2, position_m=(-0.4, 0.2)),
)


@pytest.mark.parametrize("heading", [0.0, 1.5, 4.5])
@pytest.mark.parametrize(("rings", "distance"), [(TWO_ALIKE, 1.0), (TWO_ALIKE, 2.0), (THREE, 1.0)])
def test_two_rings_of_one_size_are_not_taken_for_each_other(
    rings: tuple[Ring, ...], distance: float, heading: float
) -> None:
    """Each was found in the other's place, too: that ended in a division by zero."""
    pad = THESIS_PAD.model_copy(update={"markers": rings})
    view = look(CAMERA, distance, 0.3, pixel=(320.0, 240.0), heading=heading)
    vision = Vision(pad, CAMERA, VisionSection())
    assert shown(vision, pad, view).pad
    assert vision.disagreement() is None
