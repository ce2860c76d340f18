"""Videos of a dry run: what is printed while they are written."""

from pathlib import Path

import pytest

from landerd.analysis.orders_video import OrdersVideo
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.pad import load_pad

CAMERA = load_camera(config_dir() / "cameras" / "thesis.yaml")
LAYOUT = load_pad(config_dir() / "pads" / "thesis.yaml")


@pytest.mark.parametrize("suffix", [".webm", ".mp4"])
def test_opencv_prints_nothing_while_a_video_is_written(
    suffix: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    video = OrdersVideo(tmp_path / f"film{suffix}", CAMERA, LAYOUT, 10.0)
    video.close()
    assert capfd.readouterr().err == ""


def test_opencv_prints_nothing_about_a_video_that_did_not_fit_on_the_disk(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "film.webm").symlink_to("/dev/full")
    video = OrdersVideo(tmp_path / "film.webm", CAMERA, LAYOUT, 10.0)
    video.close()
    assert capfd.readouterr().err == ""
