"""Square markers (AprilTag, ArUco) in an image, found by OpenCV's detector."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.pad import PadLayout, Square
from landerd.vision.pose import Pose
from landerd.vision.print_fit import Fit
from landerd.vision.square_edges import SquareEdgeFit
from landerd.vision.window import Window

Image = NDArray[np.uint8]

MIN_SIDE_PX = 5.0
# Along a side of what a decoder reads: of 120 tags of 7 to 20 px none was seen below. To follow
# smaller outlines takes as long again where an image is full of them.
_MIN_CELL_PX = 1.2
# Sides of the threshold's window: least, most and step, tried in turn until all squares are seen.
# Where a pad is known to be the first mostly shows them.
_WINDOW_MEANS_PX = ((7, 7, 1), (21, 21, 1))
# A whole image gets OpenCV's own three at once; one full of texture one a search, in turn. Of 802
# tags in photographs the first alone shows 676, all four 719, among them the 713 of the three.
_WHOLE_MEANS_PX = ((3, 23, 10),)
_TEXTURE_MEANS_PX = ((17, 17, 1), (3, 3, 1), (13, 13, 1), (23, 23, 1))
# Share of an image's pixels at which black meets white under a threshold by a mean over such a
# side: the time goes with it. Above it the image is full of texture.
_MAX_EDGE_SHARE, _EDGE_MEAN_PX = 0.04, 17
_THRESHOLD_OFFSET = 7  # grey levels: OpenCV's own
_EVENED_LEVEL, _DARKEST = 110.0, 4.0  # grey levels: of a mean made even, and added against noise


@dataclass(frozen=True)
class FoundSquare:
    """A square marker of the pad seen in an image."""

    square: Square
    corners: F64  # (4, 2) px, top left first, clockwise as its makers print it
    # That found it where it was expected; None: it was detected.
    fit: Fit | SquareEdgeFit | None = None
    beside: Pose | None = None  # by `SquareBeside`: nothing but its heading is of the square


class SquareFinder:
    """Finds the square markers of one pad; other ids are not reported."""

    def __init__(self, layout: PadLayout) -> None:
        """Prepare a detector for each dictionary of the pad."""
        self._whole_searches = 0  # of textured images
        self._detectors: list[tuple[cv2.aruco.ArucoDetector, list[Square], int]] = []
        # Of all ids of a dictionary, with those of the pad.
        self._whole: dict[str, tuple[cv2.aruco.ArucoDetector, set[int]]] = {}
        for name in sorted({s.dictionary for s in layout.squares}):
            squares = [s for s in layout.squares if s.dictionary == name]
            whole = _dictionary(name)
            # Comparing every dark patch with hundreds of ids would take longer than finding it.
            ids = whole.bytesList[[s.id for s in squares]]
            known = cv2.aruco.Dictionary(ids, whole.markerSize, whole.maxCorrectionBits)
            self._detectors.append((cv2.aruco.ArucoDetector(known), squares, _turns(name)))
            self._whole[name] = cv2.aruco.ArucoDetector(whole), {s.id for s in squares}

    def find(
        self,
        image: Image,
        window: Window | None = None,
        scale: float = 1.0,
        smallest_px: float = MIN_SIDE_PX,
        *,
        evened_px: int | None = None,
    ) -> list[FoundSquare]:
        """Return the pad's squares in an image.

        Args:
            image: grey image (height, width).
            window: the part to search; None for all.
            scale: the search is done on an image enlarged by this, or reduced by about so much.
            smallest_px: shortest mean side that is looked for, in the enlarged image. The time goes
                with the number of outlines that are longer.
            evened_px: the light of the enlarged image is made even over so many pixels, that a
                shadow's edge across a square is none; None: not at all.
        """
        scale = _quickly_made(scale)
        x0, y0 = 0, 0
        means_px: Sequence[tuple[int, int, int]]
        if window is None:
            means_px = self._whole_means_px(image)
        else:
            x0, y0 = window.x0, window.y0
            image = image[window.y0 : window.y1, window.x0 : window.x1]
            means_px = _WINDOW_MEANS_PX
        if min(image.shape) < MIN_SIDE_PX:
            return []
        image = _scaled(image, scale)
        if evened_px is not None:
            image = _evened(image, evened_px)
        found: list[FoundSquare] = []
        for detector, squares, turn in self._detectors:
            cells = detector.getDictionary().markerSize + 2
            perimeter_rate = 4.0 * max(smallest_px, _MIN_CELL_PX * cells) / max(image.shape)
            parameters = [_parameters(perimeter_rate, means) for means in means_px]
            for number, corners in _detected(detector, parameters, image, len(squares)):
                px = _in_whole(corners, scale, (x0, y0))
                found.append(FoundSquare(squares[number], np.roll(px, turn, axis=0)))
        return found

    def find_others(
        self, image: Image, dictionary: str, window: Window, scale: float, smallest_px: float
    ) -> list[tuple[int, F64]]:
        """Return ids and corners (4, 2), px, of squares with other ids than the pad's.

        Only those whose cells are read without a single error: of a pad's own tag, hidden in part,
        another id is not far.

        Args:
            image: as of `find`, and what follows.
            dictionary: of the ids.
            window: the part to search.
            scale: enlargement.
            smallest_px: shortest mean side.
        """
        part = image[window.y0 : window.y1, window.x0 : window.x1]
        if min(part.shape) < MIN_SIDE_PX:
            return []
        part = _scaled(part, scale)
        parameters = _parameters(4.0 * smallest_px / max(part.shape), _WINDOW_MEANS_PX[1])
        parameters.errorCorrectionRate = 0.0
        detector, own = self._whole[dictionary]
        return [
            (number, _in_whole(corners, scale, (window.x0, window.y0)))
            for number, corners in _detected(detector, [parameters], part, 1)
            if number not in own
        ]

    def _whole_means_px(self, image: Image) -> Sequence[tuple[int, int, int]]:
        """Return the thresholds for a whole image: for one full of texture one, each in turn."""
        if not is_textured(image):
            return _WHOLE_MEANS_PX
        which = self._whole_searches % len(_TEXTURE_MEANS_PX)
        self._whole_searches += 1
        return _TEXTURE_MEANS_PX[which : which + 1]


def is_textured(image: Image) -> bool:
    """Tell whether an image (height, width) is so full of edges that looking for squares is dear.

    What is counted is the same on any machine.
    """
    dark = cv2.adaptiveThreshold(
        image,
        255,
        cv2.ADAPTIVE_THRESH_MEAN_C,
        cv2.THRESH_BINARY_INV,
        _EDGE_MEAN_PX,
        _THRESHOLD_OFFSET,
    )
    edges = cv2.countNonZero(cv2.bitwise_xor(dark[:, 1:], dark[:, :-1]))
    return edges > _MAX_EDGE_SHARE * image.size


def _in_whole(corners: F64, scale: float, offset_px: tuple[int, int]) -> F64:
    """Return where corners (4, 2) of an enlarged part are in the whole image, px."""
    return (corners + 0.5) / scale - 0.5 + offset_px


def _quickly_made(scale: float) -> float:
    """Return about such an enlargement of an image, one that is made in no time.

    To reduce an image by anything but halving it takes longer than to look for squares in it.
    """
    return scale if scale >= 1.0 else 2.0 ** round(math.log2(scale))


def _scaled(image: Image, scale: float) -> Image:
    """Return an image enlarged by this, `_quickly_made`."""
    if scale > 1.0:
        larger = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        return np.asarray(larger, dtype=np.uint8)
    for _ in range(round(-math.log2(scale))):
        h, w = image.shape[0] // 2, image.shape[1] // 2
        if min(h, w) > 0:
            even = image[: 2 * h, : 2 * w]
            image = np.asarray(cv2.resize(even, (w, h), interpolation=cv2.INTER_AREA), np.uint8)
    return image


def _evened(image: Image, width_px: int) -> Image:
    """Return an image over its mean of so many pixels, which becomes a middle grey."""
    grey = image.astype(np.float32) + _DARKEST
    even = grey * (_EVENED_LEVEL / cv2.blur(grey, (width_px, width_px)))
    return np.asarray(np.clip(even, 0.0, 255.0), dtype=np.uint8)


def _detected(
    detector: cv2.aruco.ArucoDetector,
    parameters: list[cv2.aruco.DetectorParameters],
    image: Image,
    count: int,
) -> Iterator[tuple[int, F64]]:
    """Yield number and corners (4, 2), px, of markers; ends when `count` numbers were seen.

    A number that one set of parameters shows twice comes twice, that a later one shows again not.
    """
    seen: set[int] = set()
    for with_these in parameters:
        detector.setDetectorParameters(with_these)
        quads, ids, _ = detector.detectMarkers(image)
        numbers = [] if ids is None else [int(i) for i in ids.reshape(-1)]
        for quad, number in zip(quads, numbers, strict=True):
            if number not in seen:
                yield number, quad.reshape(4, 2).astype(np.float64)
        seen.update(numbers)
        if len(seen) == count:
            return


def printed_cells(square: Square) -> NDArray[np.bool_]:
    """Return a marker's print (n, n), border included, top row first; True is white."""
    dictionary = _dictionary(square.dictionary)
    n = dictionary.markerSize + 2
    cells = cv2.aruco.generateImageMarker(dictionary, square.id, n) > 127
    return np.rot90(cells, _turns(square.dictionary))


def _turns(name: str) -> int:
    """Return by how many quarter turns OpenCV's print stands wrong.

    OpenCV holds the AprilTag families upside down: its first corner is the bottom right one of
    the tag as the AprilTag project prints it.
    """
    return 2 if name.upper().startswith("APRILTAG") else 0


def _parameters(
    perimeter_rate: float, means_px: tuple[int, int, int]
) -> cv2.aruco.DetectorParameters:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.minMarkerPerimeterRate = perimeter_rate
    parameters.minDistanceToBorder = 1
    least, most, step = means_px
    parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax = least, most
    parameters.adaptiveThreshWinSizeStep = step
    return parameters


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
