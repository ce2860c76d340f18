"""A folder of images as a video: what is read, and the line with which the rest is refused."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from hw.replay.video import VideoError, read_video
from landerd.opencv_files import IMAGES
from tests.tiffs import tiff

GREY = np.full((48, 64), 128, np.uint8)


def folder(path: Path, *names: str, times: bytes | None = None) -> Path:
    for name in names:
        cv2.imwrite(str(path / name), GREY)
    if times is not None:
        (path / "times.csv").write_bytes(times)
    return path


def refused(path: Path) -> str:
    with pytest.raises(VideoError) as told:
        list(read_video(path))
    return str(told.value).removeprefix(f"{path}/")


@pytest.mark.parametrize(
    "times",
    [
        b"a.png,2\nb.png,2.5\n",
        b"\xef\xbb\xbfname,seconds\r\nb.png,2.5\r\na.png,2\r\n\r\n",  # of a spreadsheet
    ],
)
def test_times_come_from_a_table(times: bytes, tmp_path: Path) -> None:
    frames = list(read_video(folder(tmp_path, "a.png", "b.png", times=times)))
    assert [frame.t for frame in frames] == [0.0, 0.5]


@pytest.mark.parametrize(
    ("times", "line"),
    [
        (b"a.png,0\nb.png,nan\n", "times.csv:2: expected NAME,SECONDS"),
        (b"a.png,0\nb.png\n", "times.csv:2: expected NAME,SECONDS"),
        (b"a.png,0\nb\xf6.png,1\n", "times.csv: cannot be read: not text"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(times: bytes, line: str, tmp_path: Path) -> None:
    assert refused(folder(tmp_path, "a.png", "b.png", times=times)) == line


def test_a_name_without_a_time_is_refused(tmp_path: Path) -> None:
    said = refused(folder(tmp_path, "f-0.0.png", "f-nan.png"))
    assert said.startswith("f-nan.png: expected its time in s at the end of its name")


def test_pictures_that_are_none_or_of_another_size_are_refused(tmp_path: Path) -> None:
    second = folder(tmp_path, "f-0.0.png") / "f-1.0.png"
    cv2.imwrite(str(second), GREY[:24, :32])
    assert refused(tmp_path) == "f-1.0.png: 32x24, and those before it 64x48"
    data = bytearray(second.read_bytes())
    data[16:24] = (60_000).to_bytes(4, "big") * 2  # more pixels than can be read
    second.write_bytes(data)
    assert refused(tmp_path) == "f-1.0.png: not an image that can be read"
    second.unlink()
    second.mkdir()
    assert re.match("f-1.0.png: cannot be read: Is a directory", refused(tmp_path))


@pytest.mark.parametrize("ending", sorted(IMAGES))
def test_no_frame_of_a_folder_is_left_out(ending: str, tmp_path: Path) -> None:
    folder(tmp_path, "f-0.0.png")
    image = GREY if ending == ".pgm" else cv2.cvtColor(GREY, cv2.COLOR_GRAY2BGR)
    cv2.imwrite(str(tmp_path / f"f-1.0{ending}"), image)
    assert [frame.t for frame in read_video(tmp_path)] == [0.0, 1.0]


def test_a_jpeg_is_not_rotated_by_its_orientation_tag(tmp_path: Path) -> None:
    """EXIF tells viewers to turn the picture; principal point and distortion do not turn."""
    _, jpeg = cv2.imencode(".jpg", GREY)
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06" + bytes(7)
    app1 = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    (tmp_path / "f-0.0.jpg").write_bytes(jpeg.tobytes()[:2] + app1 + jpeg.tobytes()[2:])
    (frame,) = read_video(tmp_path)
    assert frame.image.shape == GREY.shape


def test_a_tiff_is_read_as_the_sensor_had_it(tmp_path: Path) -> None:
    """OpenCV turns a TIFF, whatever it is told."""
    grey = np.tile(np.arange(64, dtype=np.uint8), (48, 1))
    (tmp_path / "held-0.tif").write_bytes(tiff(grey, orientation=3))
    (frame,) = read_video(tmp_path)
    assert np.array_equal(frame.image, grey)
