"""Which views of a board are enough for a calibration to be trusted; corners are computed."""

import numpy as np
import pytest

from landerd.calibration.board import Chessboard, View
from landerd.calibration.lens import calibrate, not_trusted, outliers, too_poor
from landerd.camera_model import CameraModel
from tests.calibration.boards import Pose, good_views, rotation

SIZE = (480, 360)
CAMERA = CameraModel(*SIZE, 400.0, 398.0, 246.0, 173.0, (-0.12, 0.05, 0.001, -0.002, 0.0))
BOARD = Chessboard(8, 6, 0.03)
IDS = np.arange(48)
GOOD = good_views(CAMERA, 0.27, 0.21)


def views(poses: list[Pose], noise_px: float = 0.1) -> list[View]:
    random = np.random.default_rng(1)
    places = BOARD.corners_m(IDS) - [3.5 * 0.03, 2.5 * 0.03, 0.0]
    seen = []
    for i, pose in enumerate(poses):
        pixels = CAMERA.pixels(places @ rotation(pose).T + [pose.x, pose.y, pose.z])
        seen.append(View(f"{i}.png", IDS, pixels + random.normal(0.0, noise_px, pixels.shape)))
    return seen


def test_a_calibration_from_views_from_all_sides_is_trusted() -> None:
    seen = views(GOOD)
    assert too_poor(seen, SIZE) == []
    result = calibrate(BOARD, seen, SIZE, "plumb_bob")
    assert not_trusted(result, seen) == []
    assert outliers(result) == []
    assert result.error_px == pytest.approx(0.14, abs=0.02)  # the noise, in both directions
    assert result.camera.fx == pytest.approx(CAMERA.fx, rel=0.003)


def test_a_rational_lens_is_calibrated() -> None:
    seen = views(GOOD)
    result = calibrate(BOARD, seen, SIZE, "rational")
    assert len(result.camera.distortion) == 8
    assert result.camera.fx == pytest.approx(CAMERA.fx, rel=0.01)


@pytest.mark.parametrize(("side", "where"), [(-1.0, "right"), (1.0, "left")])
def test_a_part_of_the_picture_never_covered_is_named(side: float, where: str) -> None:
    aside = [Pose(side * 0.08, p.y, p.z, p.pitch_deg, p.yaw_deg, 0.0) for p in GOOD]
    (reason,) = too_poor(views(aside), SIZE)
    assert reason.endswith(f"bring the board into the {where} too")


def test_views_from_straight_ahead_only_are_refused() -> None:
    seen = views([Pose(p.x, p.y, p.z, 0.0, 0.0, p.roll_deg) for p in GOOD])
    assert too_poor(seen, SIZE) == []
    reasons = not_trusted(calibrate(BOARD, seen, SIZE, "plumb_bob"), seen)
    assert any(reason.startswith("0 views from aside") for reason in reasons)


def test_a_fisheye_seen_from_straight_ahead_in_one_place_has_no_known_focal_length() -> None:
    corners = np.column_stack([IDS % 8, IDS // 8]) * 50.0 + [60.0, 60.0]
    seen = [View(f"{i}.png", IDS, corners) for i in range(12)]
    reasons = not_trusted(calibrate(BOARD, seen, SIZE, "fisheye"), seen)
    assert any("focal length is only known to 100.00 %" in reason for reason in reasons)


def test_a_focal_length_that_stays_uncertain_is_refused() -> None:
    seen = views([Pose(p.x, p.y, p.z, 16.0, 0.0, 0.0) for p in GOOD], noise_px=0.6)
    reasons = not_trusted(calibrate(BOARD, seen, SIZE, "plumb_bob"), seen)
    assert any("focal length is only known" in reason for reason in reasons)


def test_a_bent_board_is_refused_and_a_single_bad_picture_named() -> None:
    seen = views(GOOD, noise_px=1.0)
    result = calibrate(BOARD, seen, SIZE, "plumb_bob")
    assert any("reprojection error" in reason for reason in not_trusted(result, seen))

    seen = views(GOOD)
    shaken = seen[4].corners_px + np.random.default_rng(2).normal(0.0, 2.0, (48, 2))
    seen[4] = View("shaken.png", IDS, shaken)
    assert outliers(calibrate(BOARD, seen, SIZE, "plumb_bob")) == [4]
