"""Calibration boards, and their corners in pictures: a chessboard, or a ChArUco board.

The white squares of a ChArUco board carry ArUco markers, so that parts of it can be recognised.
"""

from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64

_FEWEST_CORNERS = 8  # least number of corners of a board that is partly in the picture


@dataclass(frozen=True)
class View:
    """The corners of a board that one picture shows."""

    name: str  # of the picture
    ids: NDArray[np.int_]  # of the corners, counted along the rows, (n,)
    corners_px: F64  # (n, 2)


class Board(Protocol):
    """A flat board with corners at known places."""

    def corners_m(self, ids: NDArray[np.int_]) -> F64:
        """Return the positions of corners on the board, m, (n, 3), z = 0."""
        ...

    def find(self, name: str, image: NDArray[np.uint8]) -> View | None:
        """Return the corners in a grey picture (height, width) of a name; None: too few."""
        ...


@dataclass(frozen=True)
class Chessboard:
    """A chessboard, which must be in the picture as a whole."""

    columns: int  # inner corners along a row
    rows: int  # inner corners along a column
    square_m: float

    def corners_m(self, ids: NDArray[np.int_]) -> F64:
        """Return the positions of corners on the board, m, (n, 3), z = 0."""
        grid = np.stack([ids % self.columns, ids // self.columns, np.zeros_like(ids)], axis=1)
        return self.square_m * grid.astype(np.float64)

    def find(self, name: str, image: NDArray[np.uint8]) -> View | None:
        """Return all corners in a grey picture; None: they are not all seen."""
        found, corners = cv2.findChessboardCornersSB(
            image, (self.columns, self.rows), flags=cv2.CALIB_CB_ACCURACY
        )
        if not found:
            return None
        ids = np.arange(self.columns * self.rows)
        # Without refinement they are wrong by up to 0.1 px if the board is tilted.
        return View(name, ids, _refined(image, np.asarray(corners), self.columns))


def _refined(image: NDArray[np.uint8], corners: NDArray[Any], columns: int) -> F64:
    """Return the saddle points of brightness next to corners, px, (n, 2).

    Args:
        image: grey picture (height, width).
        corners: as found, px, row by row.
        columns: number of corners in a row.
    """
    grid = corners.reshape(-1, columns, 2)
    gaps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)]
    half = int(np.clip(0.25 * min(gaps), 2, 6))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    start = corners.reshape(-1, 1, 2).astype(np.float32)
    refined = cv2.cornerSubPix(image, start, (half, half), (-1, -1), stop)
    return np.asarray(refined, np.float64).reshape(-1, 2)


@dataclass(frozen=True)
class Charuco:
    """A ChArUco board; it may reach beyond the picture, so that corners reach the edges of it."""

    columns: int  # squares along a row
    rows: int  # squares along a column
    square_m: float
    marker_m: float  # side of a marker
    dictionary: str  # of the markers, like "4X4_50"
    _board: cv2.aruco.CharucoBoard = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make OpenCV's board. Raises ValueError: unknown dictionary, or sizes that do not fit."""
        number = getattr(cv2.aruco, f"DICT_{self.dictionary}", None)
        if number is None:
            raise ValueError(f"dictionary {self.dictionary!r} is not known, expected as 4X4_50")
        if not 0.0 < self.marker_m < self.square_m:
            raise ValueError("the markers must be smaller than the squares")
        markers = cv2.aruco.getPredefinedDictionary(number)
        size = (self.columns, self.rows)
        try:
            board = cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, markers)
        except cv2.error:
            raise ValueError(
                f"a board of {self.columns}x{self.rows} squares has more markers than "
                f"{self.dictionary}"
            ) from None
        object.__setattr__(self, "_board", board)

    def corners_m(self, ids: NDArray[np.int_]) -> F64:
        """Return the positions of corners on the board, m, (n, 3), z = 0."""
        return np.asarray(self._board.getChessboardCorners(), np.float64)[ids]

    def find(self, name: str, image: NDArray[np.uint8]) -> View | None:
        """Return the corners in a grey picture; None: fewer than eight, or all on one line."""
        corners, ids, _, _ = cv2.aruco.CharucoDetector(self._board).detectBoard(image)
        if ids is None or len(ids) < _FEWEST_CORNERS:
            return None
        found = np.asarray(ids, np.int_).reshape(-1)
        places = self.corners_m(found)
        if np.ptp(places[:, 0]) == 0.0 or np.ptp(places[:, 1]) == 0.0:
            return None
        return View(name, found, np.asarray(corners, np.float64).reshape(-1, 2))
