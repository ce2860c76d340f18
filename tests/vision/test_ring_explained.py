"""Rings as tone curves, clipped white and foreign things leave them."""

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.pad import PadLayout, Ring
from landerd.vision.ring_explained import edge_fits
from landerd.vision.ring_response import CameraResponse
from landerd.vision.whycon import find_rings, track_ring
from tests.vision import scenes

U8 = NDArray[np.uint8]
CAMERA = scenes.IDEAL_CAMERA
RING = scenes.THESIS_PAD.rings[0]
CHI2_99, CHI2_999 = 11.345, 16.266  # three degrees of freedom
WHITE = 220.0


def seen(distance: float, tilt_deg: float) -> scenes.View:
    return scenes.look(
        CAMERA, distance, math.radians(tilt_deg), pixel=(300.0, 250.0), tilt_towards=1.0
    )


def light(
    view: scenes.View,
    bar: scenes.Bar | None = None,
    blur_px: float = 0.6,
    layout: PadLayout = scenes.THESIS_PAD,
    motion_px: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.float64]:
    """Return the light of a view (height, width), white paper 1, all but noiseless."""
    optics = scenes.Optics(
        white=WHITE, black=0.12 * WHITE, noise=0.0, bar=bar, blur_px=blur_px, motion_px=motion_px
    )
    image = scenes.render(view, CAMERA, optics, np.random.default_rng(2), layout)
    return image / WHITE


def picture(level: NDArray[np.float64], noise: float = 3.0, seed: int = 3) -> U8:
    rng = np.random.default_rng(seed)
    return np.clip(
        np.rint(255.0 * np.clip(level, 0.0, 1.0) + rng.normal(0.0, noise, level.shape)), 0, 255
    ).astype(np.uint8)


def check(image: U8, view: scenes.View, share: float, ring: Ring = RING) -> str:
    """Ask for one ring within a share of the range and within its sigma; return its stage."""
    found = find_rings(image, ring, CAMERA)
    assert len(found) == 1
    pose = found[0].solutions[0]
    error = np.array(pose.position) - view.position
    assert float(np.linalg.norm(error)) < share * float(np.linalg.norm(view.position))
    assert float(error @ np.linalg.solve(np.array(pose.covariance), error)) < CHI2_99
    return found[0].stage


def test_an_outline_through_which_no_ring_can_be_seen_shows_none() -> None:
    image = picture(light(seen(4.0, 25.0)))
    assert edge_fits(image, CAMERA, RING, []) == []


@pytest.mark.parametrize(("over", "gamma"), [(2.5, 1.0), (1.6, 2.2)])
@pytest.mark.parametrize("distance", [2.0, 4.0, 7.0, 10.0])
def test_a_moving_ring_in_blown_out_white_is_seen(
    distance: float, over: float, gamma: float
) -> None:
    """White that moves hides more of the black than it uncovers: across its way edges shrink."""
    view = seen(distance, 25.0)
    moved = light(view, motion_px=(5.0, 5.5))
    level = np.clip(over * moved, 0.0, 1.0) ** (1.0 / gamma)
    assert check(picture(level), view, 0.015) == "edges"


@pytest.mark.parametrize("distance", [8.0, 11.0])
@pytest.mark.parametrize("over", [2.5, 4.0])
def test_a_still_oblique_ring_of_another_ratio_in_blown_out_white_is_none_of_ours(
    over: float, distance: float
) -> None:
    """A motion would explain its edges as well as the other ratio does."""
    for ratio in (0.56, 0.6):
        layout = PadLayout(
            name="other",
            markers=(Ring(kind="whycon", outer_diameter_m=1.0, inner_ratio=ratio),),
            plate=scenes.THESIS_PAD.plate,
        )
        for tilt_deg in (45.0, 55.0):
            image = picture(over * light(seen(distance, tilt_deg), layout=layout))
            assert not find_rings(image, RING, CAMERA)


@pytest.mark.parametrize("distance", [2.0, 7.0, 10.0, 15.0])
def test_a_ring_behind_gamma_and_jpeg_is_seen(distance: float) -> None:
    view = seen(distance, 25.0)
    image = picture((0.85 * light(view)) ** (1.0 / 2.2))
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1]
    assert check(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), view, 0.003) == "grey"  # type: ignore[arg-type]


@pytest.mark.parametrize("ratio", [0.2, 0.8, 0.86])
@pytest.mark.parametrize("distance", [2.0, 5.0, 9.0])
def test_a_ring_of_any_stroke_behind_gamma_is_seen(ratio: float, distance: float) -> None:
    ring = RING.model_copy(update={"inner_ratio": ratio})
    view = seen(distance, 20.0)
    levels = light(view, layout=scenes.alone(ring))
    assert check(picture((0.85 * levels) ** (1.0 / 2.2)), view, 0.003, ring) == "grey"


@pytest.mark.parametrize("distance", [3.0, 4.0, 6.0])
def test_a_highlight_in_the_hole_of_a_glossy_ring_moves_its_inner_edge_and_sigma_says_so(
    distance: float,
) -> None:
    """It adds to black and white alike and fades within the stroke: the range is 1 % short."""
    view = seen(distance, 15.0)
    y, x = np.mgrid[:480, :640]
    reach = 0.6 * CAMERA.focal * RING.radius_m / distance
    spot = np.exp(-((x - 300.0) ** 2 + (y - 250.0) ** 2) / reach**2)
    level = np.clip(0.75 * light(view) + 0.7 * spot, 0.0, 1.0)
    assert check(picture(level ** (1.0 / 2.2)), view, 0.015) == "edges"


@pytest.mark.parametrize("seed", [8, 13, 20, 29])
def test_behind_a_tone_curve_the_mirrored_pose_is_judged_by_the_same_response(seed: int) -> None:
    view = scenes.look(CAMERA, 17.0, math.radians(18.0), pixel=(314.0, 244.0), tilt_towards=2.0)
    noise = np.random.default_rng(seed).normal(0.0, 0.01, (480, 640))
    level = np.clip(0.78 * light(view, blur_px=0.8) + noise, 0.003, 1.0)
    image = picture(1.055 * level ** (1.0 / 2.4) - 0.055, noise=0.0)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 84])[1]
    found = find_rings(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), RING, CAMERA)  # type: ignore[arg-type]
    assert np.dot(found[0].solutions[0].normal, view.normal) > math.cos(math.radians(5.0))


@pytest.mark.parametrize("distance", [1.8, 2.2, 4.5, 9.0])
def test_a_ring_with_a_thin_stroke_is_seen_at_any_size(distance: float) -> None:
    ring = RING.model_copy(update={"inner_ratio": 0.89})
    camera = CAMERA.scaled(1280, 960)
    view = scenes.look(camera, distance, math.radians(20.0), pixel=(640.0, 500.0), tilt_towards=1.0)
    optics = scenes.Optics(white=WHITE, black=0.12 * WHITE, noise=3.0, blur_px=0.9)
    image = scenes.render(view, camera, optics, np.random.default_rng(2), scenes.alone(ring))
    (found,) = find_rings(image, ring, camera)
    assert found.solutions[0].position == pytest.approx(view.position, abs=0.002 * distance)


def sharpened(view: scenes.View) -> U8:
    """Return a view as an ISP makes it: sRGB under an S-curve, an unsharp mask, noise before."""
    linear = 0.6 * light(view) + np.random.default_rng(3).normal(0.0, 0.008, (480, 640))
    level = np.clip(linear, 0.0, 1.0) ** (1.0 / 2.2)
    level = level + 0.4 * level * (1.0 - level) * (2.0 * level - 1.0)
    soft = cv2.GaussianBlur(level, (0, 0), 1.1)
    return picture(level + 0.8 * (level - soft), noise=0.0)


@pytest.mark.parametrize("distance", [3.0, 7.0, 12.0])
def test_a_ring_is_exact_behind_s_curve_and_sharpening(distance: float) -> None:
    view = seen(distance, 25.0)
    assert check(sharpened(view), view, 0.003) == "grey"


def test_a_camera_is_remembered_and_forgotten() -> None:
    """Tracking starts with the response that the ring before had, and ends with a plain one's."""
    view, response = seen(6.0, 30.0), CameraResponse()
    near = np.array(view.position) * 1.002
    assert track_ring(sharpened(view), RING, CAMERA, near, view.normal, response=response)
    assert response.response is not None
    assert response.response[0] > 0.2
    again = track_ring(sharpened(view), RING, CAMERA, near, view.normal, response=response)
    assert again is not None
    assert math.dist(again.solutions[0].position, view.position) < 0.012
    blown = track_ring(
        picture(2.5 * light(view)), RING, CAMERA, near, view.normal, response=response
    )
    assert blown is not None
    assert response.pictures_by_edges > 0
    response.pictures_by_edges = 0
    linear = picture(0.75 * light(view))
    assert track_ring(linear, RING, CAMERA, near, view.normal, response=response) is not None
    assert response.response is None


@pytest.mark.parametrize("distance", [2.0, 7.0, 10.0])
def test_a_ring_behind_the_toe_of_an_s_curve_is_seen(distance: float) -> None:
    view = seen(distance, 25.0)
    dim = 0.4 * light(view, blur_px=1.5)
    check(picture(dim * dim * (3.0 - 2.0 * dim)), view, 0.01)


@pytest.mark.parametrize("distance", [1.5, 2.5])
def test_a_print_whose_ink_has_spread_is_seen_behind_strong_sharpening(distance: float) -> None:
    """The stroke is 0.6 % of the radius broader on either side than the pad file says."""
    spread = 0.006
    outer = (1.0 + spread) * RING.outer_diameter_m
    ratio = (RING.inner_ratio - spread) / (1.0 + spread)
    spread_ring = RING.model_copy(update={"outer_diameter_m": outer, "inner_ratio": ratio})
    view = seen(distance, 25.0)
    level = (0.85 * light(view, layout=scenes.alone(spread_ring))) ** (1.0 / 2.2)
    image = picture(level + 2.0 * (level - cv2.GaussianBlur(level, (0, 0), 1.5)))
    found = find_rings(image, RING, CAMERA)
    assert len(found) == 1
    assert math.dist(found[0].solutions[0].position, view.position) < 0.01 * distance


def test_a_near_ring_behind_a_tone_curve_is_told_from_its_mirrored_pose() -> None:
    """Fits that started from the mirrored pose kept to the outer edge: 2 mm in 1 m off."""
    for k in range(8):
        view = scenes.look(CAMERA, 2.0, 0.2 + 0.07 * k, pixel=(330.0, 250.0), tilt_towards=0.8 * k)
        image = picture((0.8 * light(view)) ** (1.0 / 2.2), seed=k)
        (found,) = find_rings(image, RING, CAMERA)
        assert math.dist(found.solutions[0].position, view.position) < 0.0008 * 2.0


@pytest.mark.parametrize("over", [1.6, 2.5])
@pytest.mark.parametrize("distance", [4.0, 10.0])
def test_a_ring_whose_white_is_blown_out_is_seen(distance: float, over: float) -> None:
    view = seen(distance, 25.0)
    assert check(picture(over * light(view)), view, 0.002) == "grey"


@pytest.mark.parametrize(("distance", "most_chi2"), [(4.0, CHI2_99), (10.0, CHI2_999)])
def test_blown_out_white_makes_a_ring_little_less_exact(distance: float, most_chi2: float) -> None:
    """Position and its stated sigma are about as in a plain picture."""
    view = seen(distance, 25.0)
    level = light(view)
    errors, sigmas = [], []
    for white in (0.75, 2.0):
        found = [
            find_rings(picture(white * level, seed=k), RING, CAMERA)[0].solutions[0]
            for k in range(8)
        ]
        off = np.array([pose.position for pose in found]) - view.position
        stated = np.array([pose.covariance for pose in found])
        assert np.einsum("ni,nij,nj->n", off, np.linalg.inv(stated), off).max() < most_chi2
        errors.append(float(np.sqrt((off * off).sum(axis=1).mean())))
        sigmas.append(float(np.sqrt(np.trace(stated, axis1=1, axis2=2).mean())))
    assert errors[1] < 2.0 * errors[0]
    assert sigmas[1] < 5.0 * sigmas[0]


@pytest.mark.parametrize("distance", [4.0, 10.0])
def test_light_and_blur_of_another_shape_beside_blown_out_white_are_in_the_stated_sigma(
    distance: float,
) -> None:
    """White falls off to all sides, and the lens blurs to one side more than to the other."""
    view = seen(distance, 25.0)
    rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width]
    x, y = CAMERA.pixels(np.array(view.position)[None])[0]
    reach = RING.radius_m * CAMERA.fx / distance
    fallen = 1.0 - 0.04 * ((columns - x) ** 2 + (rows - y) ** 2) / reach**2
    coma = np.array([[0.0, 0.05, 0.05], [0.0, 0.5, 0.25], [0.0, 0.1, 0.05]])
    blurred = cv2.filter2D(light(view, blur_px=0.5) * np.maximum(fallen, 0.3), -1, coma)
    shift = (coma * np.arange(-1, 2)).sum(), (coma * np.arange(-1, 2)[:, None]).sum()
    to_middle = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    level = np.asarray(cv2.warpAffine(blurred, to_middle, blurred.shape[::-1]), dtype=np.float64)
    assert check(picture(2.0 * level), view, 0.003) == "grey"


@pytest.mark.parametrize("distance", [3.0, 7.0, 15.0])
def test_a_ring_blown_out_in_video_of_limited_range_is_seen(distance: float) -> None:
    view = seen(distance, 25.0)
    level = np.clip(3.2 * light(view), 0.0, 1.0) ** (1.0 / 2.2)
    check(picture((16.0 + 219.0 * level) / 255.0, noise=1.0), view, 0.02)


@pytest.mark.parametrize("over", [4.0, 6.0])
@pytest.mark.parametrize("distance", [3.0, 7.0, 12.0])
def test_white_that_has_spread_over_most_of_the_stroke_leaves_the_range_right(
    distance: float, over: float
) -> None:
    """As a camera makes it that exposes for asphalt round the pad, out of focus."""
    view = seen(distance, 25.0)
    assert check(picture(over * light(view, blur_px=1.6)), view, 0.03) == "edges"


def half_shaded(distance: float, tilt_deg: float) -> tuple[U8, scenes.View]:
    view = seen(distance, tilt_deg)
    sun = np.where(np.arange(CAMERA.width) < 299.0, 0.4, 0.8)
    level = sun * light(view, blur_px=0.8)
    return picture(level * level * (3.0 - 2.0 * level)), view


def test_a_small_oblique_ring_in_half_a_shadow_is_seen() -> None:
    image, view = half_shaded(15.0, 52.0)
    check(image, view, 0.02)


@pytest.mark.parametrize("distance", [13.0, 14.0, 15.0])
def test_a_long_ring_whose_short_sides_the_blur_all_but_hides_is_seen(distance: float) -> None:
    """30 px long and 13 wide it was too long for the only level in which it is whole."""
    view = seen(distance, 64.0)
    assert len(find_rings(picture(0.7 * light(view, blur_px=1.8)), RING, CAMERA)) == 1


@pytest.mark.parametrize("distance", [14.0, 17.0])
def test_a_ring_too_oblique_to_be_found_is_tracked(distance: float) -> None:
    image, view = half_shaded(distance, 65.0)
    near = np.array(view.position) * 1.002
    found = track_ring(image, RING, CAMERA, near, view.normal)
    assert found is not None
    assert math.dist(found.solutions[0].position, view.position) < 0.03 * distance


def test_noise_of_a_dark_evening_is_no_reason_to_lose_a_ring() -> None:
    view = seen(6.0, 20.0)
    assert check(picture(0.75 * light(view), noise=15.0), view, 0.005) == "grey"


def test_a_leg_across_the_ring_is_cut_out() -> None:
    view = seen(4.0, 20.0)
    edge = scenes.outline(view, CAMERA, RING)
    x, y = (edge.mean(axis=0) + np.array([0.0, 0.25 * np.ptp(edge[:, 1])])).tolist()
    bar = scenes.Bar((x, y), (1.0, 0.2), 0.08 * float(np.ptp(edge, axis=0).max()), 60.0)
    check(picture(0.75 * light(view, bar=bar)), view, 0.003)


def test_a_ring_is_seen_whose_hole_is_for_the_most_part_dirty() -> None:
    """The white that is left in it was taken for that of a wheel's hub, dimmer than all around."""
    view = seen(6.0, 15.0)
    level = 0.7 * light(view)
    edge = scenes.outline(view, CAMERA, RING)
    (x, y), reach = edge.mean(axis=0), 0.2 * float(np.ptp(edge[:, 0]))
    rows, columns = np.indices(level.shape)
    off = np.hypot(columns - x, rows - y)
    dirty = (off < 1.15 * reach) & (np.arctan2(rows - y, columns - x) > -2.0)  # four fifths of it
    assert check(picture(np.where(dirty, 0.5, 1.0) * level), view, 0.01) == "edges"


def test_a_plain_picture_is_told_by_its_grey_levels() -> None:
    view = seen(6.0, 30.0)
    assert check(picture(0.75 * light(view)), view, 0.002) == "grey"


def test_a_blown_out_ring_is_tracked() -> None:
    view = seen(5.0, 25.0)
    near = np.array(view.position) * 1.002
    found = track_ring(picture(2.0 * light(view)), RING, CAMERA, near, view.normal)
    assert found is not None
    assert found.stage == "edges"
    assert math.dist(found.solutions[0].position, view.position) < 0.025


@pytest.mark.parametrize("cut", [0, 255])
def test_a_ring_behind_a_tone_curve_is_not_tracked_in_the_grey_part_of_a_broken_picture(
    cut: int,
) -> None:
    view = seen(5.0, 20.0)
    image = picture((0.85 * light(view)) ** (1.0 / 2.2), noise=0.0)
    image[cut:] = 128  # what a decoder leaves of a JPEG that ends too early
    near = np.array(view.position) * 1.005
    response = CameraResponse(response=np.array([0.3, 0.0, 0.1]))
    found = track_ring(image, RING, CAMERA, near, view.normal, response=response)
    assert found is None or cut > 0


@pytest.mark.parametrize("share", [0.32, 0.4])  # of the stroke
@pytest.mark.parametrize("distance", [7.0, 12.0])
@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_a_ring_out_of_focus_is_no_further_off_than_sigma_tells(
    distance: float, share: float, gamma: float
) -> None:
    view = seen(distance, 15.0)
    stroke_px = CAMERA.fx * RING.radius_m * (1.0 - RING.inner_ratio) / distance
    image = picture((0.8 * light(view, blur_px=share * stroke_px)) ** (1.0 / gamma))
    check(image, view, 0.05)


def test_a_ring_cut_by_the_edge_is_tracked_just_over_the_pad() -> None:
    """With a shadow's edge across it, so that its grey levels explain nothing."""
    view = scenes.look(CAMERA, 0.62, math.radians(15.0), pixel=(330.0, 470.0), tilt_towards=1.0)
    x, y = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    sun = np.where((x + y < 560) | (x - y > 60), 0.25, 0.7)
    near = np.array(view.position) * 1.01
    found = track_ring(picture(sun * light(view)), RING, CAMERA, near, view.normal)
    assert found is not None
    assert math.dist(found.solutions[0].position, view.position) < 0.01


def test_a_ring_whose_heart_alone_is_in_the_sun_is_tracked_just_over_the_pad() -> None:
    """The white round it in the shade is no brighter than its black in the sun."""
    view = scenes.look(CAMERA, 0.75, math.radians(20.0), pixel=(300.0, 440.0), tilt_towards=4.7)
    x, y = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    dark = 1.0 / (1.0 + np.exp((y + 0.15 * x - 340.0) / 2.0))
    grey = 0.85 * (1.0 - 0.7 * dark) * (0.4 + 0.6 * light(view))  # faded: black is half as bright
    near = np.array(view.position) + np.array([0.006, -0.004, 0.008])
    found = track_ring(picture(grey), RING, CAMERA, near, view.normal)
    assert found is not None
    pose = found.solutions[0]
    error = np.array(pose.position) - view.position
    assert float(np.linalg.norm(error)) < 0.005
    assert float(error @ np.linalg.solve(np.array(pose.covariance), error)) < CHI2_99


_CCTAG = (1.0, 0.85, 0.75, 0.62, 0.52, 0.4)
_EVEN = (1.0, 0.88, 0.76, 0.64, 0.53, 0.41)
_FINE = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.46, 0.41)


@pytest.mark.parametrize(
    ("rings", "flat", "blur_px", "black", "white"),
    [
        (_CCTAG, 0.85, 2.0, 60, 235),
        (_EVEN, 0.95, 1.2, 40, 110),
        (_EVEN, 0.95, 2.0, 60, 200),
        (_FINE, 0.95, 2.0, 40, 110),
    ],
)
def test_a_target_of_several_rings_is_none_of_ours(
    rings: tuple[float, ...], flat: float, blur_px: float, black: int, white: int
) -> None:
    """A blurred CCTag's outline and heart have our ratio, but brighter rings lie between."""
    k, size = 8, 80
    patch = np.full((200 * k, 200 * k), white, np.uint8)
    for share, level in zip(rings, (black, white) * 4, strict=False):
        centre, axis = (100 * k, 100 * k), int(share * size / 2 * k)
        cv2.ellipse(patch, centre, (axis, int(flat * axis)), 30.0, 0.0, 360.0, level, -1)
    small = cv2.GaussianBlur(
        cv2.resize(patch, (200, 200), interpolation=cv2.INTER_AREA), (0, 0), blur_px
    )
    image = np.full((CAMERA.height, CAMERA.width), white, np.uint8)
    image[100:300, 200:400] = small
    assert find_rings(image, RING, CAMERA) == []


@pytest.mark.parametrize(
    ("ratio", "distance", "tilt_deg", "white"),
    [
        # as behind the toe of a curve, but white is near full scale
        (0.3, 24.0, 55.0, 0.75),
        (0.325, 24.0, 45.0, 0.6),
        (0.325, 28.0, 45.0, 0.9),
        # as behind gamma, but one that moves edges by more of their blur than any does
        (0.52, 24.0, 45.0, 0.75),
        (0.52, 28.0, 25.0, 0.6),
        (0.52, 32.0, 5.0, 0.75),
        (0.54, 28.0, 55.0, 0.6),
        # as of white that has spread, but it is below full scale, or spreads as far to every side
        (0.54, 12.0, 45.0, 0.95),
        (0.54, 12.0, 45.0, 1.0),
        (0.56, 20.0, 45.0, 1.0),
        # as of clipped white, but a ring of the nearer ratio explains a tilted one without spread
        (0.46, 6.0, 45.0, 1.2),
        (0.47, 9.0, 35.0, 0.95),
        (0.48, 12.0, 45.0, 1.0),
    ],
)
def test_a_ring_of_another_ratio_is_none_of_ours_behind_a_curve(
    ratio: float, distance: float, tilt_deg: float, white: float
) -> None:
    other = RING.model_copy(update={"inner_ratio": ratio})
    layout = scenes.THESIS_PAD.model_copy(update={"markers": (other,)})
    level = white * light(seen(distance, tilt_deg), layout=layout)
    assert find_rings(picture(level), RING, CAMERA) == []


@pytest.mark.parametrize(
    ("radius_px", "stroke_px", "black", "blur_px"),
    [(8.0, 2.5, 215.0, 0.4), (10.0, 3.0, 210.0, 0.8), (12.0, 3.0, 215.0, 0.8)],
)
def test_a_faint_thin_circle_in_blown_out_white_is_none_of_ours(
    radius_px: float, stroke_px: float, black: float, blur_px: float
) -> None:
    """Blurred, it is brighter than any ink behind white so far over full scale as to thin it so."""
    k, n = 8, 40
    patch = np.full((n * k, n * k), 255.0, np.float32)
    middle, radius = (round(20.3 * k), round(20.2 * k)), round(radius_px * k)
    cv2.circle(patch, middle, radius, black, round(stroke_px * k), cv2.LINE_AA)
    blurred = cv2.GaussianBlur(patch, (0, 0), blur_px * k)
    image = np.full((CAMERA.height, CAMERA.width), 255.0)
    image[200:240, 260:300] = cv2.resize(blurred, (n, n), interpolation=cv2.INTER_AREA)
    assert find_rings(picture(image / 255.0, noise=1.0), RING, CAMERA) == []


@pytest.mark.parametrize(
    ("size", "squeeze", "angle_deg"),
    [(9.75, 0.6, 10.0), (10.25, 0.6, 80.0), (11.0, 0.55, 10.0), (12.0, 0.5, 0.0)],
)
def test_a_small_square_with_a_hole_is_none_of_ours(
    size: float, squeeze: float, angle_deg: float
) -> None:
    """Grey levels of so few pixels fit well, but the corners are not where the edge would be."""
    k, n = 8, 40
    patch = np.full((n * k, n * k), 90.0, np.float32)
    for side, level in ((1.24 * size, 200.0), (size, 30.0), (RING.inner_ratio * size, 200.0)):
        at = ((n / 2 + 0.3) * k, (n / 2 + 0.2) * k)
        corners = cv2.boxPoints((at, (side * k, side * k * squeeze), angle_deg))
        cv2.fillPoly(patch, [np.rint(corners).astype(np.int32)], level)
    image = np.full((CAMERA.height, CAMERA.width), 90.0)
    blurred = cv2.GaussianBlur(patch, (0, 0), 0.6 * k)
    image[220:260, 280:320] = cv2.resize(blurred, (n, n), interpolation=cv2.INTER_AREA)
    assert find_rings(picture(image / 255.0), RING, CAMERA) == []


def test_a_soft_shadow_moves_edges_by_no_more_than_sigma_tells() -> None:
    inside = 0
    for seed in range(12):
        rng = np.random.default_rng([7, seed])
        view = scenes.random_view(rng, CAMERA, rng.uniform(7.0, 12.0), rng.uniform(0, 0.7), RING)
        assert view is not None
        x, y = CAMERA.pixels(np.array([view.position]))[0]
        turn = rng.uniform(0.0, 2.0 * math.pi)
        px_per_m = CAMERA.fx / view.position[2]
        rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width]
        across = (columns - x) * math.cos(turn) + (rows - y) * math.sin(turn)
        shadow = 0.2 + 0.8 / (1.0 + np.exp(-(across / px_per_m + 0.25) / 0.1))
        found = find_rings(picture(light(view) * shadow), RING, CAMERA)
        assert len(found) == 1
        pose = found[0].solutions[0]
        error = np.array(pose.position) - view.position
        inside += float(error @ np.linalg.solve(np.array(pose.covariance), error)) < CHI2_99
    assert inside >= 11


def test_in_leaf_shade_a_known_pad_is_tracked_by_edges_too_few_to_detect_a_ring() -> None:
    alone, known, inside = 0, 0, 0
    for seed in range(18):
        rng = np.random.default_rng([11, seed])
        view = scenes.random_view(rng, CAMERA, rng.uniform(8.0, 17.0), rng.uniform(0.5, 0.95), RING)
        assert view is not None
        leaves = rng.normal(size=(CAMERA.height, CAMERA.width))
        soft = cv2.GaussianBlur(leaves, (0, 0), 0.11 * CAMERA.fx / view.position[2])
        shade = 0.4 + 0.6 / (1.0 + np.exp(-4.0 * soft / soft.std()))
        image = picture(0.7 * (0.25 + 0.75 * light(view, blur_px=2.2)) * shade)
        near = 1.01 * np.array(view.position)
        alone += track_ring(image, RING, CAMERA, near, view.normal) is not None
        found = track_ring(image, RING, CAMERA, near, view.normal, vouches=lambda *_: True)
        if found is not None:
            known += 1
            pose = found.solutions[0]
            error = np.array(pose.position) - view.position
            inside += float(error @ np.linalg.solve(np.array(pose.covariance), error)) < CHI2_99
    assert known >= alone + 3
    assert inside >= 0.8 * known


def test_a_ring_whose_hole_lies_in_the_shadow_of_a_beam_is_seen() -> None:
    """The shadow crosses the plate, too: what is dim is light, not the hub of a wheel."""
    view = seen(4.0, 20.0)
    x, y = CAMERA.pixels(np.array([view.position]))[0]
    half = 0.15 * CAMERA.fx / view.position[2]
    rows, columns = np.mgrid[:480, :640]
    across = (columns - x) * math.cos(1.1) + (rows - y) * math.sin(1.1)
    sun = np.clip(0.5 + (np.abs(across) - half) / 2.0, 0.3, 1.0)
    check(picture(light(view) * sun), view, 0.005)


def sign_with_p(radius_px: int, turn_deg: float) -> U8:
    """Return a dark picture with a P on a round white sign, a little out of focus."""
    k, side = 8, 64  # pixels are drawn eight times as fine
    u, c = radius_px * k / 10, side * k // 2
    sign = np.full((side * k, side * k), 40.0, np.float32)
    cv2.circle(sign, (c, c), int(10 * u), 230.0, -1)

    def box(left: float, top: float, right: float, bottom: float, grey: float) -> None:
        first, last = (
            (int(c + left * u), int(c + top * u)),
            (int(c + right * u), int(c + bottom * u)),
        )
        cv2.rectangle(sign, first, last, grey, -1)

    box(-8.2, -5.2, 1.4, 4.4, 60.0)
    box(-5.3, -2.3, -1.4, 1.6, 230.0)  # the hole of its loop
    box(-8.2, 1.8, 8.5, 4.4, 60.0)
    turn = cv2.getRotationMatrix2D((c, c), turn_deg, 1.0)
    turned = cv2.warpAffine(sign, turn, sign.shape[::-1], borderValue=40.0)
    seen = cv2.resize(
        cv2.GaussianBlur(turned, (0, 0), 1.5 * k), (side, side), interpolation=cv2.INTER_AREA
    )
    image = np.full((CAMERA.height, CAMERA.width), 40.0)
    image[200 : 200 + side, 300 : 300 + side] = seen
    noise = np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    return np.clip(image + noise, 0.0, 255.0).astype(np.uint8)


def test_the_loop_of_a_letter_is_hardly_ever_a_ring() -> None:
    """A parking sign was approached as the pad, from 22 m down to 13 m."""
    signs = [sign_with_p(radius, turn) for radius in range(17, 23) for turn in (0.0, 30.0, 60.0)]
    assert sum(bool(find_rings(sign, RING, CAMERA)) for sign in signs) <= 2
