"""Rings refused because the pad's plate or tag is missing beside them, and rings that are not."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.config.models import VisionSection
from landerd.messages import Frame, MarkerSighting, PadPrior, PoseSolution, Prior
from landerd.pad import PadLayout, Plate, Square
from landerd.vision import Vision
from landerd.vision.plate_check import PlateCheck
from landerd.vision.plate_heading import PlateHeading
from landerd.vision.plate_outline import plate_corners
from landerd.vision.whycon import find_rings
from tests.vision.scenes import (
    F32,
    IDEAL_CAMERA,
    THESIS_CAMERA,
    THESIS_PAD,
    Mask,
    Optics,
    Shadow,
    View,
    look,
    outline,
    random_view,
    render,
    with_tag,
)

U8 = NDArray[np.uint8]
RING = THESIS_PAD.rings[0]
BARE = PadLayout(
    name="bare",
    markers=(RING,),
    plate=Plate(north_m=0.62, south_m=0.62, east_m=0.62, west_m=0.62),
)
UNREADABLE = with_tag(dictionary="APRILTAG_36h10", id=1)


def view(distance: float, heading: float) -> View:
    return look(
        IDEAL_CAMERA, distance, 0.4, pixel=(300.0, 230.0), tilt_towards=1.0, heading=heading
    )


def is_seen(painted: PadLayout, at: View, optics: Optics) -> bool:
    """Tell whether one of some pictures shows the thesis's pad: a search may go on in the next."""
    image = render(at, IDEAL_CAMERA, optics, np.random.default_rng(2), painted)
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    return any(vision.process(Frame(i / 30.0, i, image)).pad for i in range(5))


@pytest.mark.parametrize(
    ("distance", "heading"), [(3.0, 0.3), (8.0, 2.5), (20.0, 0.3), (36.0, 2.5), (36.0, 0.3)]
)
def test_a_ring_alone_is_not_the_pad_that_has_a_tag_beside_it(
    distance: float, heading: float
) -> None:
    grass = Optics(background="grass")
    assert not is_seen(BARE, view(distance, heading), grass)
    assert is_seen(UNREADABLE, view(distance, heading), grass)


def test_a_ring_alone_that_the_pictures_edge_cuts_off_may_be_anothers() -> None:
    """Where a tag could lie is not in the picture; once it is, the ring is no pad of ours."""
    grass = Optics(background="grass")
    rng = np.random.default_rng(3)
    told = []
    for row in (440.0, 340.0):
        at = look(IDEAL_CAMERA, 6.0, 0.3, pixel=(320.0, row), heading=1.3)
        vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
        image = render(at, IDEAL_CAMERA, grass, rng, BARE)
        seen = [vision.process(Frame(i / 30.0, i, image)) for i in range(5)]
        told.append([s.may_be_another for s in seen if s.pad])
    assert told[0]
    assert all(told[0])
    assert not told[1]


@pytest.mark.parametrize("row", [230.0, 360.0])
def test_a_pad_whose_plate_is_in_the_picture_is_told_from_others_though_its_tag_is_not_read(
    row: float,
) -> None:
    at = look(IDEAL_CAMERA, 6.0, 0.3, pixel=(320.0, row), heading=1.3)
    image = render(
        at, IDEAL_CAMERA, Optics(background="grass"), np.random.default_rng(3), UNREADABLE
    )
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    seen = [vision.process(Frame(i / 30.0, i, image)) for i in range(5)]
    assert [s.may_be_another for s in seen if s.pad] == [False] * 5


SNOW = Plate(north_m=30.0, south_m=30.0, east_m=30.0, west_m=30.0)


@pytest.mark.parametrize(
    ("distance", "heading"), [(10.0, 0.3), (13.0, 2.5), (15.0, 0.3), (15.0, 2.5)]
)
def test_on_ground_as_bright_as_the_plate_the_pad_is_known_by_the_tag_beside_the_ring(
    distance: float, heading: float
) -> None:
    noisy = Optics(noise=4.0)
    for painted, is_pad in ((BARE, False), (UNREADABLE, True)):
        on_snow = painted.model_copy(update={"plate": SNOW})
        assert is_seen(on_snow, view(distance, heading), noisy) is is_pad


@pytest.mark.parametrize("distance", [3.0, 5.0])
def test_on_ground_as_bright_as_the_plate_a_ring_beside_another_code_is_not_the_pad(
    distance: float,
) -> None:
    on_snow = UNREADABLE.model_copy(update={"plate": SNOW})
    assert not is_seen(on_snow, view(distance, 0.3), Optics())


@pytest.mark.parametrize("seed", [3, 11, 16, 18, 22])
def test_a_ring_at_the_pictures_edge_without_white_beside_it_is_not_the_pad(seed: int) -> None:
    rng = np.random.default_rng([9, seed])
    distance = rng.uniform(8.0, 20.0)
    at = look(
        THESIS_CAMERA,
        distance,
        rng.uniform(0.2, 0.6),
        pixel=(rng.uniform(150, 450), 479 - rng.uniform(1.05, 1.3) * 398 * 0.5 / distance),
        tilt_towards=1.57,
        heading=rng.uniform(0.0, 6.28),
    )
    plate = Plate(north_m=0.53, south_m=0.53, east_m=0.53, west_m=0.53)
    narrow = BARE.model_copy(update={"plate": plate})
    for painted, is_pad in ((narrow, False), (THESIS_PAD, True)):
        optics = Optics(background="grass")
        image = render(at, THESIS_CAMERA, optics, np.random.default_rng(5), painted)
        vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
        down = tuple(at.normal.tolist())
        looks = [vision.process(Frame(i / 30.0, i, image), Prior(down=down)) for i in range(5)]
        assert any(bool(seen.pad) for seen in looks) is is_pad


@pytest.mark.parametrize(
    ("distance", "pixel"),
    [(4.6, (25.0, 200.0)), (5.5, (520.0, 471.0)), (9.5, (380.0, 15.0))],
)
def test_a_hoop_that_the_pictures_edge_cuts_is_not_the_pad(
    distance: float, pixel: tuple[float, float]
) -> None:
    """It has bright ground within and about it, of the pad's ratio, and no plate."""

    def hoop(north: F32, east: F32) -> tuple[Mask, Mask]:
        r = np.hypot(north, east) / RING.radius_m
        return r < 1.0, r < RING.inner_ratio

    at = look(THESIS_CAMERA, distance, 0.3, pixel=pixel, tilt_towards=1.0, heading=0.3)
    down = tuple(at.normal.tolist())
    for paint, is_pad in ((hoop, False), (None, True)):
        asphalt = Optics(background="asphalt")
        image = render(at, THESIS_CAMERA, asphalt, np.random.default_rng(5), paint=paint)
        vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
        looks = [vision.process(Frame(i / 30.0, i, image), Prior(down=down)) for i in range(5)]
        assert any(bool(seen.pad) for seen in looks) is is_pad


@pytest.mark.parametrize("margin_m", [0.52, 0.56])
@pytest.mark.parametrize("distance", [6.0, 12.0, 20.0])
def test_a_ring_with_a_margin_too_narrow_to_look_white_is_not_the_pad(
    distance: float, margin_m: float
) -> None:
    plate = Plate(north_m=margin_m, south_m=margin_m, east_m=margin_m, west_m=margin_m)
    narrow = BARE.model_copy(update={"plate": plate})
    blurred = Optics(background="grass", blur_px=1.2)
    assert not is_seen(narrow, view(distance, 0.3), blurred)
    assert is_seen(UNREADABLE, view(distance, 0.3), blurred)


ACROSS = Shadow(0.2, (302.0, 226.0), (math.cos(1.9), math.sin(1.9)))


def is_seen_half_in_shadow(
    painted: PadLayout, distance: float, shadow: Shadow = ACROSS, noise: float = 3.0
) -> bool:
    """Tell whether a picture shows the pad: sunny ground is as bright as white in the shade."""
    at = look(THESIS_CAMERA, distance, 0.4, pixel=(300.0, 230.0), heading=2.5)
    shaded = Optics(background="grass", shadow=shadow, noise=noise)
    image = render(at, THESIS_CAMERA, shaded, np.random.default_rng(2), painted)
    vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    return bool(vision.process(Frame(0.0, 0, image)).pad)


@pytest.mark.parametrize("distance", [12.0, 15.0])
def test_a_shadow_across_the_pad_does_not_hide_its_plate(distance: float) -> None:
    assert is_seen_half_in_shadow(UNREADABLE, distance)
    assert not is_seen_half_in_shadow(BARE, distance)


def test_a_deep_shadow_that_leaves_the_plates_edge_in_the_sun_does_not_hide_its_plate() -> None:
    deep = Shadow(0.1, (298.6, 237.5), (math.cos(5.0), math.sin(5.0)))
    assert is_seen_half_in_shadow(UNREADABLE, 15.0, deep, noise=1.0)
    assert not is_seen_half_in_shadow(BARE, 15.0, deep, noise=1.0)


@pytest.mark.parametrize("distance", [12.0, 15.0])
def test_a_shadow_does_not_hide_the_plate_of_a_pad_whose_tag_is_faded_away(distance: float) -> None:
    faded = PadLayout(name="faded", markers=(RING,), plate=THESIS_PAD.plate)
    assert is_seen_half_in_shadow(faded, distance)


def ring_on_clouds(ground: float, depth: float, size_px: float, margin: float, seed: int) -> U8:
    """Paint a ring, white 140 to `margin` radii, on ground that is bright and dark in patches."""
    soft = cv2.GaussianBlur(
        np.random.default_rng(seed).normal(0.0, depth, (480, 640)), (0, 0), size_px
    )
    picture = np.clip(ground + soft, 0.0, 255.0)
    edge = outline(view(8.0, 0.3), IDEAL_CAMERA, RING)
    middle = edge.mean(axis=0)
    for share, level in ((margin, 140.0), (1.0, 55.0), (RING.inner_ratio, 140.0)):
        ring = np.rint(middle + share * (edge - middle)).astype(np.int32)
        cv2.fillPoly(picture, [ring], level)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.9), dtype=np.uint8)


def is_pad_in(image: U8) -> bool:
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    return any(vision.process(Frame(i / 30.0, i, image)).pad for i in range(5))


@pytest.mark.parametrize("seed", range(4))
def test_a_ring_on_bright_ground_without_any_print_beside_it_is_none(seed: int) -> None:
    """As a tyre in the grass: the ground round it is the only white."""
    assert not is_pad_in(ring_on_clouds(140.0, 60.0, 4.0, 1.0, seed))


@pytest.mark.parametrize(
    ("depth", "size_px", "margin"),
    [(300.0, 8.0, 1.15), (300.0, 8.0, 1.3), (600.0, 12.0, 1.15), (900.0, 16.0, 1.3)],
)
def test_a_tyre_on_patchy_concrete_or_in_leaf_shade_is_not_the_pad(
    depth: float, size_px: float, margin: float
) -> None:
    """Some patch beside it is always brighter than what lies behind, but has no straight edges."""
    seeds = (4, 9)
    assert not any(is_pad_in(ring_on_clouds(118.0, depth, size_px, margin, s)) for s in seeds)


def shown_for(seconds: float) -> Callable[[float, bool], bool]:
    """Return what tells, at a time, whether a ring is seen whose plate was seen for so long."""
    at = view(8.0, 0.3)
    pictures = [
        render(at, IDEAL_CAMERA, Optics(background="grass"), np.random.default_rng(2), pad)
        for pad in (BARE, UNREADABLE)
    ]
    prior = Prior(pad=PadPrior(at.position, sigma_m=0.1, north=None))
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())

    def is_seen_at(t: float, has_plate: bool) -> bool:
        return bool(vision.process(Frame(t, round(30.0 * t), pictures[has_plate]), prior).pad)

    for t in np.arange(-seconds, 0.0, 0.1).tolist():
        assert is_seen_at(t, True)
    return is_seen_at


def test_a_pad_in_track_stays_seen_while_its_plate_is_hidden() -> None:
    """For twice as long as it was seen, at most two thirds of a second: in glare or leaf shade."""
    is_seen_at = shown_for(3.0)
    seen = [is_seen_at(t, False) for t in np.arange(0.0, 2.5, 0.1).tolist()]
    assert seen == sorted(seen, reverse=True)
    assert sum(seen) == pytest.approx(6, abs=1)


def test_a_ring_that_once_seemed_to_have_a_plate_is_not_followed() -> None:
    is_seen_at = shown_for(0.0)
    assert not is_seen_at(0.0, False)
    assert is_seen_at(0.1, True)
    assert [is_seen_at(t, False) for t in (0.2, 0.3, 0.4)] == [True, False, False]


def plate_mask(painted: PadLayout, at: View, size: float = 1.0) -> NDArray[np.bool_]:
    """Return where in a picture a pad's plate is, or that part of it about the landing point."""
    corners = size * plate_corners(painted.plate)
    px = IDEAL_CAMERA.pixels(np.array(at.position) + corners @ at.R_camera_pad[:, :2].T)
    mask = np.zeros((IDEAL_CAMERA.height, IDEAL_CAMERA.width), np.uint8)
    return np.asarray(cv2.fillConvexPoly(mask, np.rint(px).astype(np.int32), 1) == 1)


def test_the_pad_is_seen_on_ground_as_bright_as_its_plate() -> None:
    at = view(8.0, 0.3)
    image = render(at, IDEAL_CAMERA, Optics(), np.random.default_rng(2), UNREADABLE)
    bright = np.maximum(image, 190 + (image % 5))
    assert is_pad_in(np.where(plate_mask(THESIS_PAD, at), image, bright))


def test_on_ground_as_bright_as_its_paper_the_pad_is_known_by_its_tags_print() -> None:
    def is_seen_on_white(painted: PadLayout) -> bool:
        at, rng = view(9.0, 0.3), np.random.default_rng(2)
        image = render(at, IDEAL_CAMERA, Optics(background="plain"), rng, painted)
        pale = np.clip(205.0 + rng.normal(0.0, 4.0, image.shape), 0.0, 255.0).astype(np.uint8)
        return is_pad_in(np.where(plate_mask(painted, at, 0.99), image, pale))

    assert is_seen_on_white(THESIS_PAD)
    assert not is_seen_on_white(BARE)


@pytest.mark.parametrize("distance", [14.0, 15.0])
def test_on_ground_brighter_than_its_board_the_pad_is_known_by_its_tags_print(
    distance: float,
) -> None:
    """As grey board on sand."""

    def is_seen_on_sand(painted: PadLayout) -> bool:
        at, rng = view(distance, 0.3), np.random.default_rng(2)
        board = Optics(background="plain", white=150.0, black=40.0)
        image = render(at, IDEAL_CAMERA, board, rng, painted)
        sand = np.clip(225.0 + rng.normal(0.0, 6.0, image.shape), 0.0, 255.0).astype(np.uint8)
        return is_pad_in(np.where(plate_mask(painted, at, 0.99), image, sand))

    assert is_seen_on_sand(THESIS_PAD)
    assert not is_seen_on_sand(BARE)


@pytest.mark.parametrize("distance", [8.0, 14.0])
def test_the_plate_is_seen_in_fog(distance: float) -> None:
    """It leaves an eighth of all contrast: grass is nearly as bright as the plate."""

    def is_seen_in_fog(painted: PadLayout) -> bool:
        clear = Optics(background="grass", noise=0.0)
        rng = np.random.default_rng(2)
        image = render(view(distance, 0.3), IDEAL_CAMERA, clear, rng, painted)
        foggy = 140.0 + 0.12 * image + rng.normal(0.0, 1.0, image.shape)
        return is_pad_in(np.clip(foggy, 0.0, 255.0).astype(np.uint8))

    assert is_seen_in_fog(UNREADABLE)
    assert not is_seen_in_fog(BARE)


@pytest.mark.parametrize("ground", [0.7, 0.8])
def test_the_pad_is_seen_out_of_focus_on_ground_nearly_as_bright(ground: float) -> None:
    """As a small camera on a roof: blur leaves but a part of a step that is small already."""

    def is_seen_unsharp(painted: PadLayout) -> bool:
        at, rng = view(12.0, 0.3), np.random.default_rng(2)
        image = render(at, IDEAL_CAMERA, Optics(background="plain"), rng, painted)
        roof = 195.0 * ground + cv2.GaussianBlur(rng.normal(0.0, 60.0, image.shape), (0, 0), 4.0)
        shown = np.where(plate_mask(painted, at), image, roof)
        unsharp = cv2.GaussianBlur(shown, (0, 0), 2.1) + rng.normal(0.0, 2.0, image.shape)
        return is_pad_in(np.clip(unsharp, 0.0, 255.0).astype(np.uint8))

    assert is_seen_unsharp(THESIS_PAD)
    assert not is_seen_unsharp(BARE)


@pytest.mark.parametrize("distance", [10.0, 14.0])
def test_in_an_overexposed_picture_the_pad_is_known_by_what_is_left_of_its_tag(
    distance: float,
) -> None:
    """White and ground are over full scale, as are the white cells of the tag's."""

    def is_seen_blown_out(painted: PadLayout) -> bool:
        at, soft = view(distance, 0.3), Optics(background="plain")
        image = render(at, IDEAL_CAMERA, soft, np.random.default_rng(2), painted)
        blown = np.clip(4.0 * image, 0.0, 255.0).astype(np.uint8)
        vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
        return any(vision.process(Frame(i / 30.0, i, blown)).pad for i in range(5))

    assert is_seen_blown_out(UNREADABLE)
    assert not is_seen_blown_out(BARE)


def test_in_an_overexposed_picture_a_pad_whose_tag_is_out_of_it_is_seen() -> None:
    """Its plate's edge is as white as the ground: nothing says that it lacks one."""
    at = look(THESIS_CAMERA, 2.2, 0.4, pixel=(160.0, 80.0), heading=4.5)
    soft = Optics(background="plain")
    image = render(at, THESIS_CAMERA, soft, np.random.default_rng(2), THESIS_PAD)
    blown = np.clip(4.0 * image, 0.0, 255.0).astype(np.uint8)
    vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    assert any(vision.process(Frame(i / 30.0, i, blown)).pad for i in range(5))


def test_the_pad_is_seen_behind_a_nearer_ring_that_is_another_s() -> None:
    rng, grass = np.random.default_rng(2), Optics(background="grass")
    far = look(IDEAL_CAMERA, 9.0, 0.4, pixel=(150.0, 230.0), tilt_towards=1.0, heading=0.3)
    near = look(IDEAL_CAMERA, 6.0, 0.4, pixel=(480.0, 230.0), tilt_towards=1.0, heading=0.3)
    image = render(far, IDEAL_CAMERA, grass, rng, UNREADABLE)
    image[:, 320:] = render(near, IDEAL_CAMERA, grass, rng, BARE)[:, 320:]
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    sights = [vision.process(Frame(i / 30.0, i, image)) for i in range(4)]
    seen = [s.pad[0] for s in sights if s.pad]
    assert seen
    assert all(math.dist(p.position, far.position) < 0.3 for p in seen)


def test_while_a_leg_hides_the_pad_that_is_known_another_s_ring_is_not_taken_for_it() -> None:
    """Once, with the heading known, a tyre 10 m off was followed and descended to."""
    at = look(IDEAL_CAMERA, 6.0, 0.4, pixel=(150.0, 230.0), tilt_towards=1.0, heading=0.3)
    tyre = look(IDEAL_CAMERA, 9.0, 0.4, pixel=(480.0, 230.0), tilt_towards=1.0, heading=0.3)
    rng = np.random.default_rng(2)
    image = render(at, IDEAL_CAMERA, Optics(), rng, THESIS_PAD)
    image[:, 320:] = render(tyre, IDEAL_CAMERA, Optics(), rng, BARE)[:, 320:]
    hidden = image.copy()
    hidden[:, :320] = 30
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    seen = [vision.process(Frame(i / 30.0, i, image)) for i in range(5)][-1].pad[0]
    assert seen.north is not None
    prior = Prior(pad=PadPrior(seen.position, 0.05, normal=seen.normal, north=seen.north))
    for i in range(5, 15):
        assert not vision.process(Frame(i / 30.0, i, hidden), prior).pad


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0])
def test_a_shadow_over_a_part_of_the_pad_is_no_reason_to_refuse_its_ring(turn: float) -> None:
    at = view(6.0, 0.3)
    edge = Shadow(0.25, (305.0, 235.0), (math.cos(turn), math.sin(turn)))
    assert is_seen(UNREADABLE, at, replace(Optics(), shadow=edge))


@pytest.mark.parametrize(("distance", "heading"), [(6.0, 1.3), (10.0, 2.5), (13.0, 2.5)])
def test_a_shadow_over_most_of_the_plate_is_no_reason_to_refuse_its_ring(
    distance: float, heading: float
) -> None:
    at = look(THESIS_CAMERA, distance, 0.4, pixel=(300.0, 230.0), heading=heading)
    to_tag = np.array(at.R_camera_pad)[:, :2] @ THESIS_PAD.squares[0].position_m
    ring, tag = THESIS_CAMERA.pixels(np.array([at.position, at.position + to_tag]))
    way = (tag - ring) / np.linalg.norm(tag - ring)
    beyond_its_middle = ring + 0.4 * RING.radius_m * THESIS_CAMERA.fx / distance * way
    edge = Shadow(0.2, tuple(beyond_its_middle), tuple(way))
    shaded = Optics(background="grass", shadow=edge)
    image = render(at, THESIS_CAMERA, shaded, np.random.default_rng(2), UNREADABLE)
    vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    assert any(vision.process(Frame(i / 30.0, i, image)).pad for i in range(5))


def test_a_pad_of_one_ring_is_seen_by_its_ring() -> None:
    at = view(5.0, 0.3)
    image = render(at, IDEAL_CAMERA, Optics(), np.random.default_rng(2), BARE)
    assert Vision(BARE, IDEAL_CAMERA, VisionSection()).process(Frame(0.0, 0, image)).pad


def tag(half_side_m: float) -> PadLayout:
    """An ArUco tag of somebody else's on its own plate; blurred, its only white cell is a disc."""
    m = half_side_m
    return PadLayout(
        name="foreign",
        markers=(Square(kind="aruco", dictionary="4X4_50", id=17, size_m=0.5),),
        plate=Plate(north_m=m, south_m=m, east_m=m, west_m=m),
    )


@pytest.mark.parametrize(("half_side_m", "distance"), [(0.42, 11.0), (0.36, 11.0)])
def test_a_blurred_tag_on_a_plate_of_its_own_is_not_the_pad(
    half_side_m: float, distance: float
) -> None:
    blurred = Optics(background="grass", blur_px=2.0)
    assert not is_seen(tag(half_side_m), view(distance, 0.0), blurred)


def lacks_plate(image: U8, distance: float) -> bool:
    """Tell whether a level ring at (299.9, 227.5) px is refused for lack of its plate."""
    ring = THESIS_PAD.rings[0]
    at = look(IDEAL_CAMERA, distance, 0.0, pixel=(299.9, 227.5))
    solution = PoseSolution(at.position, (0.0, 0.0, 1.0), None, ((0.0,) * 3,) * 3, None, 0.1, 1.0)
    seen = MarkerSighting("whycon", None, (solution,), ())
    headings = {ring: PlateHeading(THESIS_PAD, ring)}
    return PlateCheck(IDEAL_CAMERA, THESIS_PAD, headings).contradicts(image, ring, seen)


def test_a_ring_with_equal_white_on_four_sides_is_not_the_pad() -> None:
    """As the corners of a small square plate, blurred, stand out beyond a tag's black frame."""
    ring = THESIS_PAD.rings[0]
    distance = 15.0
    radius = IDEAL_CAMERA.fx * ring.radius_m / distance
    y, x = np.mgrid[:480, :640] - np.array([227.5, 299.9])[:, None, None]
    away = np.hypot(x, y) / radius
    is_black = (away < 1.0) & (away > ring.inner_ratio)
    corners = [math.pi * (0.25 + 0.5 * k) for k in range(4)]
    white = sum(
        np.exp(
            -((x / radius - 1.65 * math.cos(a)) ** 2 + (y / radius - 1.65 * math.sin(a)) ** 2) / 0.3
        )
        for a in corners
    )
    image = 95.0 + 100.0 * np.clip(white + (away < ring.inner_ratio), 0.0, 1.0) - 15.0 * is_black
    blurred = cv2.GaussianBlur(image, (0, 0), 1.5).astype(np.uint8)
    assert lacks_plate(blurred, distance)


def target(away: NDArray[np.float64], radii: Sequence[float]) -> NDArray[np.float64]:
    """Return white and black discs, largest first, on grey; away: distances from their centre."""
    image = np.full(away.shape, 80.0)
    for i, radius in enumerate(radii):
        image[away < radius] = (235.0, 45.0)[i % 2]
    return image


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 5])
def test_the_middle_of_a_target_of_white_and_black_rings_is_not_the_pad(seed: int) -> None:
    ring = THESIS_PAD.rings[0]
    y, x = np.mgrid[:480, :640]
    away = np.hypot(x - 350.0, (y - 200.3) / 0.7) / 6.0
    image = target(away, (1.9, 1.72, 1.35, 1.0, ring.inner_ratio))
    noise = np.random.default_rng(seed).normal(0.0, 3.0, image.shape)
    seen = np.clip(cv2.GaussianBlur(image, (0, 0), 0.9) + noise, 0.0, 255.0).astype(np.uint8)
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    assert not any(vision.process(Frame(i / 30.0, i, seen)).pad for i in range(5))


def test_round_a_ring_in_a_target_the_plate_stands_out_at_no_heading() -> None:
    ring, distance = THESIS_PAD.rings[0], 20.0
    y, x = np.mgrid[:480, :640]
    away = np.hypot(x - 299.9, y - 227.5) / (IDEAL_CAMERA.fx * ring.radius_m / distance)
    image = target(away, (2.1, 1.6, 1.3, 1.0, ring.inner_ratio))
    blurred = cv2.GaussianBlur(image, (0, 0), 0.9).astype(np.uint8)
    assert lacks_plate(blurred, distance)


def test_a_ring_alone_tells_the_pad_after_its_tag_was_seen_a_little_out_of_place() -> None:
    """What was learned of how the markers lie to one another must not lose a ring by itself."""
    at, grass = view(2.5, 0.3), Optics(background="grass")
    moved = tuple(
        m.model_copy(update={"position_m": (0.757, 0.004)}) if isinstance(m, Square) else m
        for m in THESIS_PAD.markers
    )
    printed = THESIS_PAD.model_copy(update={"markers": moved})
    rng = np.random.default_rng(2)
    both, ring = (render(at, IDEAL_CAMERA, grass, rng, pad) for pad in (printed, UNREADABLE))
    vision = Vision(THESIS_PAD, IDEAL_CAMERA, VisionSection())
    assert all(vision.process(Frame(0.1 * i, i, both)).pad for i in range(10))
    unturned = Prior(pad=PadPrior(at.position, sigma_m=0.1, north=None))
    assert vision.process(Frame(4.0, 40, ring), unturned).pad


def in_leaf_shade(seed: int) -> tuple[View, U8]:
    """Return a view of a pad, 11 m away, and its picture: shade as fine as the ring's stroke."""
    rng = np.random.default_rng([5, seed])
    at = random_view(rng, THESIS_CAMERA, 11.0, rng.uniform(0.17, 0.7), RING)
    assert at is not None
    optics = Optics(background="asphalt", black=50.0, blur_px=0.9)
    image = render(at, THESIS_CAMERA, optics, rng)
    leaves = rng.uniform(size=(161, 214)).astype(np.float32)
    sunny = cv2.resize(leaves, image.shape[::-1], interpolation=cv2.INTER_CUBIC) > 0.5
    light = cv2.GaussianBlur(np.where(sunny, 1.0, 0.45), (0, 0), 0.7)
    return at, np.clip(image * light, 0, 255).astype(np.uint8)


def test_in_fine_leaf_shade_the_plate_vouches_for_a_ring_whose_edges_are_broken() -> None:
    for seed in (4, 9, 23):
        at, image = in_leaf_shade(seed)
        assert find_rings(image, RING, THESIS_CAMERA) == []
        vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
        # A thorough search takes two pictures, in texture four.
        looks = (vision.process(Frame(k / 30, k, image)) for k in range(4))
        seen = next(look for look in looks if look.pad)
        assert math.dist(seen.pad[0].position, at.position) < 0.2


def round_thing(radius_px: float, hole: float = 175.0, plate: float = 0.0) -> U8:
    """Draw what is round and dark with a bright middle, on a plate so bright or on the ground."""
    y, x = np.mgrid[:480, :640] - np.array([228.2, 300.3])[:, None, None]
    away, aside = np.hypot(x, y) / radius_px, np.maximum(abs(x), abs(y)) / radius_px
    ground = np.where(aside < 1.24, plate, 125.0) if plate else 175.0
    image = np.where(away < 1.0, np.where(away < RING.inner_ratio, hole, 80.0), ground)
    noise = np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.9) + noise, 0, 255).astype(np.uint8)


def is_taken(image: U8) -> bool:
    vision = Vision(BARE, IDEAL_CAMERA, VisionSection())
    level = Prior(down=(0.0, 0.0, 1.0))
    return any(vision.process(Frame(i / 30.0, i, image), level).pad for i in range(8))


@pytest.mark.parametrize("radius_px", [7.0, 9.0, 12.0])
def test_a_small_ring_without_the_plate_is_not_taken_for_a_pad_of_one_ring(
    radius_px: float,
) -> None:
    assert is_taken(round_thing(radius_px, plate=175.0))
    assert not is_taken(round_thing(radius_px))


def test_a_larger_ring_is_taken_on_ground_as_bright_as_its_plate() -> None:
    assert is_taken(round_thing(18.0))


@pytest.mark.parametrize("radius_px", [10.0, 13.0, 17.0])
def test_a_wheel_with_a_hub_darker_than_its_surroundings_is_not_the_pad(radius_px: float) -> None:
    """Something in the hub shines."""
    wheel = round_thing(radius_px, hole=110.0, plate=175.0)
    hub_px = radius_px * RING.inner_ratio
    shining = np.zeros(wheel.shape)
    at = round(16.0 * (300.3 + 0.4 * hub_px)), round(16.0 * 228.2)
    cv2.circle(shining, at, round(16.0 * 0.45 * hub_px), 65.0, cv2.FILLED, cv2.LINE_AA, 4)
    image = wheel + cv2.GaussianBlur(shining, (0, 0), 0.7)
    assert not is_taken(np.clip(image, 0, 255).astype(np.uint8))
