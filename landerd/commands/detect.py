"""`landerd detect`: finds the pad and its markers in images, folders, videos and cameras."""

import argparse
import json
import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CalibrationError, CameraModel, left_out, load_camera
from landerd.commands.shared import InputError, file_name, pad_path, refusing, tell, write_bytes
from landerd.config.files import own_or
from landerd.config.models import VisionSection
from landerd.geometry import Vec3, cross, dot, scale, sub
from landerd.messages import Frame, MarkerSighting, PoseSolution, Sightings
from landerd.opencv_files import IMAGES, grey_image, opencv_name
from landerd.pad import PadError, PadLayout, Ring, load_pad
from landerd.vision import Vision
from landerd.vision.disagreement import Disagreement
from landerd.vision.draw import draw

_MOST_CAMERAS = 1000  # a number from here on is not taken for a camera's
_READOUT_S = 0.02  # readout time assumed of the camera's rolling shutter, s
# Formats that OpenCV cannot read, or only as videos.
_OTHER_IMAGES = {".heic", ".heif", ".avif", ".jxl", ".dng", ".gif"}
_BITS = 8  # bits per pixel of the pictures that are searched


class SourceError(Exception):
    """A source cannot be read; the text names it."""


@dataclass(frozen=True)
class Picture:
    """One grey picture of a source."""

    name: str  # file, or SOURCE#NUMBER of a video or camera
    t: float  # time since the start of its source, s
    image: NDArray[np.uint8]  # (height, width)
    follows: bool  # whether the picture before is the preceding frame of the same video or camera
    is_still: bool  # whether it is from an image file, not from a video or camera


@dataclass(frozen=True)
class Seen:
    """What a picture shows."""

    sightings: Sightings
    ms: float  # time of the search for the pad
    disagreement: Disagreement | None  # error by which markers contradict each other
    # The markers are rings like the pad's, not taken for them as its plate is not seen about them.
    lacks_plate: bool = False
    others: tuple[str, ...] = ()  # markers that are not the pad's, in words


Refuse = Callable[[Exception], None]  # called with the reason if a picture is left out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help="image, folder of images, video file, camera (/dev/video0 or its number) or URL",
    )
    parser.add_argument(
        "--camera",
        required=True,
        type=file_name,
        metavar="FILE",
        help="calibration, ROS camera_info YAML",
    )
    parser.add_argument(
        "--pad",
        required=True,
        metavar="FILE",
        help="pad file: markers, sizes and places; or one of landerd's own by name, as nested",
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object per image, each on a line"
    )
    parser.add_argument(
        "--draw",
        type=file_name,
        metavar="FOLDER",
        help="write the pictures with the markers drawn into this folder",
    )


def run(args: argparse.Namespace) -> int:
    """Print the markers and the pad in each picture; return 0.

    Raises:
        InputError: an argument cannot be used; or, after the others are done, a source cannot.
    """
    with refusing(CalibrationError, PadError):
        camera, layout = load_camera(own_or(args.camera)), load_pad(pad_path(args.pad))
    try:
        _new_vision(layout, camera)
    except ValueError as e:
        raise InputError(f"{args.pad}: {e}") from None
    if remark := left_out(camera):
        tell(f"{args.camera}: {remark}")
    if args.draw is not None:
        try:
            args.draw.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise InputError(f"--draw {args.draw}: found a file, expected a folder") from None
        except OSError as e:
            raise InputError(f"--draw {args.draw}: {e.strerror}") from None
    refused: list[str] = []
    drawn: set[Path] = set()

    def refuse(e: Exception) -> None:
        tell(str(e))  # at once, as the next source may be a camera, which has no end
        refused.append(str(e))

    for source in args.sources:
        try:
            _detect(source, camera, layout, args, refuse, drawn)
        except (SourceError, CalibrationError) as e:
            refuse(e)
    if refused:
        raise InputError("a source cannot be used", is_told=True)
    return 0


def _detect(
    source: str,
    camera: CameraModel,
    layout: PadLayout,
    args: argparse.Namespace,
    refuse: Refuse,
    drawn: set[Path],
) -> None:
    """Print what the pictures of one source show, and draw them if asked to.

    Args:
        source: file, folder, camera or URL.
        camera: the calibration.
        layout: the pad.
        args: of the command line.
        refuse: called with the reason for each picture that is left out.
        drawn: files drawn so far; those of this source are added.

    Raises:
        SourceError: the source cannot be read.
        CalibrationError: the calibration does not fit the size of a video's or camera's frames.
    """
    vision: Vision | None = None
    for seq, picture in enumerate(pictures(source, refuse)):
        height, width = picture.image.shape
        if vision is None or not picture.follows:
            try:
                fitting = camera.scaled(width, height)
            except CalibrationError as e:
                error = CalibrationError(f"{picture.name}: {args.camera}: {e}")
                if picture.is_still:
                    refuse(error)
                    continue
                raise error from None
            vision = _new_vision(layout, fitting)
        frame = Frame(picture.t, seq, picture.image)
        seen = _look(vision, frame, is_still=picture.is_still)
        if args.json:
            print(json.dumps(as_json(picture.name, seen)), flush=True)
        else:
            print(_in_words(picture.name, seen), flush=True)
        if args.draw is not None:
            _, png = cv2.imencode(".png", draw(picture.image, seen.sightings, fitting, layout))
            write_bytes(_unused(args.draw, picture.name, drawn), png.tobytes())


def _look(vision: Vision, frame: Frame, *, is_still: bool) -> Seen:
    """Return what a picture shows; a still is searched to the end."""
    start = time.perf_counter()
    sightings = vision.search_still(frame) if is_still else vision.process(frame)
    ms, wrong = 1e3 * (time.perf_counter() - start), vision.disagreement()
    if not is_still:
        return Seen(sightings, ms, wrong)
    bare = vision.rings_without_plate(frame, sightings)
    more = vision.other_squares(frame.image, sightings)
    sightings = replace(sightings, markers=(*sightings.markers, *more, *bare))
    others = vision.other_markers(frame.image, sightings)
    return Seen(sightings, ms, wrong, lacks_plate=bool(bare), others=tuple(others))


def _unused(folder: Path, name: str, used: set[Path]) -> Path:
    """Return a file for drawing a picture, with a number if the picture's name is used already.

    Args:
        folder: in which the file is.
        name: of the picture; the folder in it is left out, so names may be equal.
        used: files returned so far; the new one is added.
    """
    name = Path(name).name.replace("#", "_")
    path, number = folder / f"{name}.png", 1
    while path in used:
        number += 1
        path = folder / f"{name}-{number}.png"
    used.add(path)
    return path


def _new_vision(layout: PadLayout, camera: CameraModel) -> Vision:
    return Vision(layout, camera, VisionSection(readout_s=_READOUT_S))


# ---- pictures ----------------------------------------------------------------------------------


def pictures(source: str, refuse: Refuse) -> Iterator[Picture]:
    """Yield the picture of an image file, those in a folder, or the frames of a video or camera.

    Args:
        source: file, folder, camera or URL.
        refuse: called with the reason for each image of a folder that cannot be read; the others
            are yielded.

    Raises:
        SourceError: the source cannot be read.
    """
    # OpenCV's own messages are switched off: a source that cannot be read is one line of ours.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    path = Path(source)
    if not source:
        raise SourceError("'': expected an image, a folder, a video, a camera or a URL")
    if path.is_dir():
        try:
            files = sorted(path.iterdir())
        except OSError as e:
            raise SourceError(f"{source}: cannot be read: {e.strerror}") from None
        images = [p for p in files if p.suffix.lower() in IMAGES]
        for file in files:
            if file.suffix.lower() in _OTHER_IMAGES:
                refuse(SourceError(f"{file}: not read; save it as PNG or JPEG"))
        if not images:
            raise SourceError(f"{source}: no images in this folder")
        for image in images:
            try:
                picture = _still(image)
            except SourceError as e:
                refuse(e)
            else:
                yield picture
    elif path.suffix.lower() in IMAGES and "://" not in source:
        yield _still(path)
    else:
        yield from _frames(source)


def _still(path: Path) -> Picture:
    """Return the picture in an image file, converted to 8 bits. Raises SourceError."""
    try:
        data = path.read_bytes()
    except OSError as e:
        raise SourceError(f"{path}: cannot be read: {e.strerror}") from None
    image = grey_image(data, any_depth=True)
    if image is not None and image.dtype == np.uint16:
        image = _of_depth(image)
    elif image is not None and image.dtype != np.uint8:
        image = grey_image(data)
    if image is None:
        raise SourceError(f"{path}: not an image that can be read")
    return Picture(str(path), 0.0, np.asarray(image, dtype=np.uint8), False, True)


def _of_depth(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return an image of 16 bits per pixel converted to 8.

    The sensor may have had 10, 12, 14 or 16 bits. No file format states it, so it is taken from the
    brightest pixel.
    """
    return np.asarray(image >> max(0, int(image.max()).bit_length() - _BITS), dtype=np.uint8)


def _frames(source: str) -> Iterator[Picture]:
    """Yield the frames of a video, or of a camera until it is disconnected or Ctrl-C.

    Raises:
        SourceError: the source cannot be opened, or has no frames.
    """
    is_camera = source.isdecimal() or source.startswith("/dev/")
    if not is_camera and "://" not in source and not Path(source).is_file():
        raise SourceError(f"{source}: no such file or folder")
    number = int(source) if source.isdecimal() else -1
    capture = cv2.VideoCapture(number if 0 <= number < _MOST_CAMERAS else opencv_name(source))
    try:
        if not capture.isOpened():
            what = "no camera that opens" if is_camera else "neither an image nor a video"
            what = "no video comes from there" if "://" in source else what
            raise SourceError(f"{source}: {what}")
        start = time.perf_counter()
        rate = capture.get(cv2.CAP_PROP_FPS) or 30.0
        number = 0
        while True:
            ok, image = capture.read()
            if not ok:
                break
            t = time.perf_counter() - start if is_camera else number / rate
            grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            yield Picture(
                f"{source}#{number}", t, np.asarray(grey, dtype=np.uint8), number > 0, False
            )
            number += 1
        if number == 0:
            raise SourceError(f"{source}: no frames in it")
    finally:
        capture.release()


# ---- what was seen -----------------------------------------------------------------------------


def as_json(name: str, seen: Seen) -> dict[str, Any]:
    """Return the object that `--json` prints for one picture.

    Args:
        name: of the picture.
        seen: in the picture.
    """
    sightings, wrong = seen.sightings, seen.disagreement
    return {
        "image": name,
        "markers": [_marker(m) for m in sightings.markers],
        "pad": _pose(sightings.pad[0]) if sightings.pad else None,
        "lacks_plate": seen.lacks_plate,
        "other_id": sightings.other_id,
        "may_be_another": sightings.may_be_another,
        "disagreement": None if wrong is None else _disagreement(wrong),
        "other_markers": list(seen.others),
        "ms": round(seen.ms, 3),
    }


def _disagreement(wrong: Disagreement) -> dict[str, Any]:
    """Return the error that explains why markers contradict each other; angles in degrees."""
    marker, by = wrong.marker, wrong.by
    if wrong.what in ("tilt", "heading"):
        by = math.degrees(by)
    number = None if isinstance(marker, Ring) else marker.id
    return {
        "kind": marker.kind,
        "id": number,
        "what": wrong.what,
        "by": by,
        "text": wrong.text,
    }


def _marker(marker: MarkerSighting) -> dict[str, Any]:
    return {
        "kind": marker.kind,
        "id": marker.id,
        **_pose(marker.solutions[0]),
        "stage": marker.stage,
        "outline_px": [[round(x, 3), round(y, 3)] for x, y in marker.outline_px],
    }


def _pose(pose: PoseSolution) -> dict[str, Any]:
    """Return a pose for `--json`, camera frame: m, degrees, and standard deviations."""
    return {
        "position_m": list(pose.position),
        "yaw_deg": None if pose.north is None else yaw_deg(pose.normal, pose.north),
        "sigma_m": [math.sqrt(pose.covariance[i][i]) for i in range(3)],
        "sigma_yaw_deg": None if pose.sigma_yaw is None else math.degrees(pose.sigma_yaw),
        "normal": list(pose.normal),
    }


def yaw_deg(normal: Vec3, north: Vec3) -> float:
    """Return the heading of a marker or pad in the image, degrees, clockwise.

    The angle is measured in the pad's plane, from the image's upward direction to north.

    Args:
        normal: unit vector into the plane, away from the camera; camera frame.
        north: unit vector in the plane, camera frame.
    """
    up: Vec3 = (0.0, -1.0, 0.0)
    up = sub(up, scale(normal, dot(normal, up)))
    return math.degrees(math.atan2(dot(normal, cross(up, north)), dot(up, north)))


def _in_words(name: str, seen: Seen) -> str:
    """Return the line that is printed for one picture; arguments as those of `as_json`."""
    sightings = seen.sightings
    parts = []
    for m in sightings.markers:
        label = m.kind if m.id is None else f"{m.kind} {m.id}"
        parts.append(f"{label} at {_place(m.solutions[0])}")
    if sightings.pad:
        parts.append(f"pad at {_place(sightings.pad[0])}")
    if seen.lacks_plate:
        parts.append("not taken for the pad: its plate is not seen about it")
    if sightings.other_id is not None:
        parts.append(f"another pad: tag {sightings.other_id} lies beside its ring")
    if sightings.may_be_another:
        parts.append("may be another pad: its plate is cut by the picture's edge")
    if seen.disagreement is not None:
        parts.append(f"markers disagree: {seen.disagreement.text}")
    if seen.others:
        parts.append(f"not the pad's: {', '.join(seen.others)}")
    return f"{name}: {'; '.join(parts) or 'nothing found'} ({seen.ms:.1f} ms)"


def _place(pose: PoseSolution) -> str:
    """Return a pose in words, camera frame, with its largest standard deviation of position."""
    x, y, z = pose.position
    sigma = math.sqrt(max(pose.covariance[i][i] for i in range(3)))
    text = f"({x:.3f}, {y:.3f}, {z:.3f}) m, sigma {sigma:.3f} m"
    if pose.north is not None:
        text += f", yaw {yaw_deg(pose.normal, pose.north):.1f} deg"
    return text
