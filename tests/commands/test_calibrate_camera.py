"""`landerd calibrate camera` on drawn boards seen through a known lens."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from landerd.camera_model import CameraModel, load_camera
from landerd.cli import main
from tests.calibration.boards import (
    MARKER_M,
    SQUARE_M,
    Pose,
    charuco,
    chessboard,
    good_views,
    shoot,
    wide_views,
)

pytestmark = pytest.mark.long

CAMERA = CameraModel(480, 360, 400.0, 398.0, 246.0, 173.0, (-0.12, 0.05, 0.001, -0.002, 0.0))
CHESSBOARD = ["--size", "8x6", "--square", str(SQUARE_M)]
CHARUCO = ["--board", "charuco", "--size", "9x7", "--square", str(SQUARE_M)]
CHARUCO += ["--marker", str(MARKER_M)]


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photos")
    poses = good_views(CAMERA, 9 * SQUARE_M, 7 * SQUARE_M)
    shoot(folder, CAMERA, chessboard(8, 6), poses)
    return folder


def report(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = main(["calibrate", "camera", "--json", *arguments])
    (line,) = capsys.readouterr().out.splitlines()
    return code, json.loads(line)


def check_lens(found: CameraModel, true: CameraModel) -> None:
    """Check the focal length within 0.3 %, and the directions of all pixels."""
    assert found.fx == pytest.approx(true.fx, rel=0.003)
    assert found.fy == pytest.approx(true.fy, rel=0.003)
    pixels = np.array([[u, v] for u in (20.0, 240.0, 460.0) for v in (20.0, 180.0, 340.0)])
    points = np.column_stack([true.rays(pixels), np.ones(9)])
    assert np.abs(found.pixels(points) - pixels).max() < 1.0


def test_a_chessboard_gives_the_lens(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = tmp_path / "mine.yaml"
    code, told = report(capsys, str(photos), *CHESSBOARD, "-o", str(made))
    assert (code, told["good"], told["views"]) == (0, True, 12)
    assert told["error_px"] < 0.2
    assert max(told["image_errors_px"].values()) < 0.3
    check_lens(load_camera(made), CAMERA)


def test_a_charuco_board_that_reaches_beyond_the_picture_gives_the_lens(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Nearer than its whole fits in.
    poses = [
        Pose(1.3 * p.x, 1.3 * p.y, 0.8 * p.z, p.pitch_deg, p.yaw_deg, p.roll_deg)
        for p in good_views(CAMERA, 9 * SQUARE_M, 7 * SQUARE_M)
    ]
    shoot(tmp_path, CAMERA, charuco(9, 7), poses)
    made = tmp_path / "mine.yaml"
    code, told = report(capsys, str(tmp_path), *CHARUCO, "-o", str(made))
    assert code == 0, told["reasons"]
    assert told["error_px"] < 0.2
    check_lens(load_camera(made), CAMERA)


def test_a_fisheye_lens_is_calibrated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fisheye = CameraModel(480, 360, 190.0, 189.0, 243.0, 176.0, (0.02, -0.01, 0.004, -0.001), True)
    shoot(tmp_path, fisheye, chessboard(8, 6), wide_views(0.28, 38.0))
    made = tmp_path / "mine.yaml"
    code, told = report(capsys, str(tmp_path), *CHESSBOARD, "--lens", "fisheye", "-o", str(made))
    assert code == 0, told["reasons"]
    assert told["error_px"] < 0.2
    assert 0.0 < told["focal_sigma"] < 0.003
    found = load_camera(made)
    assert found.fisheye
    check_lens(found, fisheye)


def test_too_few_views_are_refused(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = [str(photos / f"{i:02}.png") for i in range(5)]
    made = tmp_path / "mine.yaml"
    assert main(["calibrate", "camera", *few, *CHESSBOARD, "-o", str(made)]) == 1
    assert "refused: 5 views of the board, at least 10 are needed" in capsys.readouterr().out
    assert not made.exists()


def test_wrong_input_is_told_in_one_line(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def complaint(*arguments: str) -> str:
        assert main(["calibrate", "camera", *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        return line

    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((48, 64), np.uint8))
    assert "64x48" in complaint(str(photos), str(tmp_path / "small.png"), *CHESSBOARD)
    assert "no such file" in complaint(str(tmp_path / "none.mp4"), *CHESSBOARD)
    assert "--marker" in complaint(str(photos), *CHARUCO[:-2])
    assert "dictionary" in complaint(str(photos), *CHARUCO, "--dictionary", "9X9_9")
    assert "smaller" in complaint(str(photos), *CHARUCO[:-2], "--marker", "0.04")


def test_a_bad_image_is_left_out_and_a_failed_write_is_reported(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, made = tmp_path / "bad", tmp_path / "mine.yaml"
    bad.mkdir()
    (bad / "a.png").write_bytes(bytes(100))
    cv2.imwrite(str(bad / "b.png"), np.zeros((360, 480), np.uint8))
    sources = ["calibrate", "camera", str(bad), str(photos)]
    assert main([*sources, *CHESSBOARD, "-o", str(made)]) == 0
    told = capsys.readouterr()
    assert told.err == f"{bad}/a.png: not an image that can be read\n"
    assert told.out.splitlines()[-1] == f"written: {made}"
    made.unlink()
    made.symlink_to("/dev/full")
    assert main([*sources, *CHESSBOARD, "-o", str(made)]) == 2
    told = capsys.readouterr()
    assert "focal length" in told.out
    assert told.err.splitlines()[-1] == f"{made}: cannot be written: No space left on device"
