"""Messages in the JSON schemas that Foxglove and Lichtblick draw without any set-up.

Field names are those of github.com/foxglove/foxglove-sdk (schemas/jsonschema); only the fields in
use are listed in the schemas. The root frame `map` has z up; `local` is the autopilot's NED.
"""

import base64
import math
from typing import Any

from landerd.camera_model import CameraModel
from landerd.geometry import Mat3, Vec3
from landerd.messages import MarkerSighting

_NUMBER, _INTEGER, _TEXT = {"type": "number"}, {"type": "integer"}, {"type": "string"}


def _object(title: str, **properties: Any) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties}


def _list(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


_TIME = _object("time", sec=_INTEGER, nsec=_INTEGER)
_POINT2 = _object("foxglove.Point2", x=_NUMBER, y=_NUMBER)
_VECTOR3 = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_COLOR = _object("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)

SCHEMAS = {
    schema["title"]: schema
    for schema in (
        _object(
            "foxglove.CompressedImage",
            timestamp=_TIME,
            frame_id=_TEXT,
            data={"type": "string", "contentEncoding": "base64"},
            format=_TEXT,
        ),
        _object(
            "foxglove.CameraCalibration",
            timestamp=_TIME,
            frame_id=_TEXT,
            width=_INTEGER,
            height=_INTEGER,
            distortion_model=_TEXT,
            D=_list(_NUMBER),
            K=_list(_NUMBER),
            R=_list(_NUMBER),
            P=_list(_NUMBER),
        ),
        _object(
            "foxglove.FrameTransform",
            timestamp=_TIME,
            parent_frame_id=_TEXT,
            child_frame_id=_TEXT,
            translation=_VECTOR3,
            rotation=_QUATERNION,
        ),
        _object(
            "foxglove.ImageAnnotations",
            circles=_list({"type": "object"}),
            points=_list(
                _object(
                    "foxglove.PointsAnnotation",
                    timestamp=_TIME,
                    type=_INTEGER,
                    points=_list(_POINT2),
                    outline_color=_COLOR,
                    outline_colors=_list(_COLOR),
                    fill_color=_COLOR,
                    thickness=_NUMBER,
                )
            ),
            texts=_list(
                _object(
                    "foxglove.TextAnnotation",
                    timestamp=_TIME,
                    position=_POINT2,
                    text=_TEXT,
                    font_size=_NUMBER,
                    text_color=_COLOR,
                    background_color=_COLOR,
                )
            ),
        ),
        _object(
            "foxglove.Log",
            timestamp=_TIME,
            level=_INTEGER,
            message=_TEXT,
            name=_TEXT,
            file=_TEXT,
            line=_INTEGER,
        ),
        _object(
            "foxglove.SceneUpdate",
            deletions=_list({"type": "object"}),
            entities=_list(
                _object(
                    "foxglove.SceneEntity",
                    timestamp=_TIME,
                    frame_id=_TEXT,
                    id=_TEXT,
                    lifetime=_TIME,
                    frame_locked={"type": "boolean"},
                    cubes=_list({"type": "object"}),
                    cylinders=_list({"type": "object"}),
                )
            ),
        ),
    )
}

INFO, WARNING, ERROR = 2, 3, 4  # foxglove.Log levels
_LINE_LOOP = 2
_OUTLINE = {"r": 1.0, "g": 0.86, "b": 0.0, "a": 1.0}
_CLEAR = {"r": 0.0, "g": 0.0, "b": 0.0, "a": 0.0}
_SHADE = {"r": 0.0, "g": 0.0, "b": 0.0, "a": 0.6}

NED_IN_MAP: Mat3 = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))


def image(ns: int, data: bytes, format_: str) -> dict[str, Any]:
    """Return a foxglove.CompressedImage."""
    text = base64.b64encode(data).decode()
    return {"timestamp": timestamp(ns), "frame_id": "camera", "data": text, "format": format_}


def image_bytes(message: dict[str, Any]) -> bytes:
    """Return the compressed bytes of a foxglove.CompressedImage."""
    return base64.b64decode(message["data"])


def calibration(ns: int, camera: CameraModel) -> dict[str, Any]:
    """Return a foxglove.CameraCalibration."""
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    model = "rational_polynomial" if len(camera.distortion) > 5 else "plumb_bob"
    return {
        "timestamp": timestamp(ns),
        "frame_id": "camera",
        "width": camera.width,
        "height": camera.height,
        "distortion_model": "kannala_brandt" if camera.fisheye else model,
        "D": list(camera.distortion) or [0.0] * 5,
        "K": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "P": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def transform(ns: int, parent: str, child: str, origin: Vec3, R: Mat3) -> dict[str, Any]:
    """Return a foxglove.FrameTransform: origin and axes of child in parent (R_parent_child)."""
    w, x, y, z = _quaternion(R)
    return {
        "timestamp": timestamp(ns),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": {"x": origin[0], "y": origin[1], "z": origin[2]},
        "rotation": {"x": x, "y": y, "z": z, "w": w},
    }


def annotations(ns: int, markers: tuple[MarkerSighting, ...]) -> dict[str, Any]:
    """Return a foxglove.ImageAnnotations with each marker's outline and name."""
    time = timestamp(ns)
    points, texts = [], []
    for marker in markers:
        outline = [{"x": x, "y": y} for x, y in marker.outline_px]
        if not outline:
            continue
        points.append(
            {
                "timestamp": time,
                "type": _LINE_LOOP,
                "points": outline,
                "outline_color": _OUTLINE,
                "outline_colors": [],
                "fill_color": _CLEAR,
                "thickness": 2.0,
            }
        )
        texts.append(
            {
                "timestamp": time,
                "position": max(outline, key=lambda p: p["y"]),
                "text": marker.kind if marker.id is None else f"{marker.kind} {marker.id}",
                "font_size": 12.0,
                "text_color": _OUTLINE,
                "background_color": _SHADE,
            }
        )
    return {"circles": [], "points": points, "texts": texts}


def event(ns: int, level: int, text: str) -> dict[str, Any]:
    """Return a foxglove.Log."""
    return {
        "timestamp": timestamp(ns),
        "level": level,
        "message": text,
        "name": "landerd",
        "file": "",
        "line": 0,
    }


def timestamp(ns: int) -> dict[str, int]:
    """Return a time as Foxglove's schemas have it."""
    return {"sec": ns // 1_000_000_000, "nsec": ns % 1_000_000_000}


def _quaternion(R: Mat3) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of a rotation, by its largest component (Shepperd 1978)."""
    xx, yy, zz = R[0][0], R[1][1], R[2][2]
    squares = (1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz)
    largest = max(squares)
    s = 2.0 * math.sqrt(largest)
    half = 0.25 * s
    a, b, c = (R[2][1] - R[1][2]) / s, (R[0][2] - R[2][0]) / s, (R[1][0] - R[0][1]) / s
    d, e, f = (R[0][1] + R[1][0]) / s, (R[0][2] + R[2][0]) / s, (R[1][2] + R[2][1]) / s
    return ((half, a, b, c), (a, half, d, e), (b, d, half, f), (c, e, f, half))[
        squares.index(largest)
    ]
