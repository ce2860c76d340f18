"""Detection of square markers (AprilTag, ArUco) in an image or a window by OpenCV's detector.

In a window, where a pad is known to be, two thresholds are tried in turn. A whole image is looked
at in several ways that take turns from one search to the next (`SquareFinder._whole_looks`), as all
of them together would cost too much. `square_fit` gives a detected square its pose.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, Window
from landerd.pad import PadLayout, Square
from landerd.vision.arrays import Image
from landerd.vision.pose import Pose
from landerd.vision.print_edges import EdgeFit
from landerd.vision.print_fit import Fit

# ---- sizes and cells ---------------------------------------------------------------------------
MIN_SIDE_PX = 5.0
_CLEAR_SIDE_PX = 16.0  # least side of other squares than the pad's that are told
# Least width of a cell, px: of 120 tags of 7 to 20 px none with smaller cells was decoded.
# Following smaller outlines takes as long again in an image that is full of them.
_MIN_CELL_PX = 1.2
# Samples along a cell, and the share of them at either end that is ignored. Where a cell is hardly
# larger than the error of the corners, outer samples belong to the next cell: of 802 tags in
# photographs all four of OpenCV's own samples along a cell show 719, the middle one of three 765.
_CELL_MIDDLE = 3, 0.34
# The same where cells are large: all of a cell, as dirt may hide its middle.
_WHOLE_CELL = 4, 0.13

# ---- looks -------------------------------------------------------------------------------------
# Sides of the adaptive threshold's surroundings, px, tried in turn in a window until all squares
# are seen. Where a pad is known to be, the first mostly shows them.
_WINDOW_MEANS_PX = (7, 21)
# The same with samples of a cell for a whole image: one in each search, in turn, and the first in
# every search of an image that is not full of texture. That alone shows 743 of those 802 tags.
_WHOLE_MEANS_PX = ((23, _CELL_MIDDLE), (3, _CELL_MIDDLE), (13, _WHOLE_CELL), (17, _WHOLE_CELL))
# Outlines follow whole pixels, so those of small tags are more exact in an enlarged image. A
# quarter of the image, enlarged twice, takes no longer than the whole: between two looks at the
# whole, one quarter is looked at, each in turn. Together they show 792 of the 802, and all but one
# of the 791 that OpenCV or the AprilTag 3 library shows.
_ENLARGED, _QUARTER_MEANS_PX = 2.0, (23, 5)
_ENLARGED_CELL_PX = 2.0  # least width of a cell there, px of the enlarged image
_OVERLAP_PX = 16  # by which a quarter reaches beyond the middle of the image
# One more look in turn, with light made even over this many pixels. Without it parts of a square's
# white and black are taken for each other where an arm's shadow, a drop on the lens or a flickering
# lamp's band lies across it. Only for cells at least this large, px: dim texture made even is full
# of outlines. Of 32 pads of one square that no other look showed, 1 to 8 m away in shadow, gloss,
# grass and leaves, it shows 9.
_EVEN_LIGHT_PX, _EVEN_LIGHT_MEANS_PX, _EVEN_LIGHT_CELL_PX = 51, (13,), 4.0
_EVENED_LEVEL, _DARKEST = 110.0, 4  # grey levels: of an evened mean, and added against noise

# ---- texture -----------------------------------------------------------------------------------
# An image is full of texture if at more than this share of its pixels black meets white, under a
# threshold by a mean of this side, px: the time of a search grows with that share.
_MAX_EDGE_SHARE, _EDGE_MEAN_PX = 0.04, 17
_THRESHOLD_OFFSET = 7  # grey levels: OpenCV's own


@dataclass(frozen=True)
class _Look:
    """A part of an image, and how squares are looked for in it."""

    window: Window
    scale: float  # enlargement, as `_quickly_made` returns it
    means_px: tuple[int, ...]  # sides of the threshold's surroundings, tried in turn
    min_cell_px: float = _MIN_CELL_PX  # in the enlarged part
    cell: tuple[int, float] = _CELL_MIDDLE  # samples of a cell, and share ignored at either end
    evened_px: int | None = None  # see `SquareFinder.find`

    def part(self, image: Image) -> Image:
        """Return the part of an image, enlarged and, if asked for, evened; may be empty."""
        w = self.window
        part = _scaled(image[w.y0 : w.y1, w.x0 : w.x1], self.scale)
        return part if self.evened_px is None or part.size == 0 else _evened(part, self.evened_px)

    def in_whole(self, corners: F64) -> F64:
        """Return where corners (4, 2) of the enlarged part are in the whole image, px."""
        return _in_whole(corners, self.scale, (self.window.x0, self.window.y0))


@dataclass(frozen=True)
class FoundSquare:
    """A square marker of the pad seen in an image."""

    square: Square
    corners: F64  # (4, 2) px, top left first, clockwise as its makers print it
    # The fit that found it where it was expected; None: it was detected.
    fit: Fit | EdgeFit | None = None
    # Its pose if `SquareBeside` found it: only the heading was measured on the square.
    beside: Pose | None = None


class SquareFinder:
    """Finds the square markers of one pad; other ids are not reported."""

    def __init__(self, layout: PadLayout) -> None:
        """Prepare a detector for each dictionary of the pad."""
        self._count = len(layout.squares)
        self._whole_searches = 0
        self._textured: tuple[Image, bool] | None = None  # see `is_textured`
        # For each dictionary: a detector of the pad's ids, the pad's squares, and the order that
        # turns OpenCV's corners into that of the marker's makers.
        self._detectors: list[tuple[cv2.aruco.ArucoDetector, list[Square], list[int]]] = []
        # For each dictionary: a detector of all its ids, and the pad's ids.
        self._whole: dict[str, tuple[cv2.aruco.ArucoDetector, set[int]]] = {}
        for name in sorted({s.dictionary for s in layout.squares}):
            squares = [s for s in layout.squares if s.dictionary == name]
            whole = _dictionary(name)
            # Comparing every dark patch with hundreds of ids would take longer than finding it.
            ids = whole.bytesList[[s.id for s in squares]]
            known = cv2.aruco.Dictionary(ids, whole.markerSize, whole.maxCorrectionBits)
            first = [(corner - _turns(name)) % 4 for corner in range(4)]
            self._detectors.append((cv2.aruco.ArucoDetector(known), squares, first))
            self._whole[name] = cv2.aruco.ArucoDetector(whole), {s.id for s in squares}

    def is_textured(self, image: Image) -> bool:
        """See `is_textured`.

        Kept for the search of the same image that may follow, as it takes a tenth of that.
        """
        self._textured = image, is_textured(image)
        return self._textured[1]

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
            scale: the window is searched enlarged by this, or reduced by about as much.
            smallest_px: shortest mean side that is looked for, px of the enlarged image. The time
                grows with the number of longer outlines.
            evened_px: side of the surroundings, px of the enlarged image, over which light is made
                even, so that a shadow's edge across a square vanishes; None: light is left.
        """
        if window is None:
            looks = self._whole_looks(image)
        else:
            scale = _quickly_made(scale)
            looks = [_Look(window, scale, _WINDOW_MEANS_PX, evened_px=evened_px)]
        found: list[FoundSquare] = []
        for look in looks:
            if len({f.square for f in found}) == self._count:
                break
            part = look.part(image)
            if min(part.shape) < MIN_SIDE_PX:
                continue
            for means_px in look.means_px:
                found += self._looked(look, part, means_px, smallest_px, {f.square for f in found})
        return found

    def _looked(
        self, look: _Look, part: Image, means_px: int, smallest_px: float, known: set[Square]
    ) -> list[FoundSquare]:
        """Return squares in a part of an image that are not known yet; one may occur twice."""
        found = []
        for detector, squares, first in self._detectors:
            if known.issuperset(squares):
                continue
            cells = detector.getDictionary().markerSize + 2
            side_px = max(smallest_px, look.min_cell_px * cells)
            parameters = _parameters(4.0 * side_px / max(part.shape), means_px, look.cell)
            for number, corners in _detected(detector, parameters, part):
                if squares[number] not in known:
                    px = look.in_whole(corners)[first]
                    found.append(FoundSquare(squares[number], px))
        return found

    def find_others(
        self, image: Image, dictionary: str, window: Window, scale: float, smallest_px: float
    ) -> list[tuple[int, F64]]:
        """Return ids and corners (4, 2), px, of squares with other ids than the pad's.

        Only those whose cells are read without any error: the pad's own tag, hidden in part, may be
        within a few errors of another id.

        Args:
            image: grey image (height, width).
            dictionary: of the ids.
            window: the part to search.
            scale: enlargement.
            smallest_px: shortest mean side that is looked for, px of the enlarged image.
        """
        part = image[window.y0 : window.y1, window.x0 : window.x1]
        if min(part.shape) < MIN_SIDE_PX:
            return []
        part = _scaled(part, scale)
        detector, own = self._whole[dictionary]
        return [
            (number, _in_whole(corners, scale, (window.x0, window.y0)))
            for number, corners in _without_error(detector, part, _WINDOW_MEANS_PX[1], smallest_px)
            if number not in own
        ]

    def _whole_looks(self, image: Image) -> list[_Look]:
        """Return how this search looks at a whole image.

        One look in turn, which is at a quarter in every second search; and the first look as well,
        unless the image is full of texture.
        """
        search = self._whole_searches
        self._whole_searches += 1
        height, width = image.shape
        whole = Window(0, 0, width, height)
        first, *others = (
            _Look(whole, 1.0, (means_px,), cell=cell) for means_px, cell in _WHOLE_MEANS_PX
        )
        means_px, cell_px = _EVEN_LIGHT_MEANS_PX, _EVEN_LIGHT_CELL_PX
        others.append(_Look(whole, 1.0, means_px, cell_px, _WHOLE_CELL, _EVEN_LIGHT_PX))
        kept, self._textured = self._textured, None
        if kept is None or kept[0] is not image:
            kept = image, is_textured(image)
        is_even = not kept[1]
        wholes = others if is_even else [first, *others]
        turn, is_quarter = divmod(search, 2)
        in_turn = _quarter(whole, turn) if is_quarter else wholes[turn % len(wholes)]
        return [first, in_turn] if is_even else [in_turn]


def _quarter(whole: Window, turn: int) -> _Look:
    """Return a look at one of a whole image's quarters, each in turn, enlarged."""
    x, y = (whole.x1 + 1) // 2, (whole.y1 + 1) // 2
    turn, quarter = divmod(turn, 4)
    row, column = divmod(quarter, 2)
    left, top = column * (x - _OVERLAP_PX), row * (y - _OVERLAP_PX)
    part = Window(left, top, left + x + _OVERLAP_PX, top + y + _OVERLAP_PX)
    means_px = _QUARTER_MEANS_PX[turn % len(_QUARTER_MEANS_PX)]
    return _Look(part.within(whole.x1, whole.y1), _ENLARGED, (means_px,), _ENLARGED_CELL_PX)


def is_textured(image: Image) -> bool:
    """Tell whether an image (height, width) is so full of edges that a search takes long.

    Edges are counted instead of time, so that the answer is the same on any machine.
    """
    # The same as cv2.adaptiveThreshold, in half the time.
    side_px = (_EDGE_MEAN_PX, _EDGE_MEAN_PX)
    mean = cv2.blur(image, side_px, borderType=cv2.BORDER_REPLICATE)
    off = _THRESHOLD_OFFSET - 1
    dark = cv2.compare(image, np.maximum(mean, off) - off, cv2.CMP_LT)
    edges = cv2.countNonZero(cv2.bitwise_xor(dark[:, 1:], dark[:, :-1]))
    return edges > _MAX_EDGE_SHARE * image.size


def _in_whole(corners: F64, scale: float, offset_px: tuple[int, int]) -> F64:
    """Return where corners (4, 2) of an enlarged part are in the whole image, px."""
    return (corners + 0.5) / scale - 0.5 + offset_px


def _quickly_made(scale: float) -> float:
    """Return a scale near this one at which an image is quickly made.

    Reducing an image by anything but repeated halving takes longer than searching it for squares.
    """
    return scale if scale >= 1.0 else 2.0 ** round(math.log2(scale))


def _scaled(image: Image, scale: float) -> Image:
    """Return an image enlarged by a scale that is `_quickly_made`."""
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
    """Return an image over its local mean (side in px), which becomes a middle grey."""
    grey = np.minimum(image, 255 - _DARKEST) + np.uint8(_DARKEST)
    even = cv2.divide(grey, cv2.blur(grey, (width_px, width_px)), scale=_EVENED_LEVEL)
    return np.asarray(even, dtype=np.uint8)


def _detected(
    detector: cv2.aruco.ArucoDetector, parameters: cv2.aruco.DetectorParameters, image: Image
) -> Iterator[tuple[int, F64]]:
    """Yield index in the detector's dictionary and corners (4, 2), px; an index may come twice."""
    detector.setDetectorParameters(parameters)
    quads, ids, _ = detector.detectMarkers(image)
    numbers = [] if ids is None else [int(i) for i in ids.reshape(-1)]
    for quad, number in zip(quads, numbers, strict=True):
        yield number, quad.reshape(4, 2).astype(np.float64)


def printed_cells(square: Square) -> NDArray[np.bool_]:
    """Return a marker's print (n, n), border included, top row first; True is white."""
    dictionary = _dictionary(square.dictionary)
    n = dictionary.markerSize + 2
    cells = cv2.aruco.generateImageMarker(dictionary, square.id, n) > 127
    return np.rot90(cells, _turns(square.dictionary))


def _turns(name: str) -> int:
    """Return by how many quarter turns OpenCV's print of a dictionary must be turned.

    OpenCV holds the AprilTag families upside down: its first corner is the bottom right one of
    the tag as the AprilTag project prints it.
    """
    return 2 if name.upper().startswith("APRILTAG") else 0


def _without_error(
    detector: cv2.aruco.ArucoDetector, image: Image, means_px: int, smallest_px: float
) -> Iterator[tuple[int, F64]]:
    """Yield the same of squares all of whose cells are read without an error."""
    parameters = _parameters(4.0 * smallest_px / max(image.shape), means_px)
    parameters.errorCorrectionRate = 0.0
    return _detected(detector, parameters, image)


def clear_ids(image: Image, dictionary: str) -> list[int]:
    """Return the ids of the squares of a dictionary that are clear to see in an image.

    Those are read without an error under two thresholds; texture shows them under one at most.

    Args:
        image: grey image (height, width).
        dictionary: by OpenCV's name without DICT_.
    """
    detector = cv2.aruco.ArucoDetector(_dictionary(dictionary))
    seen = Counter(
        number
        for means_px, _ in _WHOLE_MEANS_PX
        for number in {n for n, _ in _without_error(detector, image, means_px, _CLEAR_SIDE_PX)}
    )
    return sorted(number for number, times in seen.items() if times > 1)


def _parameters(
    perimeter_rate: float, means_px: int, cell: tuple[int, float] = _CELL_MIDDLE
) -> cv2.aruco.DetectorParameters:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.minMarkerPerimeterRate = perimeter_rate
    parameters.minDistanceToBorder = 0
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = means_px
    samples, margin = cell
    parameters.perspectiveRemovePixelPerCell = samples
    parameters.perspectiveRemoveIgnoredMarginPerCell = margin
    return parameters


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
