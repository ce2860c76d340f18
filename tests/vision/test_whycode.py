"""WhyCodes in made images: number, direction and pose; nothing else is taken for one."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame, MarkerSighting, PadPrior, Prior, Sightings
from landerd.pad import PadLayout, Plate, Ring, WhyCode, load_pad
from landerd.vision import Vision
from landerd.vision.arrays import Image
from landerd.vision.pose import Pose, rotation_from
from landerd.vision.whycode import _agrees_in_view, _alike
from tests.vision import scenes

# The thesis camera's middle: large images are slow to make.
CAMERA = replace(scenes.THESIS_CAMERA, width=200, height=180, cx=100.0, cy=90.0)
PLATE = Plate(north_m=0.62, south_m=0.62, east_m=0.62, west_m=0.62)


def pad(number: int = 5, bits: int = 6, heading_deg: float = 0.0) -> PadLayout:
    code = WhyCode(
        kind="whycode", outer_diameter_m=1.0, bits=bits, id=number, heading_deg=heading_deg
    )
    return PadLayout(name="code", markers=(code,), plate=PLATE)


def look(distance: float, tilt_deg: float, heading_deg: float = 25.0) -> scenes.View:
    return scenes.look(
        CAMERA,
        distance,
        math.radians(tilt_deg),
        pixel=(104, 88),
        tilt_towards=0.7,
        heading=math.radians(heading_deg),
    )


def seen(
    view: scenes.View | None,
    printed: PadLayout,
    wanted: PadLayout | None = None,
    optics: scenes.Optics | None = None,
    prior: Prior | None = None,
    seed: int = 1,
) -> Sightings:
    rng = np.random.default_rng(seed)
    image = scenes.render(view, CAMERA, optics or scenes.Optics(), rng, printed)
    vision = Vision(wanted or printed, CAMERA, VisionSection())
    return vision.process(Frame(0.0, 0, image), prior)


def yaw_error_deg(marker: MarkerSighting, view: scenes.View) -> float:
    north = marker.solutions[0].north
    assert north is not None
    axes = view.R_camera_pad
    return math.degrees(math.atan2(float(north @ axes[:, 1]), float(north @ axes[:, 0])))


def normal_error_deg(marker: MarkerSighting, view: scenes.View) -> float:
    cosine = float(np.dot(marker.solutions[0].normal, view.normal))
    return math.degrees(math.acos(min(1.0, cosine)))


@pytest.mark.parametrize("seed", [8, 10, 36])
def test_gravity_tells_a_code_from_its_mirrored_pose_where_a_shadow_ends_on_it(seed: int) -> None:
    """The fit to grey levels knows no shade: it may explain it better by the wrong pose."""
    rng = np.random.default_rng(seed)
    tilt, towards, heading, turn = rng.uniform((0.2, 0.0, 0.0, 0.0), (0.6, 6.28, 6.28, 6.28))
    distance, softness_px = rng.uniform((12.0, 2.0), (19.0, 10.0))
    view = scenes.look(
        CAMERA, distance, tilt, pixel=(104, 88), tilt_towards=towards, heading=heading
    )
    image = scenes.render(view, CAMERA, scenes.Optics(noise=2.0), rng, pad())
    y, x = np.mgrid[:180, :200]
    side = (x - 104.0) * math.cos(turn) + (y - 88.0) * math.sin(turn)
    light = 1.0 - 0.7 * (0.5 + 0.5 * np.tanh(side / softness_px))
    shaded = np.clip(image * light, 0.0, 255.0).astype(np.uint8)
    vision = Vision(pad(), CAMERA, VisionSection())
    down = tuple(view.normal.tolist())
    (marker,) = vision.process(Frame(0.0, 0, shaded), Prior(down=down)).markers
    assert normal_error_deg(marker, view) < 12.0


@pytest.mark.parametrize("distance", [4.0, 10.0, 12.0, 18.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 45.0])
def test_one_code_tells_place_number_and_north(distance: float, tilt_deg: float) -> None:
    view = look(distance, tilt_deg)
    found = seen(view, pad())
    (marker,) = found.markers
    assert (marker.kind, marker.id) == ("whycode", 5)
    # The noise of one picture alone is worth 13 mm at 18 m (one sigma).
    assert math.dist(found.pad[0].position, view.position) < 0.001 + 0.0012 * distance
    assert abs(yaw_error_deg(marker, view)) < 0.5
    # Nearly frontal, the tilt itself is hardly seen from far off.
    assert normal_error_deg(marker, view) < (2.0 if tilt_deg else 8.0)


@pytest.mark.parametrize("distance", [16.0, 18.0, 20.0])
def test_a_code_is_seen_as_soon_as_the_camera_is_still_again(distance: float) -> None:
    view, rng = look(distance, 30.0), np.random.default_rng(3)
    vision = Vision(pad(), CAMERA, VisionSection())
    found = []
    for i, motion_px in enumerate([0.0, 7.0, 7.0, 7.0, 0.0]):
        optics = scenes.Optics(motion_px=(0.3 * motion_px, motion_px))
        image = scenes.render(view, CAMERA, optics, rng, pad())
        found.append(vision.process(Frame(i / 30.0, i, image)))
    assert math.dist(found[-1].pad[0].position, view.position) < 0.002 * distance


@pytest.mark.parametrize(("number", "bits"), [(31, 6), (1, 3), (23, 8)])
@pytest.mark.parametrize("heading_deg", [-170.0, -65.0, 100.0])
def test_every_turn_of_every_code_is_read(number: int, bits: int, heading_deg: float) -> None:
    view = look(8.0, 20.0, heading_deg)
    (marker,) = seen(view, pad(number, bits)).markers
    assert marker.id == number
    assert abs(yaw_error_deg(marker, view)) < 0.5


def test_a_code_turned_on_its_pad_tells_the_pads_north() -> None:
    view = look(4.0, 20.0)
    found = seen(view, pad(heading_deg=70.0))
    north = found.pad[0].north
    assert north is not None
    assert float(np.dot(north, view.R_camera_pad[:, 0])) > math.cos(math.radians(0.3))
    assert abs(yaw_error_deg(found.markers[0], view) - 70.0) < 0.3


@pytest.mark.parametrize("number", [1, 3, 7, 11, 13, 15, 23, 31])
def test_other_codes_are_never_taken_for_the_pads(number: int) -> None:
    for distance, tilt_deg in ((6.0, 10.0), (14.0, 45.0), (24.0, 30.0)):
        found = seen(look(distance, tilt_deg), pad(number), wanted=pad(5))
        assert found.markers == ()
        assert found.pad == ()


def test_the_second_pose_of_a_code_does_not_read_as_another_number() -> None:
    # Under the mirrored pose of this view the band of code 7 reads as 31, though less clearly.
    corner = replace(CAMERA, cx=scenes.THESIS_CAMERA.cx - 10.0, cy=scenes.THESIS_CAMERA.cy - 60.0)
    normal, north = np.array([0.047, -0.466, 0.884]), np.array([-0.209, -0.87, -0.447])
    R = rotation_from(normal / np.linalg.norm(normal), north)
    view = scenes.View((-1.84, -0.79, 4.58), R)
    image = scenes.render(view, corner, scenes.Optics(), np.random.default_rng(1), pad(7))
    for number, markers in ((31, 0), (7, 1)):
        vision = Vision(pad(number), corner, VisionSection())
        assert len(vision.process(Frame(0.0, 0, image)).markers) == markers


def test_a_plain_ring_is_no_code() -> None:
    ring = Ring(kind="whycon", outer_diameter_m=1.0)
    plain = PadLayout(name="ring", markers=(ring,), plate=PLATE)
    for distance in (3.0, 8.0, 15.0):
        assert seen(look(distance, 20.0), plain, wanted=pad()).markers == ()


def test_the_small_code_in_the_heart_tells_the_pad_when_the_large_one_is_out_of_the_image() -> None:
    nested = load_pad(Path(__file__).parents[2] / "config/pads/whycode-nested.yaml")
    large, small = (c.id for c in nested.whycodes)
    vision = Vision(nested, CAMERA, VisionSection())
    rng = np.random.default_rng(6)
    ids = set()
    for i, distance in enumerate((8.0, 7.7, 3.0, 2.9, 1.6, 1.5, 0.7, 0.65)):
        view = look(distance, 12.0)
        image = scenes.render(view, CAMERA, scenes.Optics(), rng, nested)
        found = vision.process(Frame(i / 30.0, i, image), None)
        ids.add(tuple(m.id for m in found.markers))
        assert math.dist(found.pad[0].position, view.position) < 0.02
        assert all(abs(yaw_error_deg(m, view)) < 0.5 for m in found.markers)
    assert (large,) in ids
    assert (small,) in ids


def test_nothing_is_seen_where_no_pad_is() -> None:
    assert seen(None, pad()).markers == ()


def test_shadow_and_motion_do_not_change_what_is_read() -> None:
    view = look(6.0, 30.0)
    x, y = CAMERA.pixels(np.array([view.position]))[0]
    shadow = scenes.Shadow(0.45, (float(x) + 6.0, float(y)), (0.8, 0.6))
    for optics in (
        replace(scenes.Optics(), shadow=shadow),
        replace(scenes.Optics(), motion_px=(3.0, 2.0)),
    ):
        (marker,) = seen(view, pad(), optics=optics).markers
        assert marker.id == 5
        assert abs(yaw_error_deg(marker, view)) < 1.5
        assert normal_error_deg(marker, view) < 5.0


def test_the_true_one_of_both_normals_is_first_without_gravity() -> None:
    for towards in np.arange(4) * math.pi / 2.0:
        view = scenes.look(
            CAMERA, 10.0, math.radians(30), pixel=(95, 93), tilt_towards=float(towards)
        )
        (marker,) = seen(view, pad()).markers
        assert len(marker.solutions) == 2
        assert normal_error_deg(marker, view) < 5.0
        assert marker.solutions[1].cost > 9.0


def test_a_descent_keeps_number_north_and_normal() -> None:
    vision = Vision(pad(), CAMERA, VisionSection())
    rng = np.random.default_rng(4)
    for i in range(12):
        view = look(12.0 - 0.6 * i, 30.0 - 2.0 * i, 10.0 + 2.0 * i)
        image = scenes.render(view, CAMERA, scenes.Optics(), rng, pad())
        found = vision.process(Frame(i / 30.0, i, image), None)
        (marker,) = found.markers
        assert marker.id == 5
        assert normal_error_deg(marker, view) < 5.0
        assert abs(yaw_error_deg(marker, view)) < 0.5
        assert math.dist(found.pad[0].position, view.position) < 0.03


def test_a_code_is_followed_down_to_where_the_image_cuts_its_teeth() -> None:
    """No other number is taken for it there, except 7: the bit that differs is out of the image."""
    vision = Vision(pad(5), CAMERA, VisionSection())
    rng = np.random.default_rng(4)
    for i in range(15):
        view = look(2.4 * 0.94**i, 5.0)
        image = scenes.render(view, CAMERA, scenes.Optics(), rng, pad(5))
        found = vision.process(Frame(i / 30.0, i, image))
        assert math.dist(found.pad[0].position, view.position) < 0.01
        assert abs(yaw_error_deg(found.markers[0], view)) < 0.5
    for number in (1, 3, 11, 13, 15, 23, 31):
        for turn_deg in range(0, 360, 60):
            other = look(1.0, 5.0, 25.0 + turn_deg)
            image = scenes.render(other, CAMERA, scenes.Optics(), rng, pad(number))
            assert vision.process(Frame(0.5, 15, image)).markers == ()


def across(view: scenes.View, darkness: float, heading: float) -> scenes.Optics:
    """Return light with a hard shadow's edge across the code."""
    x, y = CAMERA.pixels(np.array([view.position]))[0]
    side = (math.cos(heading), math.sin(heading))
    shadow = scenes.Shadow(darkness, (float(x), float(y)), side)
    return replace(scenes.Optics(), shadow=shadow)


@pytest.mark.parametrize("distance", [4.0, 8.0, 12.0])
@pytest.mark.parametrize("heading", [0.3, 1.9, 3.5, 5.0])
def test_a_code_half_in_hard_shadow_is_seen_to_millimetres(distance: float, heading: float) -> None:
    view = look(distance, 30.0)
    found = seen(view, pad(), optics=across(view, 0.2, heading))
    (marker,) = found.markers
    assert math.dist(found.pad[0].position, view.position) < 0.004 * distance
    assert abs(yaw_error_deg(marker, view)) < 1.0
    assert normal_error_deg(marker, view) < 4.0


# Where the band of teeth is, over the outer radius, and a bit of six.
BAND, BIT = 0.47, math.pi / 3.0


def dirty(view: scenes.View, printed: PadLayout, bit: int) -> Frame:
    """Return a picture in which dirt leaves little of one bit of the code to be seen."""
    rng = np.random.default_rng(5)
    image = scenes.render(view, CAMERA, scenes.Optics(), rng, printed)
    angle = (bit + 0.5) * BIT
    patch = np.array([[math.cos(a), math.sin(a)] for a in np.arange(9) * 2.0 * math.pi / 9.0])
    middle = 0.5 * BAND * np.array([math.sin(angle), math.cos(angle)])
    flat = np.column_stack([middle + 0.12 * patch, np.zeros(9)])
    px = CAMERA.pixels(np.array(view.position) + flat @ view.R_camera_pad.T)
    share = np.zeros(image.shape)
    cv2.fillPoly(share, [np.rint(16.0 * px).astype(np.int32)], 0.7, cv2.LINE_AA, shift=4)
    return Frame(0.0, 0, np.rint(image * (1.0 - share) + 90.0 * share).astype(np.uint8))


@pytest.mark.parametrize("bit", range(6))
def test_dirt_on_one_bit_hides_no_code_and_makes_none_of_another(bit: int) -> None:
    view = look(6.0, 20.0)
    vision = Vision(pad(5), CAMERA, VisionSection())
    found = vision.process(dirty(view, pad(5), bit))
    (marker,) = found.markers
    assert math.dist(found.pad[0].position, view.position) < 0.012
    assert abs(yaw_error_deg(marker, view)) < 0.5
    for number in (1, 7, 13, 31):
        vision = Vision(pad(5), CAMERA, VisionSection())
        assert vision.process(dirty(view, pad(number), bit)).markers == ()


def test_a_code_that_was_read_is_followed_to_where_it_cannot_be() -> None:
    optics = replace(scenes.Optics(), white=90.0, black=25.0, noise=3.0, blur_px=2.0)
    rng = np.random.default_rng(2)
    vision = Vision(pad(), CAMERA, VisionSection())
    for i, distance in enumerate(np.arange(9.0, 15.0, 0.2)):
        view = look(float(distance), 40.0)
        image = scenes.render(view, CAMERA, optics, rng, pad())
        found = vision.process(Frame(i / 30.0, i, image))
        assert math.dist(found.pad[0].position, view.position) < 0.02 * distance
    # Alone, the last of them tells no number.
    assert Vision(pad(), CAMERA, VisionSection()).process(Frame(0.0, 0, image)).markers == ()


def wear_that_hides(view: scenes.View, tells: Callable[[Image, Pose], bool]) -> float:
    """Return the share of a code's contrast that is gone where it is no longer told."""
    pose = Pose(view.R_camera_pad, np.array(view.position), np.zeros((6, 6)), 0.0)
    rng, optics = np.random.default_rng(3), scenes.Optics(noise=0.0)
    plain = Ring(kind="whycon", outer_diameter_m=1.0, inner_ratio=0.6)
    blank = PadLayout(name="blank", markers=(plain,), plate=PLATE)
    printed, empty = (scenes.render(view, CAMERA, optics, rng, p) + 1.0 for p in (pad(), blank))
    shade = np.exp(np.linspace(-1.5, 0.0, CAMERA.width))  # uneven light: the teeth must exceed it
    for wear in np.arange(0.0, 1.0, 0.02):
        worn = printed ** (1.0 - wear) * empty**wear * shade
        if not tells(np.clip(np.rint(worn), 0, 255).astype(np.uint8), pose):
            return float(wear)
    return 1.0


def test_what_is_followed_as_a_code_shows_its_teeth_as_clearly_as_what_is_found() -> None:
    """Else a band worn blank would be followed as the pad's code, or a good one lost when cut."""
    code = pad().markers[0]
    assert isinstance(code, WhyCode)

    def is_found(image: Image, pose: Pose) -> bool:
        return _alike(image, CAMERA, pose, code.radius_m, code) is not None

    def is_followed(image: Image, pose: Pose) -> bool:
        return _agrees_in_view(image, CAMERA, pose, code)

    whole = look(2.8, 0.0)
    found = wear_that_hides(whole, is_found)
    assert 0.5 < found < 0.95
    assert abs(wear_that_hides(whole, is_followed) - found) < 0.05
    for x in (28, 32, 36):
        cut = scenes.look(CAMERA, 2.8, 0.0, pixel=(x, 88))
        assert abs(wear_that_hides(cut, is_followed) - found) < 0.05


@pytest.mark.parametrize("black", [70.0, 110.0])
def test_a_leg_over_a_code_does_not_lead_its_fit_aside(black: float) -> None:
    """Once, the edges were looked for from the expected pose alone, and led aside by 3 %."""
    camera, printed = scenes.THESIS_CAMERA, pad()
    view = scenes.look(camera, 8.87, 0.685, pixel=(475.0, 158.0), heading=-2.54, tilt_towards=1.51)
    optics = scenes.Optics(white=172.0, black=black, noise=2.0, blur_px=0.92)
    image = scenes.render(view, camera, optics, np.random.default_rng(1), printed)
    leg = np.array([(-0.18, -0.22, 0), (-0.21, -0.15, 0), (1.51, 0.89, 0), (1.72, 0.44, 0)])
    px = camera.pixels(np.array(view.position) + leg @ view.R_camera_pad.T)
    cv2.fillPoly(image, [np.rint(px * 16.0).astype(np.int32)], 40.0, shift=4)
    x, y, z = view.position
    expected = PadPrior(
        (x - 0.07, y + 0.034, z + 0.034),
        0.09,
        tuple(view.R_camera_pad[:, 0].tolist()),
        tuple(view.normal.tolist()),
    )
    found = Vision(printed, camera, VisionSection()).process(
        Frame(0.0, 0, image), Prior(tuple(view.normal.tolist()), expected)
    )
    assert np.linalg.norm(np.subtract(found.pad[0].position, view.position)) < 0.05
