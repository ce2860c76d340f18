"""The pad's heading by its plate, where its tag cannot be read."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.config.models import VisionSection
from landerd.geometry import angle_between
from landerd.messages import Frame, PadPrior, PoseSolution, Prior
from landerd.pad import PadLayout, Plate
from landerd.vision import Vision
from landerd.vision.plate_outline import own_levels
from landerd.vision.pose import circle
from tests.vision.scenes import (
    IDEAL_CAMERA,
    THESIS_PAD,
    Optics,
    View,
    look,
    render,
    with_tag,
)

U8 = NDArray[np.uint8]
RING, TAG = THESIS_PAD.rings[0], THESIS_PAD.squares[0]


def view(distance: float, heading: float, pixel: tuple[float, float] = (300.0, 230.0)) -> View:
    return look(IDEAL_CAMERA, distance, 0.3, pixel=pixel, tilt_towards=1.0, heading=heading)


def picture(at: View, pad: PadLayout = THESIS_PAD, background: str = "grass") -> U8:
    optics = Optics(background=background, blur_px=1.2)
    return render(at, IDEAL_CAMERA, optics, np.random.default_rng(4), pad)


def test_a_ring_whose_margin_is_all_out_of_the_picture_tells_no_grey_levels() -> None:
    camera = replace(IDEAL_CAMERA, width=480, height=480, cx=239.5, cy=239.5)
    image = np.full((480, 480), 128, np.uint8)
    black = 0.5 * (1.0 + RING.inner_ratio)
    for radius_px, seen in ((235.0, None), (200.0, (128.0, 128.0))):
        centre = np.array([0.0, 0.0, camera.fx * black * RING.radius_m / radius_px])
        assert own_levels(image, camera, RING, centre, np.eye(3)[:, :2]) == seen


def dirty(image: U8, at: View) -> U8:
    """Return a picture with mud and bird droppings on most of the tag."""
    rng, splashed = np.random.default_rng(3), image.copy()
    for place in rng.uniform(-0.55, 0.55, (40, 2)) * TAG.size_m:
        outline = np.array(TAG.position_m) + place + circle(0.09 * TAG.size_m, 9)
        px = IDEAL_CAMERA.pixels(np.array(at.position) + outline @ at.R_camera_pad[:, :2].T)
        level = float(rng.choice([50.0, 180.0]))
        cv2.fillConvexPoly(splashed, np.rint(16.0 * px).astype(np.int32), level, shift=4)
    return splashed


def seen_in(
    image: U8, at: View, pad: PadPrior | None = None, layout: PadLayout = THESIS_PAD
) -> PoseSolution:
    prior = Prior(pad=pad, down=tuple(at.normal.tolist()))
    vision = Vision(layout, IDEAL_CAMERA, VisionSection())
    sights = [vision.process(Frame(i / 30.0, i, image), prior) for i in range(5)]
    seen = [s for s in sights if s.pad]
    assert seen
    assert all(m.id is None for m in seen[-1].markers)  # else it was read
    return seen[-1].pad[0]


def off_deg(seen: PoseSolution, at: View) -> float:
    assert seen.north is not None
    return math.degrees(angle_between(seen.north, tuple(at.R_camera_pad[:, 0].tolist())))


@pytest.mark.parametrize("distance", [14.0, 17.0, 20.0])
@pytest.mark.parametrize("heading", [0.3, 1.9, 4.4])
def test_the_heading_is_known_before_the_tag_can_be_read(distance: float, heading: float) -> None:
    at = view(distance, heading)
    seen = seen_in(picture(at), at)
    assert off_deg(seen, at) < 2.0
    assert seen.sigma_yaw is not None
    assert math.radians(off_deg(seen, at)) < 3.0 * seen.sigma_yaw


@pytest.mark.parametrize("distance", [2.5, 4.0, 7.0])
def test_the_heading_is_known_where_dirt_hides_most_of_the_tags_code(distance: float) -> None:
    at = view(distance, 2.2)
    assert off_deg(seen_in(dirty(picture(at), at), at), at) < 2.0


@pytest.mark.parametrize("number", range(1, 6))
def test_a_plate_with_another_code_on_it_gives_no_heading(number: int) -> None:
    """It is another pad's, of a dictionary that nobody reads here."""
    other = with_tag(dictionary="APRILTAG_36h10", id=number)
    at = view(4.0, 2.2)
    assert seen_in(picture(at, other), at).north is None


def test_a_plate_that_looks_alike_from_all_sides_gives_no_heading() -> None:
    middle = Plate(north_m=1.02, south_m=1.02, east_m=1.02, west_m=1.02)
    bare = PadLayout(name="bare", markers=(RING,), plate=middle)
    layout = THESIS_PAD.model_copy(update={"plate": middle})
    at = view(9.0, 2.2)
    assert seen_in(picture(at, bare), at, layout=layout).north is None


@pytest.mark.parametrize("background", ["asphalt", "plain"])
def test_a_plate_cut_off_behind_its_tag_is_not_taken_for_one_turned_a_quarter(
    background: str,
) -> None:
    """Less of it is in the picture than there would be of that one, whose sides are seen worse."""
    heading = math.radians(303.0)
    at = look(IDEAL_CAMERA, 3.0, 0.55, pixel=(57.0, 240.0), tilt_towards=0.0, heading=heading)
    north = seen_in(picture(at, background=background), at).north
    assert north is None or angle_between(north, tuple(at.R_camera_pad[:, 0])) < 0.1


def test_two_sides_of_the_plate_give_a_heading_near_the_known_one() -> None:
    """Over the pad the tag, its end of the plate and another side are out of the picture."""
    at = view(1.7, 1.57, pixel=(440.0, 300.0))
    image = dirty(picture(at), at)
    assert seen_in(image, at).north is None
    turned = at.R_camera_pad @ cv2.Rodrigues(np.array([0.0, 0.0, 0.1]))[0]
    pad = PadPrior(
        at.position, 0.05, normal=tuple(at.normal.tolist()), north=tuple(turned[:, 0].tolist())
    )
    assert off_deg(seen_in(image, at, pad), at) < 2.0


def test_while_the_heading_is_known_by_the_plate_alone_a_ring_without_a_plate_is_refused() -> None:
    at = view(8.0, 2.2)
    narrow = Plate(north_m=0.56, south_m=0.56, east_m=0.56, west_m=0.56)
    bare = PadLayout(name="bare", markers=(RING,), plate=narrow)
    north = tuple(at.R_camera_pad[:, 0].tolist())
    prior = Prior(pad=PadPrior(at.position, 0.05, normal=tuple(at.normal.tolist()), north=north))
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    image = picture(at, bare)
    assert not any(vision.process(Frame(i / 30.0, i, image), prior).pad for i in range(5))
