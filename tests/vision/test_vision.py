"""Vision as a whole: sightings of the thesis's pad, whole or in parts."""

import math

import cv2
import numpy as np
import pytest

from landerd.camera_model import CameraModel, used_part
from landerd.config.models import VisionSection
from landerd.geometry import Vec3, angle_between
from landerd.messages import Frame, PadPrior, Prior, Sightings
from landerd.vision import Vision
from tests.vision.scenes import IDEAL_CAMERA, THESIS_PAD, Optics, View, look, render
from tests.vision.scenes import THESIS_CAMERA as BIG_CAMERA

OPTICS = Optics()
THESIS_CAMERA = BIG_CAMERA.scaled(320, 240)  # half the size: these images are slow to make


def seen(view: View, prior: Prior | None = None, vision: Vision | None = None) -> Sightings:
    image = render(view, THESIS_CAMERA, OPTICS, np.random.default_rng(1))
    vision = vision or Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    return vision.process(Frame(0.0, 0, image), prior)


def error_m(sightings: Sightings, view: View) -> float:
    return math.dist(sightings.pad[0].position, view.position)


def kinds(sightings: Sightings) -> set[str]:
    return {m.kind for m in sightings.markers}


def test_ring_without_a_tag_that_can_be_read_tells_the_landing_point_and_by_its_plate_north() -> (
    None
):
    view = look(THESIS_CAMERA, 9.0, 0.5, pixel=(160, 150))
    found = seen(view)
    assert kinds(found) == {"whycon"}
    assert error_m(found, view) < 0.1
    assert found.markers[0].id is None
    north = tuple(view.R_camera_pad[:, 0].tolist())
    assert math.degrees(angle_between(found.pad[0].north or (0.0, 0.0, 0.0), north)) < 2.0


def test_a_ring_by_itself_tells_the_landing_point_but_no_north() -> None:
    view = look(THESIS_CAMERA, 9.0, 0.5, pixel=(160, 150))
    ring = THESIS_PAD.model_copy(update={"markers": THESIS_PAD.rings})
    image = render(view, THESIS_CAMERA, OPTICS, np.random.default_rng(1))
    found = Vision(ring, THESIS_CAMERA, VisionSection()).process(Frame(0.0, 0, image))
    assert error_m(found, view) < 0.1
    assert found.pad[0].north is None
    assert found.pad[0].sigma_yaw is None


def test_the_part_of_the_picture_without_an_inverse_distortion_is_not_searched() -> None:
    # A public calibration, mirrored, so that its left edge folds.
    distortion = (0.0981, -4.868, -0.01034, 0.00445, 0.0)
    lens = CameraModel(1920, 1080, 3061.9, 3072.2, 1023.6, 448.0, distortion).scaled(480, 270)
    x0, y0, x1, y1 = used_part(lens)
    assert (0, 0) < (x0, 480 - x1 + y0 + 270 - y1) < (30, 30)
    view = look(lens, 9.0, 0.5, pixel=(200, 140))
    image = render(view, lens, OPTICS, np.random.default_rng(1))
    found = Vision(THESIS_PAD, lens, VisionSection()).process(Frame(0.0, 0, image))
    assert error_m(found, view) < 0.05
    outline = np.array(found.markers[0].outline_px)
    assert (outline.min(axis=0) + outline.max(axis=0)) / 2 == pytest.approx((200, 140), abs=3)
    image[:, :x0] = np.random.default_rng(2).integers(0, 256, (270, x0))
    assert Vision(THESIS_PAD, lens, VisionSection()).process(Frame(0.0, 0, image)) == found


def test_ring_and_tag_together_tell_north() -> None:
    view = look(THESIS_CAMERA, 3.0, 0.5, pixel=(150, 140), heading=0.4)
    found = seen(view, Prior(down=tuple(view.normal.tolist())))
    assert kinds(found) == {"whycon", "apriltag"}
    assert error_m(found, view) < 0.01
    north = found.pad[0].north
    assert north is not None
    assert float(np.dot(north, view.R_camera_pad[:, 0])) > math.cos(math.radians(0.3))


def test_some_tags_of_seven_pixels_across_are_read_beside_their_ring() -> None:
    """Once, none below 8 px was looked for."""
    read = 0
    for i in range(10):
        view = look(BIG_CAMERA, 11.0, math.radians(45.0), pixel=(300, 230), heading=0.6 * i)
        image = render(view, BIG_CAMERA, Optics(background="asphalt"), np.random.default_rng(i))
        vision = Vision(THESIS_PAD, BIG_CAMERA, VisionSection())
        read += "apriltag" in kinds(vision.process(Frame(0.0, 0, image)))
    assert read >= 3


def test_the_level_pose_of_a_tag_beside_its_ring_is_taken_and_not_the_mirrored_one() -> None:
    rng = np.random.default_rng([7, 44])
    at = look(
        BIG_CAMERA,
        rng.uniform(2.0, 3.2),
        rng.uniform(0, 0.12),
        pixel=(rng.uniform(250, 380), rng.uniform(190, 270)),
        tilt_towards=rng.uniform(0, 6.28),
        heading=rng.uniform(0, 6.28),
    )
    white = float(rng.choice([195.0, 255.0, 300.0]))
    optics = Optics(white=white, blur_px=rng.uniform(0.6, 1.6), noise=rng.uniform(2, 10))
    image = render(at, BIG_CAMERA, optics, np.random.default_rng(3))
    vision = Vision(THESIS_PAD, BIG_CAMERA, VisionSection())
    seen = vision.process(Frame(0.0, 0, image), Prior(down=tuple(at.normal.tolist())))
    assert {m.kind for m in seen.markers} == {"whycon", "apriltag"}
    assert math.dist(seen.pad[0].position, at.position) < 0.05


@pytest.mark.parametrize("seed", [14, 56])
def test_a_small_ring_that_a_camera_has_sharpened_or_that_lies_flat_is_seen(seed: int) -> None:
    rng = np.random.default_rng([8, seed])
    distance = rng.uniform(18, 30)
    at = look(
        BIG_CAMERA,
        distance,
        rng.uniform(0.95, 1.2),
        pixel=(rng.uniform(150, 450), rng.uniform(60, 300)),
        tilt_towards=1.57,
        heading=rng.uniform(0, 6.28),
    )
    optics = Optics(background="asphalt", blur_px=rng.uniform(0.5, 0.8), noise=rng.uniform(1, 3))
    image = render(at, BIG_CAMERA, optics, np.random.default_rng(3))
    vision = Vision(THESIS_PAD, BIG_CAMERA, VisionSection())
    prior = Prior(down=tuple(at.normal.tolist()))
    looks = [vision.process(Frame(k / 30, k, image), prior) for k in range(6)]
    seen = next(look for look in looks if look.pad)
    assert math.dist(seen.pad[0].position, at.position) < 0.1 * distance


def test_tag_alone_near_the_ground_tells_the_landing_point_outside_the_image() -> None:
    # 0.75 m behind the tag, and the tag seen at 55 degrees in a lower corner of the image.
    view = look(THESIS_CAMERA, 0.8, math.radians(55), pixel=(165, 165), tilt_towards=-math.pi / 2)
    beyond = np.array(view.position) - 0.75 * view.R_camera_pad[:, 0]
    view = View((float(beyond[0]), float(beyond[1]), float(beyond[2])), view.R_camera_pad)
    vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    seen(view, vision=vision)  # in grass squares are looked for in the next picture
    seen(view, vision=vision)
    found = seen(view, vision=vision)
    assert kinds(found) == {"apriltag"}
    assert error_m(found, view) < 0.005


def test_a_prediction_that_drifts_off_a_tag_among_dirt_does_not_lose_it() -> None:
    view = look(THESIS_CAMERA, 0.8, math.radians(55), pixel=(165, 165), tilt_towards=-math.pi / 2)
    beyond = np.array(view.position) - 0.75 * view.R_camera_pad[:, 0]
    view = View((float(beyond[0]), float(beyond[1]), float(beyond[2])), view.R_camera_pad)
    image = render(view, THESIS_CAMERA, OPTICS, np.random.default_rng(1))
    tag = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    prior = Prior(pad=PadPrior(view.position, 0.01, *_axes(view)))
    corner = np.array(tag.process(Frame(0.0, 0, image), prior).markers[0].outline_px[1])
    cv2.circle(
        image, (int(corner[0]) + 4, int(corner[1]) - 2), 8, 20, -1
    )  # its outline is no square
    vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    for k in range(12):  # 1 cm a picture: a gimbal that is off by ever more
        off = (view.position[0] + 0.01 * k, view.position[1], view.position[2])
        found = vision.process(
            Frame(0.1 * k, k, image), Prior(pad=PadPrior(off, 0.01, *_axes(view)))
        )
        assert kinds(found) == {"apriltag"}
        assert error_m(found, view) < 0.01


def _axes(view: View) -> tuple[Vec3, Vec3]:
    """Return the pad's north and normal, camera frame."""
    north, _, normal = view.R_camera_pad.T.tolist()
    return tuple(north), tuple(normal)


def test_a_wrong_prediction_does_not_hide_the_pad() -> None:
    view = look(THESIS_CAMERA, 3.0, 0.5, pixel=(95, 130))
    wrong = Prior(pad=PadPrior(position=(1.5, 1.0, 3.0), sigma_m=0.1, north=(0.0, -1.0, 0.0)))
    found = seen(view, wrong)
    assert kinds(found) == {"whycon", "apriltag"}
    assert error_m(found, view) < 0.02


def test_an_empty_image_shows_nothing() -> None:
    image = render(None, THESIS_CAMERA, OPTICS, np.random.default_rng(2))
    found = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection()).process(Frame(1.0, 7, image))
    assert (found.t, found.seq, found.markers, found.pad) == (1.0, 7, (), ())


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((240, 321), np.uint8),
        np.zeros((240, 320, 3), np.uint8),
        np.zeros((240, 320), np.float32),
    ],
)
def test_images_of_another_size_or_type_are_refused(image: np.ndarray) -> None:
    vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    with pytest.raises(ValueError, match="image is"):
        vision.process(Frame(0.0, 0, image))


def test_sightings_depend_on_nothing_but_frames_and_priors() -> None:
    views = [look(THESIS_CAMERA, 3.0 - 0.1 * i, 0.4, pixel=(150, 130)) for i in range(3)]
    first = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    second = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    for view in views:
        assert seen(view, None, first) == seen(view, None, second)


def test_a_pad_that_moves_is_fitted_with_its_motion_before_its_plate_tells_where_its_ring_is() -> (
    None
):
    """By its edges alone, as its plate shows them, it would be 8 cm off."""
    view = look(BIG_CAMERA, 6.0, 0.35, pixel=(300.0, 250.0), heading=0.5)
    optics = Optics(motion_px=(10.0, 5.0), background="grass")
    image = render(view, BIG_CAMERA, optics, np.random.default_rng(1))
    found = Vision(THESIS_PAD, BIG_CAMERA, VisionSection()).process(Frame(0.0, 0, image))
    assert error_m(found, view) < 0.02


@pytest.mark.parametrize("distance", [3.0, 4.0, 6.0])
def test_a_tag_with_a_shadow_edge_across_it_tells_the_heading(distance: float) -> None:
    """From one side to the other of the tag the light falls to a fifth over some pixels."""
    view = look(IDEAL_CAMERA, distance, 0.2, pixel=(320.0, 300.0))
    optics = Optics(noise=2.0)
    image = render(view, IDEAL_CAMERA, optics, np.random.default_rng(1))
    square = THESIS_PAD.squares[0]
    middle = np.array(view.position) + view.R_camera_pad @ np.array([*square.position_m, 0.0])
    x = float(IDEAL_CAMERA.pixels(middle[None])[0, 0])
    light = 0.2 + 0.8 / (1.0 + np.exp((np.arange(image.shape[1]) - x) / 2.0))
    shaded = np.rint(image * light).astype(np.uint8)
    seen = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection()).process(Frame(0.0, 0, shaded))
    assert any(m.kind == "apriltag" for m in seen.markers)
    assert seen.pad[0].north is not None
    assert np.dot(seen.pad[0].north, view.R_camera_pad[:, 0]) > math.cos(math.radians(2.0))


@pytest.mark.parametrize("pad", ["thesis", "squares alone"])
def test_a_still_is_not_searched_to_its_end_while_something_is_left_for_the_next_picture(
    pad: str,
) -> None:
    rng = np.random.default_rng(1)
    grass = rng.integers(60, 160, (240, 320)).astype(np.uint8)
    markers = THESIS_PAD.markers if pad == "thesis" else THESIS_PAD.squares
    vision = Vision(
        THESIS_PAD.model_copy(update={"markers": markers}), THESIS_CAMERA, VisionSection()
    )
    vision.process(Frame(0.0, 0, grass))
    assert vision.was_cut is (pad == "thesis")
    for k in range(1, 5):
        vision.process(Frame(0.03 * k, k, grass))
    assert not vision.was_cut


@pytest.mark.parametrize("blank", [0, 3])
def test_the_first_picture_after_clear_sky_is_searched_thoroughly(blank: int) -> None:
    rng = np.random.default_rng(5)
    sky = np.linspace(200.0, 240.0, 480)[:, None] + rng.normal(0.0, 1.0, (480, 640))
    view = look(BIG_CAMERA, 9.0, 0.3, pixel=(330, 260))
    moving = render(view, BIG_CAMERA, Optics(motion_px=(14.0, 10.0)), np.random.default_rng(1))
    images = [*[sky.astype(np.uint8)] * blank, moving]
    vision = Vision(THESIS_PAD, BIG_CAMERA, VisionSection())
    shown = [bool(vision.process(Frame(i / 30, i, image)).pad) for i, image in enumerate(images)]
    assert shown == [False] * blank + [True]
