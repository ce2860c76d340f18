"""Draws sightings into the image they were seen in, for people to look at.

`landerd detect`, flight reports, videos of orders and `landerd sim` save such pictures; the live
view uses only `plate_edge`.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.messages import PoseSolution, Sightings
from landerd.pad import PadLayout
from landerd.vision.arrays import Image
from landerd.vision.plate_outline import plate_corners
from landerd.vision.pose import MIN_DEPTH_M, rotation_from

Colour = tuple[int, int, int]  # blue, green, red

_OUTLINE: Colour = (0, 220, 255)
_PAD: Colour = (255, 200, 0)
_NORTH: Colour = (60, 60, 255)
_EAST: Colour = (80, 220, 80)
_UP: Colour = (255, 120, 60)
_SHIFT = 4  # fractional bits of the coordinates OpenCV draws at: sixteenths of a pixel


def draw(image: Image, sightings: Sightings, camera: CameraModel, layout: PadLayout) -> Image:
    """Return a BGR picture (height, width, 3) of a grey image with the sightings drawn into it.

    Each marker is drawn as its outline, with its kind and id, range, largest sigma of position and
    sigma of yaw. The pad is drawn as its plate's edge and its axes at the landing point (north red,
    east green, up blue), with the same figures. Of a pad without heading only the axis up is drawn.
    """
    picture = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    size = max(0.5, min(camera.width, camera.height) / 960.0)
    for marker in sightings.markers:
        outline = np.array(marker.outline_px)
        _polygon(picture, outline, _OUTLINE)
        name = marker.kind if marker.id is None else f"{marker.kind} {marker.id}"
        low = outline.max(axis=0)
        at = (float(outline[:, 0].min()), float(low[1]) + 28.0 * size)
        _text(picture, at, f"{name} {_range(marker.solutions[0])}", _OUTLINE, size)
    if sightings.pad:
        _draw_pad(picture, sightings.pad[0], camera, layout, size)
    return picture


def _draw_pad(
    picture: Image, pad: PoseSolution, camera: CameraModel, layout: PadLayout, size: float
) -> None:
    t, normal = np.array(pad.position), np.array(pad.normal)
    length = 0.4 * min(layout.plate.east_m + layout.plate.west_m, float(t[2]))
    axes = [(-length * normal, _UP)]
    edge = plate_edge(pad, camera, layout)
    if edge is not None:
        _polygon(picture, edge, _PAD)
    if pad.north is not None:
        R = rotation_from(normal, np.array(pad.north))
        axes += [(length * R[:, 0], _NORTH), (length * R[:, 1], _EAST)]
    for axis, colour in axes:
        ends = np.array([t, t + axis])
        if ends[:, 2].min() > MIN_DEPTH_M:
            _line(picture, camera.pixels(ends), colour)
    _text(picture, (8.0, 32.0 * size), f"pad {_range(pad)}", _PAD, size)


def plate_edge(pad: PoseSolution, camera: CameraModel, layout: PadLayout) -> F64 | None:
    """Return the plate's corners (4, 2), px; None: heading unknown, or one is behind the lens.

    Args:
        pad: the pad's pose, camera frame.
        camera: the lens.
        layout: of the pad.
    """
    if pad.north is None:
        return None
    R = rotation_from(np.array(pad.normal), np.array(pad.north))
    points = np.array(pad.position) + plate_corners(layout.plate) @ R[:, :2].T
    return camera.pixels(points) if points[:, 2].min() > MIN_DEPTH_M else None


def _range(pose: PoseSolution) -> str:
    sigma = math.sqrt(max(pose.covariance[i][i] for i in range(3)))
    text = f"{math.dist(pose.position, (0.0, 0.0, 0.0)):.2f} m, sigma {_length(sigma)}"
    if pose.sigma_yaw is not None:
        text += f", {math.degrees(pose.sigma_yaw):.1f} deg"
    return text


def _length(metres: float) -> str:
    return f"{1e3 * metres:.1f} mm" if metres < 0.1 else f"{metres:.2f} m"


def _fixed(points: F64) -> NDArray[np.int32]:
    """Return points (n, 2), px, in sixteenths of a pixel, clipped to what OpenCV can draw."""
    return np.rint(np.clip(points, -2e4, 2e4) * (1 << _SHIFT)).astype(np.int32)


def _polygon(picture: Image, points: F64, colour: Colour) -> None:
    cv2.polylines(picture, [_fixed(points)], True, colour, 1, cv2.LINE_AA, _SHIFT)


def _line(picture: Image, ends: F64, colour: Colour) -> None:
    a, b = _fixed(ends).tolist()
    cv2.line(picture, tuple(a), tuple(b), colour, 2, cv2.LINE_AA, _SHIFT)


def _text(picture: Image, at: tuple[float, float], text: str, colour: Colour, size: float) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    x = int(min(max(at[0], 2.0), max(2.0, picture.shape[1] - width - 2.0)))
    y = int(min(max(at[1], height + 2.0), picture.shape[0] - 4.0))
    write(picture, (x, y), text, colour, size)


def write(picture: Image, at: tuple[int, int], text: str, colour: Colour, size: float) -> None:
    """Write a line of text on a darkened background into a BGR picture.

    The background is darkened, as an outline around letters this small shows as a ghost of them.

    Args:
        picture: (height, width, 3); changed in place.
        at: lower left corner of the text (x, y), px.
        text: the line.
        colour: of the letters.
        size: of the letters, in units of OpenCV's font scale.
    """
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    x, y = at
    ground = picture[max(0, y - height - 3) : y + below, max(0, x - 3) : x + width + 3]
    np.floor_divide(ground, 4, out=ground)
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
