"""Other people's detectors, to which benchmarks compare landerd's vision, and what counts as found.

These are OpenCV's, the AprilTag 3 library (pip install 'landerd[peers]') and any program that finds
rings. The last two are used if they are there.
"""

import contextlib
import importlib
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel
from landerd.pad import Square
from tests.vision import scenes

U8 = NDArray[np.uint8]
F64 = NDArray[np.float64]
Squares = list[tuple[int, F64]]  # id and corners (4, 2), px

FAMILIES = {"APRILTAG_36h11": "tag36h11", "APRILTAG_25h9": "tag25h9", "APRILTAG_16h5": "tag16h5"}
FOUND_SHARE = 0.1  # largest error of the position of a marker that counts as found, over the range
_TIMEOUT_S = 60.0  # of the program for rings, for one picture


def opencv(image: U8, dictionary: str) -> Squares:
    """Return the squares that OpenCV finds at its default settings.

    Args:
        image: grey image (height, width).
        dictionary: of the squares, named as in a pad file.
    """
    table = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    quads, ids, _ = cv2.aruco.ArucoDetector(table).detectMarkers(image)
    numbers = [] if ids is None else ids.ravel().tolist()
    outlines = [np.asarray(q, dtype=np.float64).reshape(4, 2) for q in quads]
    return [(int(i), o) for i, o in zip(numbers, outlines, strict=True)]


class AprilTag3:
    """The AprilTag 3 library on one thread.

    Raises:
        ImportError: it is not installed.
    """

    def __init__(self, quad_decimate: float = 1.0) -> None:
        """Prepare; quadrilaterals are looked for in a picture that is this many times smaller."""
        self._library = importlib.import_module("pupil_apriltags")
        self._quad_decimate = quad_decimate
        self._detectors: dict[str, Any] = {}

    def squares(self, image: U8, dictionary: str) -> Squares | None:
        """Return the squares of a dictionary, named as in a pad file; None: no such family."""
        family = FAMILIES.get(dictionary)
        if family is None:
            return None
        if family not in self._detectors:
            self._detectors[family] = self._library.Detector(
                families=family, nthreads=1, quad_decimate=self._quad_decimate
            )
        # Its corners run in the opposite direction to OpenCV's, and its origin is the corner of the
        # first pixel, not the centre.
        found = self._detectors[family].detect(image)
        return [(d.tag_id, np.array(d.corners)[::-1] - 0.5) for d in found]


@cache
def quick() -> AprilTag3:
    """Return the AprilTag 3 library with the fast settings to which times are compared.

    Raises:
        SystemExit: it is not installed.
    """
    try:
        return AprilTag3(quad_decimate=2.0)
    except ImportError:
        raise SystemExit("needs the AprilTag 3 library: pip install 'landerd[peers]'") from None


def rings(program: Path, image: U8, inner_ratio: float, most: int) -> list[tuple[float, float]]:
    """Return the centres of rings, px, that a program finds.

    Args:
        program: called with the file of a grey picture (PGM), the ratio of the ring's diameters and
            the largest number of rings; it prints "x y" of each ring.
        image: grey image (height, width).
        inner_ratio: inner over outer diameter of the ring.
        most: largest number of rings.
    """
    with tempfile.NamedTemporaryFile(suffix=".pgm") as file:
        height, width = image.shape
        file.write(b"P5\n%d %d\n255\n" % (width, height) + image.tobytes())
        file.flush()
        call = [str(program), file.name, f"{inner_ratio:.4f}", str(most)]
        out = subprocess.run(call, capture_output=True, text=True, timeout=_TIMEOUT_S, check=True)
    rows = [line.split() for line in out.stdout.splitlines()]
    return [(float(row[0]), float(row[1])) for row in rows if len(row) > 1]


@cache
def of_squares() -> dict[str, Callable[[U8, str], Squares | None]]:
    """Return the detectors of squares that are installed, by name."""
    detectors: dict[str, Callable[[U8, str], Squares | None]] = {"OpenCV": opencv}
    with contextlib.suppress(ImportError):
        detectors["AprilTag 3"] = AprilTag3().squares
    return detectors


def is_tag(squares: Squares, tag: Square, view: scenes.View, camera: CameraModel) -> bool:
    """Tell whether a tag of the pad is among squares, at the right position.

    Its position by the pose from its corners may be wrong by FOUND_SHARE of the range.

    Args:
        squares: that a detector found.
        tag: of the pad.
        view: true pose of the pad.
        camera: the lens.
    """
    truth = np.array(view.position) + view.R_camera_pad @ np.array([*tag.position_m, 0.0])
    turn = np.array([(-1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (-1.0, -1.0, 0.0)])
    for number, outline in squares:
        if number != tag.id:
            continue
        corners, rays = 0.5 * tag.size_m * turn, camera.rays(outline)
        solver = cv2.SOLVEPNP_IPPE_SQUARE
        is_solved, _, t = cv2.solvePnP(corners, rays, np.eye(3), np.zeros(5), flags=solver)
        error = float(np.linalg.norm(np.asarray(t).ravel() - truth))
        if is_solved and error <= FOUND_SHARE * float(np.linalg.norm(truth)):
            return True
    return False


def is_ring(found: list[tuple[float, float]], view: scenes.View, camera: CameraModel) -> bool:
    """Tell whether the pad's ring is among centres that were found, px.

    Its centre may be wrong by FOUND_SHARE of the range, across the line of sight.
    """
    truth = np.array(view.position)
    scale = camera.focal / float(truth[2])  # px per metre
    reach = FOUND_SHARE * float(np.linalg.norm(truth)) * scale
    at = camera.pixels(truth[None])[0]
    return any(float(np.hypot(x - at[0], y - at[1])) <= reach for x, y in found)
