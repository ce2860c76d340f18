"""Frames with times from a video file or a folder of images."""

import csv
import math
import os
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.messages import Frame
from landerd.opencv_files import IMAGES, grey_image, opencv_name

TIMES = "times.csv"  # in a folder of images: NAME,SECONDS a line
_RATE_FRAMES = 31  # that tell the rate of a video


class VideoError(Exception):
    """There are no frames to be had; the text names the file."""


def read_video(path: Path) -> Iterator[Frame]:
    """Yield grey frames; times are s from the first.

    A folder's images are taken in the order of their times, which are the numbers in `times.csv`
    (NAME,SECONDS) or else in their names, as in `frame-12.345.png`.

    Raises:
        VideoError: unreadable, or no frames in it.
    """
    if path.is_dir():
        yield from _folder(path)
        return
    if not path.is_file():
        raise VideoError(f"{path}: no such file or folder")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    capture = cv2.VideoCapture(opencv_name(path))
    try:
        if not capture.isOpened():
            raise VideoError(f"{path}: not a video that can be read")
        rate = capture.get(cv2.CAP_PROP_FPS) or 30.0
        seq, last = 0, -1.0
        while True:
            ok, image = capture.read()
            if not ok:
                break
            # Phones record at a changing rate: the time in the file counts where there is one.
            t = 1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC)
            t = t if t > last else last + 1.0 / rate if seq else 0.0
            grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            yield Frame(t, seq, np.asarray(grey, dtype=np.uint8))
            seq, last = seq + 1, t
        if seq == 0:
            raise VideoError(f"{path}: no frames in it")
    finally:
        capture.release()


def rate_hz(path: Path) -> float | None:
    """Return how many frames a second a video begins with; None: it has one only.

    Raises:
        VideoError: as `read_video`.
    """
    times = [frame.t for frame in islice(read_video(path), _RATE_FRAMES)]
    length_s = times[-1] - times[0]
    return (len(times) - 1) / length_s if length_s > 0.0 else None


def _folder(path: Path) -> Iterator[Frame]:
    times = _times(path)
    first = times[0][0]
    size: tuple[int, int] | None = None
    for seq, (t, image_path) in enumerate(times):
        image = _image(image_path)
        size = size or (image.shape[0], image.shape[1])
        if image.shape != size:
            found, before = (f"{w}x{h}" for h, w in (image.shape, size))
            raise VideoError(f"{image_path}: {found}, and those before it {before}")
        yield Frame(t - first, seq, image)


def _image(path: Path) -> NDArray[np.uint8]:
    try:
        image = grey_image(path.read_bytes())
    except OSError as e:
        raise VideoError(f"{path}: cannot be read: {e.strerror}") from None
    if image is None:
        raise VideoError(f"{path}: not an image that can be read")
    return np.asarray(image, dtype=np.uint8)


def _times(path: Path) -> list[tuple[float, Path]]:
    listed = path / TIMES
    found: list[tuple[float, Path]] = []
    if listed.exists():
        for number, row in enumerate(_rows(listed), start=1):
            if not row:
                continue
            try:
                found.append((_seconds(row[1]), path / row[0]))
            except (ValueError, IndexError):
                if number > 1:  # the first line may be a heading
                    raise VideoError(f"{listed}:{number}: expected NAME,SECONDS") from None
        for _, image in found:
            if not image.is_file():
                raise VideoError(f"{image}: named in {TIMES} and not there")
    else:
        for image in sorted(p for p in path.iterdir() if p.suffix.lower() in IMAGES):
            digits = image.stem.rpartition("-")[2].rpartition("_")[2]
            try:
                found.append((_seconds(digits), image))
            except ValueError:
                raise VideoError(
                    f"{image}: expected its time in s at the end of its name, or {TIMES}"
                ) from None
    if not found:
        raise VideoError(f"{path}: no images in this folder")
    return sorted(found)


def _rows(path: Path) -> list[list[str]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return list(csv.reader(file))
    except OSError as e:
        raise VideoError(f"{path}: cannot be read: {e.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise VideoError(f"{path}: cannot be read: not text") from None


def _seconds(text: str) -> float:
    seconds = float(text)
    if not math.isfinite(seconds):
        raise ValueError(text)
    return seconds
