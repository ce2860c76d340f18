"""Videos of a dry run: whether they are whole, and what is printed while they are written."""

import contextlib
import resource
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from landerd.analysis.orders_video import OrdersVideo
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.config.models import Config
from landerd.lander import Lander
from landerd.messages import Frame, Prior, Sightings
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


@pytest.mark.parametrize("suffix", [".webm", ".mp4"])
@pytest.mark.parametrize(("room", "is_whole"), [(60_000, False), (resource.RLIM_INFINITY, True)])
def test_whether_a_video_fitted_on_the_disk_is_told_and_opencv_prints_nothing(
    suffix: str, room: int, is_whole: bool, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    video = OrdersVideo(tmp_path / f"film{suffix}", CAMERA, LAYOUT, 10.0)
    video.on_flight(Lander(Config(), LAYOUT))
    rng = np.random.default_rng(1)
    with no_file_larger_than(room):
        for seq in range(4):
            image = rng.integers(0, 255, (CAMERA.height, CAMERA.width), np.uint8)
            frame = Frame(0.1 * seq, seq, image)
            video.on_frame(frame, Prior(), Sightings(frame.t, seq, (), ()))
        assert video.close() == is_whole
    assert capfd.readouterr().err == ""


@contextlib.contextmanager
def no_file_larger_than(room: int) -> Iterator[None]:
    """Let writing fail within the block from this many bytes of a file on, as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
