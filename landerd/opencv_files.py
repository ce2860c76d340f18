"""Names of files and images in them, as OpenCV takes and gives them, and its messages."""

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

# How the names of still images end that OpenCV reads.
IMAGES = frozenset(
    {".png", ".jpg", ".jpeg", ".jp2", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"}
)

# However the camera was held: a calibration is of the pixels as the sensor has them.
_READ_AS = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
_TIFF: Mapping[bytes, Literal["little", "big"]] = {b"II*\0": "little", b"MM\0*": "big"}
_ORIENTATION, _NO_TURN = 274, 1  # a TIFF's tag, and its value


def opencv_name(path: Path | str) -> Any:  # its stubs know of no bytes
    """Return the name of a file or camera: as a str, one that is no UTF-8 ends the process."""
    return os.fsencode(path)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Discard what OpenCV and FFmpeg print on standard error within the block.

    No log level reaches all of their lines. Whatever else the process prints meanwhile is lost.
    """
    try:
        kept = os.dup(2)
    except OSError:  # standard error is closed already
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def grey_image(data: bytes, *, any_depth: bool = False) -> NDArray[Any] | None:
    """Return the image in a file's bytes, (height, width), not turned; None: it is none.

    Args:
        data: all of the file.
        any_depth: as many bits a pixel as it has, else 8.
    """
    flags = _READ_AS | (cv2.IMREAD_ANYDEPTH if any_depth else 0)
    try:
        return cv2.imdecode(np.frombuffer(_without_turn(data), np.uint8), flags) if data else None
    except cv2.error:  # more pixels than it takes
        return None


def _without_turn(data: bytes) -> bytes:
    """Return a file; of a TIFF without the turn, which OpenCV makes there all the same."""
    order = _TIFF.get(data[:4])
    if order is None:
        return data
    tags = int.from_bytes(data[4:8], order) + 2
    for at in range(tags, tags + 12 * int.from_bytes(data[tags - 2 : tags], order), 12):
        if int.from_bytes(data[at : at + 2], order) == _ORIENTATION:
            return data[: at + 8] + _NO_TURN.to_bytes(2, order) + data[at + 10 :]
    return data
