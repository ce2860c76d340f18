"""The pad as it was printed, mounted and used: sizes, places, folds, ink, dirt, water, glare."""

import math
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from hw.sim.picture.pad_print import fold, printed, textures
from hw.sim.picture.pad_texture import BLACK, WHITE
from landerd.geometry import Vec3
from landerd.pad import PadLayout
from tests.hw.sim.picture.scenery import (
    BLANK,
    F64,
    PAD,
    U8,
    down,
    pad_options,
    picture,
    projected,
    render_options,
)

TAG = PAD.squares[0]
HALF = 0.5 * TAG.size_m
SQUARE = ((1, -1), (1, 1), (-1, 1), (-1, -1))  # north, east; its top left, then clockwise


def tag_corners(image: U8) -> F64:
    """Corners (4, 2) of the pad's AprilTag from its printed top-left clockwise."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, ids, _ = cv2.aruco.ArucoDetector(family, parameters).detectMarkers(image)
    assert ids is not None
    assert ids.ravel().tolist() == [TAG.id]
    # OpenCV's dictionary is upside down against the AprilTag project's.
    return np.array(np.roll(corners[0][0], 2, axis=0), np.float64)


def finest(layout: PadLayout, pad: dict[str, Any], render: dict[str, Any], seed: int = 1) -> F64:
    """Grey levels of the plate at full resolution."""
    options = pad_options(**pad)
    texture = textures(layout, options, render_options(**render), seed)[0]
    rows, columns = np.nonzero(texture.alpha == 255)
    inside = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    return texture.grey[inside].astype(np.float64)


# ---- sizes and places ----------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [0.97, 1.01, 1.05])
def test_a_print_of_another_scale_moves_every_corner_by_that_share(scale: float) -> None:
    pose = down(2.2, north=0.35)
    seen = tag_corners(picture(pose, {"defocus_px": 0.6}, {"print_scale": scale}))
    north, east = TAG.position_m
    true = [(scale * (north + n * HALF), scale * (east + e * HALF), 0.0) for n, e in SQUARE]
    assert np.abs(seen - projected(pose, *true)).max() < 0.4
    # The landing point is the file's, the ring about it only larger.
    layout = printed(PAD, pad_options(print_scale=scale), 1)
    assert layout.rings[0].position_m == (0.0, 0.0)
    assert layout.rings[0].outer_diameter_m == pytest.approx(scale * 1.0)
    assert layout.plate == PAD.plate


def test_markers_are_misplaced_so_far_each_its_own_way_by_seed() -> None:
    def ways(seed: int) -> list[F64]:
        layout = printed(PAD, pad_options(marker_error_m=0.005), seed)
        pairs = zip(layout.markers, PAD.markers, strict=True)
        return [np.subtract(m.position_m, true.position_m) for m, true in pairs]

    bearings = []
    for seed in range(1, 30):
        assert [math.hypot(*way) for way in ways(seed)] == pytest.approx([0.005] * 2)
        bearings += [math.atan2(way[1], way[0]) for way in ways(seed)]
    assert np.allclose(ways(3), ways(3))
    assert len(set(bearings)) == len(bearings)
    assert abs(np.exp(1j * np.array(bearings)).mean()) < 0.3  # to all sides


def test_a_true_print_is_the_files_own() -> None:
    assert printed(PAD, pad_options(), 1) is PAD


# ---- a folded plate ------------------------------------------------------------------------------


def bent(north: float, east: float, angle_deg: float) -> Vec3:
    """Where a point of the flat plate lies when it is folded, local frame; down is positive."""
    hinge = 0.5 * (0.5 + TAG.position_m[0] - HALF)  # in the middle between ring and tag
    beyond, a = north - hinge, math.radians(angle_deg)
    return (hinge + beyond * math.cos(a), east, beyond * math.sin(a))


@pytest.mark.parametrize("angle_deg", [-12.0, -4.0, 4.0, 12.0])
def test_a_fold_turns_the_tags_corners_by_its_angle(angle_deg: float) -> None:
    pose = down(2.0, north=0.2, east=0.25)
    seen = tag_corners(picture(pose, {"defocus_px": 0.6}, {"bend_deg": angle_deg}))
    north, east = TAG.position_m
    true = [bent(north + n * HALF, east + e * HALF, angle_deg) for n, e in SQUARE]
    assert np.abs(seen - projected(pose, *true)).max() < 0.4


def test_the_landing_points_side_of_a_fold_stays_where_it_was() -> None:
    pose = down(2.0)
    flat, folded = (picture(pose, None, {"bend_deg": angle}).astype(int) for angle in (0.0, 12.0))
    hinge = bent(0.5 * (0.5 + TAG.position_m[0] - HALF), 0.0, 0.0)
    row = projected(pose, hinge)[0, 1]
    assert np.abs(flat - folded)[math.ceil(row) + 3 :].max() <= 1
    assert np.abs(flat - folded)[: math.floor(row) - 3].max() > 50


def test_a_fold_at_its_hinge_leaves_no_gap() -> None:
    folded = picture(down(1.2, north=0.5), None, {"bend_deg": 8.0}, layout=BLANK)
    middle = folded[:, 100:220]
    assert (middle[20:-20] == WHITE).all()


def test_a_pad_of_a_single_marker_has_nothing_to_be_folded_from() -> None:
    assert fold(BLANK, 4.0) is None
    assert fold(PAD, 0.0) is None


# ---- ink, dirt, water, glare ---------------------------------------------------------------------


@pytest.mark.parametrize(("black", "level"), [(None, BLACK), (0.05, 10), (0.3, 60)])
def test_the_print_is_as_black_as_it_is_said_to_be(black: float | None, level: int) -> None:
    image = picture(down(2.0), None, {"black": black})
    x, y = projected(down(2.0), (-0.35, 0.0, 0.0))[0].round().astype(int)
    assert image[y - 4 : y + 5, x - 4 : x + 5].mean() == pytest.approx(level, abs=0.6)
    assert image[120, 160] == WHITE


@pytest.mark.parametrize("share", [0.05, 0.12, 0.4])
@pytest.mark.parametrize("seed", [1, 2])
def test_dirt_covers_its_share_of_the_plate(share: float, seed: int) -> None:
    seen = finest(BLANK, {"dirt": share}, {}, seed)
    mud = np.quantile(seen, 0.25 * share)
    assert 0.15 * WHITE - 1 <= mud <= 0.4 * WHITE + 3
    assert (seen < 0.5 * (WHITE + mud)).mean() == pytest.approx(share, abs=0.01)


def test_dirt_hides_the_print_too() -> None:
    plain, dirty = (finest(PAD, {"dirt": share}, {}) for share in (0.0, 0.3))
    on_black = (plain == BLACK) & (dirty > BLACK + 10)
    assert on_black.sum() > 0.1 * (plain == BLACK).sum()


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_wet_spots_cover_their_share_of_the_plate(share: float) -> None:
    seen = finest(BLANK, {}, {"wet": share})
    wet = round(0.85 * WHITE + 8)
    assert abs(np.quantile(seen, 0.02) - wet) <= 2
    assert (seen < 0.5 * (WHITE + wet)).mean() == pytest.approx(share, abs=0.01)


@cache
def without_glare(seed: int) -> F64:
    return finest(PAD, {}, {}, seed)


@pytest.mark.parametrize("glare", [0.1, 0.2])
def test_glare_adds_its_share_of_full_scale_on_black_and_white(glare: float) -> None:
    places = set()
    for seed in range(1, 6):
        added = finest(PAD, {}, {"glare": glare}, seed) - without_glare(seed)
        assert added.max() == pytest.approx(255 * glare, abs=1.0)
        assert added.min() >= 0.0
        # A small spot: half of its height within 1.2 sigma of 3 to 8 % of the plate's side.
        spot = (added > 0.5 * added.max()).sum() / max(added.shape) ** 2
        assert math.pi * (1.17 * 0.03) ** 2 < spot < math.pi * (1.19 * 0.08) ** 2
        places.add(np.unravel_index(added.argmax(), added.shape))
    assert len(places) == 5


def test_strong_glare_ends_at_white_of_the_scale() -> None:
    seen = finest(PAD, {}, {"glare": 1.0})
    assert seen.max() == 255


def test_one_kind_of_dirt_on_the_plate_does_not_depend_on_another() -> None:
    dirty, both = (finest(PAD, {"dirt": 0.12}, {"glare": glare}) for glare in (0.0, 0.2))
    glare = finest(PAD, {}, {"glare": 0.2}) - finest(PAD, {}, {})
    assert np.abs(both - dirty)[glare == 0].max() <= 1  # by rounding
    assert printed(PAD, pad_options(marker_error_m=0.01, dirt=0.1), 5) == printed(
        PAD, pad_options(marker_error_m=0.01), 5
    )


def test_the_wear_of_a_pad_depends_on_its_seed() -> None:
    worn = {"dirt": 0.1, "marker_error_m": 0.005}
    first, again, other = (
        picture(down(3.0), {"wet": 0.2, "glare": 0.5}, worn, seed=s) for s in (1, 1, 2)
    )
    assert (first == again).all()
    assert (first != other).mean() > 0.01
