import math
from dataclasses import replace
from itertools import islice

import cv2
import numpy as np
import pytest

from landerd.camera_model import Window
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Plate, Ring
from landerd.vision.ring_pose import cone_of_pose, cone_through, mirrored, poses_of_cone
from landerd.vision.whycon import find_rings
from tests.vision import scenes

RING = scenes.THESIS_PAD.rings[0]
CAMERA = scenes.THESIS_CAMERA
CHI2_99 = 11.345  # three degrees of freedom


def look(distance: float, tilt_deg: float, pixel: tuple[float, float] = (330, 250)) -> scenes.View:
    return scenes.look(
        CAMERA, distance, math.radians(tilt_deg), pixel=pixel, tilt_towards=0.7, heading=0.4
    )


def shot(view: scenes.View | None, optics: scenes.Optics | None = None, seed: int = 1) -> scenes.U8:
    return scenes.render(view, CAMERA, optics or scenes.Optics(), np.random.default_rng(seed))


def error_m(sighting: MarkerSighting, view: scenes.View) -> float:
    return math.dist(sighting.solutions[0].position, view.position)


# ---- pose of a circle ---------------------------------------------------------------------------


def test_both_poses_of_a_cone_show_the_same_ellipse_and_one_is_the_circle() -> None:
    position, normal = np.array([0.6, -0.3, 4.0]), np.array([0.3, 0.4, 0.866])
    normal /= np.linalg.norm(normal)
    cone = cone_of_pose(position, normal, 0.5)
    poses = poses_of_cone(cone, 0.5)
    assert poses is not None
    assert min(np.abs(p - position).max() for p, _ in poses) < 1e-9
    for p, n in poses:
        again = cone_of_pose(p, n, 0.5)
        assert np.allclose(again / again[2, 2], cone / cone[2, 2], atol=1e-9)
    other = mirrored(position, normal, 0.5)
    assert other is not None
    assert other[1] @ normal < 0.9


def test_cone_through_points_on_a_circle_is_its_cone_of_sight() -> None:
    position, normal = np.array([0.2, 0.1, 3.0]), np.array([0.0, 0.6, 0.8])
    a = np.linspace(0, 2 * math.pi, 16, endpoint=False)[:, None]
    points = position + 0.5 * (np.cos(a) * [1, 0, 0] + np.sin(a) * [0, 0.8, -0.6])
    cone = cone_through(points[:, :2] / points[:, 2:])
    assert cone is not None
    true = cone_of_pose(position, normal, 0.5)
    assert np.allclose(cone / cone[2, 2], true / true[2, 2], atol=1e-6)


def test_an_ellipsoid_of_no_sight_has_no_pose() -> None:
    assert poses_of_cone(np.eye(3), 0.5) is None


# ---- rings in images ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distance", "tilt_deg", "limit_m"),
    # Three times the Cramér-Rao bound of the view (facts, section 5), never less than 1 mm.
    [
        (1.2, 20, 0.001),
        (3, 60, 0.001),
        (5, 45, 0.0015),
        (10, 0, 0.005),
        (10, 60, 0.010),
        (20, 30, 0.04),
        (25, 45, 0.09),
    ],
)
def test_single_frame_finds_the_ring_within_three_bounds(
    distance: float, tilt_deg: float, limit_m: float
) -> None:
    view = look(distance, tilt_deg)
    errors = []
    for seed in range(3):
        found = find_rings(shot(view, seed=seed), RING, CAMERA)
        assert len(found) == 1
        assert found[0].kind == "whycon"
        errors.append(error_m(found[0], view))
    assert float(np.median(errors)) < limit_m


@pytest.mark.parametrize("tilt_deg", [45, 60, 70])
def test_a_near_tilted_ring_is_placed_within_a_millimetre(tilt_deg: float) -> None:
    view = look(1.0, tilt_deg)
    found = find_rings(shot(view), RING, CAMERA)
    assert len(found) == 1
    assert error_m(found[0], view) < 0.001


def test_both_solutions_are_given_while_both_may_be_and_the_true_normal_is_first() -> None:
    assert len(find_rings(shot(look(6.0, 45)), RING, CAMERA)[0].solutions) == 1
    view = look(20.0, 45)
    solutions = find_rings(shot(view), RING, CAMERA)[0].solutions
    assert len(solutions) == 2
    assert solutions[0].cost < solutions[1].cost
    angle = math.acos(min(1.0, float(np.array(solutions[0].normal) @ view.normal)))
    assert math.degrees(angle) < 1.0
    assert float(np.array(solutions[1].normal) @ view.normal) < math.cos(math.radians(20))
    assert solutions[0].north is None
    assert solutions[0].sigma_yaw is None


def test_gravity_orders_poses_that_the_image_cannot_tell_apart() -> None:
    view = look(38.0, 35)
    image = shot(view)
    n = view.normal
    found = find_rings(image, RING, CAMERA, down=(float(n[0]), float(n[1]), float(n[2])))
    assert float(np.array(found[0].solutions[0].normal) @ n) > math.cos(math.radians(20))


def test_a_window_gives_what_the_whole_image_gives() -> None:
    view = look(12.0, 30, (420.0, 160.0))
    image = shot(view)
    whole = find_rings(image, RING, CAMERA)[0]
    size = CAMERA.fx / 12.0
    window = Window(420 - 40, 160 - 40, 420 + 40, 160 + 40)
    near = find_rings(image, RING, CAMERA, window=window, expected_diameter_px=size)[0]
    a, b = whole.solutions[0], near.solutions[0]
    apart = np.array(a.position) - np.array(b.position)
    assert apart @ np.linalg.solve(np.array(a.covariance) + np.array(b.covariance), apart) < 11.3
    elsewhere = Window(100, 200, 200, 300)
    assert find_rings(image, RING, CAMERA, window=elsewhere) == []


@pytest.mark.parametrize(
    "window", [Window(0, 0, 0, 0), Window(-50, -50, 3, 3), Window(630, 470, 900, 900)]
)
def test_windows_at_the_rim_are_searched_without_error(window: Window) -> None:
    assert find_rings(shot(look(8.0, 20)), RING, CAMERA, window=window) == []


def test_sigma_covers_the_error() -> None:
    inside = 0
    rng = np.random.default_rng(5)
    for seed in range(30):
        view = scenes.random_view(rng, CAMERA, rng.uniform(6, 20), rng.uniform(0, 1), RING)
        assert view is not None
        best = find_rings(shot(view, scenes.random_optics(rng), seed), RING, CAMERA)[0].solutions[0]
        off = np.array(best.position) - view.position
        inside += float(off @ np.linalg.solve(np.array(best.covariance), off)) < 7.815
    assert inside >= 25  # 95 % expected; fewer than 25 of 30 happen once in 500


def test_a_ring_with_a_shadows_edge_across_it_is_found() -> None:
    view = look(8.0, 30, (320.0, 240.0))
    shadow = scenes.Shadow(0.4, (324.0, 240.0), (0.8, 0.6))
    found = find_rings(shot(view, scenes.Optics(shadow=shadow)), RING, CAMERA)
    assert len(found) == 1
    assert error_m(found[0], view) < 0.02


@pytest.mark.parametrize(("distance", "most_m"), [(5.0, 0.03), (9.0, 0.03), (13.0, 0.035)])
def test_a_ring_half_in_a_shadow_whose_white_is_darker_than_sunlit_black_is_found(
    distance: float, most_m: float
) -> None:
    view = look(distance, 30, (320.0, 240.0))
    shadow = scenes.Shadow(0.1, (300.0, 240.0), (0.8, 0.6))
    image = shot(view, scenes.Optics(shadow=shadow, noise=0.8, background="grass"))
    found = find_rings(image, RING, CAMERA)
    assert len(found) == 1
    assert error_m(found[0], view) < most_m


def test_a_ring_blurred_by_ten_pixels_of_motion_is_found() -> None:
    view = look(10.0, 30)
    found = find_rings(shot(view, scenes.Optics(motion_px=(8.0, 6.0))), RING, CAMERA)
    assert len(found) == 1
    assert error_m(found[0], view) < 0.05


@pytest.mark.parametrize("level", [15.0, 230.0])
def test_a_ring_with_a_thin_leg_across_it_is_found(level: float) -> None:
    view = look(4.0, 20, (320.0, 240.0))
    bar = scenes.Bar((345.0, 240.0), (0.3, 1.0), 4.0, level)
    found = find_rings(shot(view, scenes.Optics(bar=bar)), RING, CAMERA)
    assert len(found) == 1
    assert error_m(found[0], view) < 0.02


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize(
    ("blur_px", "tilt_deg", "distance"), [(2.0, 50.0, 20.0), (2.0, 60.0, 14.0), (2.4, 60.0, 14.0)]
)
def test_a_small_oblique_blurred_ring_is_found(
    blur_px: float, tilt_deg: float, distance: float, number: int
) -> None:
    view = look(distance, tilt_deg, (320.0 + 7 * number, 240.0 - 5 * number))
    optics = scenes.Optics(
        blur_px=blur_px, black=60.0, white=180.0, noise=1.5, background="asphalt"
    )
    found = find_rings(shot(view, optics, number), RING, CAMERA)
    assert len(found) == 1
    assert error_m(found[0], view) < 0.1 * distance


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("distance", [12.0, 15.0])
def test_a_small_ring_with_glare_on_a_part_of_it_is_found(distance: float, seed: int) -> None:
    view = look(distance, 25, (320.0, 240.0))
    optics = scenes.Optics(white=120.0, black=55.0, noise=0.0, blur_px=1.2, background="grass")
    edge = scenes.outline(view, CAMERA, RING)
    middle = edge.mean(axis=0)
    wedge = [middle, *(middle + 1.05 * (edge[20 * seed : 20 * seed + 8] - middle))]  # 45 degrees
    spot = np.zeros((480, 640))
    cv2.fillPoly(spot, [np.rint(np.array(wedge)).astype(np.int32)], 1.0)
    image = shot(view, optics).astype(np.float64)
    light = np.asarray(cv2.GaussianBlur(spot, (0, 0), 1.5))
    glaring = image + light * np.maximum(120.0 - image, 0.0)
    noisy = np.random.default_rng(seed).normal(glaring, 14.0)
    found = find_rings(np.clip(noisy, 0.0, 255.0).astype(np.uint8), RING, CAMERA)
    assert len(found) == 1
    assert error_m(found[0], view) < 0.1 * distance


def test_a_ring_that_dirt_joins_to_dark_ground_is_found() -> None:
    view = look(9.0, 20, (320.0, 300.0))
    image = shot(view, scenes.Optics(black=65.0, background="asphalt"))
    edge = scenes.outline(view, CAMERA, RING)
    middle = edge.mean(axis=0)
    for at in edge[5::30]:
        ends = [np.rint(middle + k * (at - middle)).astype(int).tolist() for k in (0.95, 1.7)]
        cv2.line(image, ends[0], ends[1], 75, 7, cv2.LINE_AA)
    found = find_rings(image, RING, CAMERA)
    assert len(found) == 1
    assert error_m(found[0], view) < 0.2


def test_nothing_is_found_where_nothing_is() -> None:
    rng = np.random.default_rng(3)
    for background in ("fractal", "grass", "asphalt", "plain"):
        image = scenes.render(None, CAMERA, scenes.Optics(background=background), rng)
        assert find_rings(image, RING, CAMERA) == []


def test_discs_squares_and_rings_of_another_ratio_are_not_taken() -> None:
    made = scenes.hard_negatives(np.random.default_rng(8), CAMERA, RING.inner_ratio)
    assert sum(len(find_rings(next(made)[1], RING, CAMERA)) for _ in range(40)) == 0


@pytest.mark.parametrize(("seed", "before"), [(23, 2), (34, 4), (42, 7), (57, 4), (98, 4)])
def test_a_ring_of_another_ratio_is_not_taken_for_one_behind_a_tone_curve(
    seed: int, before: int
) -> None:
    made = scenes.hard_negatives(np.random.default_rng([seed, 7]), CAMERA, RING.inner_ratio)
    what, image = next(islice(made, before, None))
    assert what == "ring"
    assert find_rings(image, RING, CAMERA) == []


@pytest.mark.parametrize("stroke", [0.16, 0.2, 0.24])
@pytest.mark.parametrize("size_px", [28, 32])
def test_a_letter_o_in_a_drawing_is_too_black_to_be_overexposed(
    size_px: int, stroke: float
) -> None:
    k = 8  # drawn k times too large
    page = np.full((CAMERA.height * k, CAMERA.width * k), 255, np.uint8)
    for share, grey in ((0.5, 0), (0.5 - stroke, 255)):
        cv2.circle(page, (300 * k + 3, 200 * k + 5), round(share * size_px * k), grey, -1)
    image = cv2.resize(page, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_AREA)
    assert find_rings(image.astype(np.uint8), RING, CAMERA) == []


@pytest.mark.parametrize(("level", "found"), [(0.4, 0), (0.8, 1)])
def test_a_hole_that_is_not_as_white_as_its_surroundings_is_the_hub_of_a_wheel(
    level: float, found: int
) -> None:
    view = look(10.0, 20)
    image = shot(view)
    hole = RING.model_copy(update={"outer_diameter_m": RING.outer_diameter_m * RING.inner_ratio})
    within = cv2.fillPoly(
        np.zeros_like(image), [scenes.outline(view, CAMERA, hole).round().astype(np.int32)], 255
    )
    black = float(np.median(image[cv2.dilate(within, np.ones((9, 9), np.uint8)) > within]))
    dim = np.where(within > 0, black + level * np.maximum(image - black, 0.0), image)
    assert len(find_rings(dim.astype(np.uint8), RING, CAMERA)) == found


def test_the_ratio_asked_for_is_found() -> None:
    thin = Ring(kind="whycon", outer_diameter_m=1.0, inner_ratio=0.6)
    plate = Plate(north_m=0.7, south_m=0.7, east_m=0.7, west_m=0.7)
    layout = PadLayout(name="thin", markers=(thin,), plate=plate)
    view = look(6.0, 20)
    image = scenes.render(view, CAMERA, scenes.Optics(), np.random.default_rng(1), layout)
    assert len(find_rings(image, thin, CAMERA)) == 1
    assert find_rings(image, RING, CAMERA) == []


def test_a_ring_seen_flat_in_uneven_light_is_known_by_its_grey_levels() -> None:
    """Once, its edges told, which blur moves at the ends of a flat ellipse: a hundredth short."""
    rng, errors, inside = np.random.default_rng([6, 15, 70]), [], 0
    for _ in range(12):
        view = scenes.random_view(rng, CAMERA, 15.0, math.radians(70.0), RING)
        assert view is not None
        image = scenes.render(view, CAMERA, scenes.random_optics(rng), rng)
        (sighting,) = find_rings(image, RING, CAMERA)
        pose = sighting.solutions[0]
        error = np.array(pose.position) - view.position
        errors.append(float(np.linalg.norm(error)))
        inside += bool(error @ np.linalg.solve(np.array(pose.covariance), error) < CHI2_99)
    assert float(np.median(errors)) < 0.003 * 15.0
    assert inside >= 11


def test_larger_images_give_a_finer_position() -> None:
    camera = CAMERA.scaled(1280, 960)
    view = scenes.look(camera, 20.0, 0.4, pixel=(700.0, 500.0), tilt_towards=1.0)
    image = scenes.render(view, camera, scenes.Optics(), np.random.default_rng(2))
    found = find_rings(image, RING, camera)
    assert len(found) == 1
    assert error_m(found[0], view) < 0.02


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_flat_images_are_searched_without_error(grey: int) -> None:
    image = np.full((480, 640), grey, np.uint8)
    assert find_rings(image, RING, CAMERA) == []


def test_a_ring_without_distortion_is_not_where_one_with_it_is() -> None:
    view = look(5.0, 10, (560.0, 400.0))
    image = shot(view)
    right = find_rings(image, RING, CAMERA)[0]
    wrong = find_rings(image, RING, replace(CAMERA, distortion=()))
    assert error_m(right, view) < 0.005
    assert all(error_m(s, view) > 0.02 for s in wrong)


def test_a_large_image_of_noise_is_searched_and_holds_nothing() -> None:
    camera = CAMERA.scaled(1920, 1440)
    noise = np.random.default_rng(0).integers(0, 255, (1440, 1920)).astype(np.uint8)
    assert find_rings(noise, RING, camera) == []
