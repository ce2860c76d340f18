"""Printed pads as a printer and a builder make them of a PDF: rasterised, cut and put together."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pypdfium2
from numpy.typing import NDArray

from landerd.pad import PadLayout
from landerd.printing.contours import plate_size_mm
from tests.vision.scenes import F32, Mask

U8 = NDArray[np.uint8]
MM_PER_INCH = 25.4


def rasterised(file: Path, page: int, dpi: float) -> U8:
    """Return a PDF's page as a grey image (rows, columns)."""
    document = pypdfium2.PdfDocument(file)
    try:
        bitmap = document[page].render(scale=dpi / 72.0, grayscale=True)
        return np.array(bitmap.to_numpy(), dtype=np.uint8).reshape(bitmap.height, bitmap.width)
    finally:
        document.close()


def runs(dark: Mask) -> list[int]:
    """Return the middles of the runs of dark pixels in a row of them."""
    edges = np.flatnonzero(np.diff(np.pad(dark.astype(np.int8), 1)))
    return [int(a + b) // 2 for a, b in edges.reshape(-1, 2)]


@dataclass(frozen=True)
class Marks:
    """Where the marks of a page stand, px: from the left and from the top."""

    across: list[int]
    down: list[int]


def marks(page: U8, dpi: float) -> Marks:
    """Find a page's marks by sight, in the white beside its print and above its foot."""
    k = dpi / MM_PER_INCH
    across = runs(page[round(8.3 * k)] < 128)  # the print begins 10 mm from the top
    down = page[: -round(20.5 * k), across[0] - round(1.4 * k)]
    return Marks(across, runs(down < 128))


def put_together(pages: list[U8], rows: int, columns: int, dpi: float) -> U8:
    """Return the plate (rows, columns) of sheets that were cut and laid by their marks alone."""
    found = [marks(page, dpi) for page in pages]
    # Each sheet is cut at its first marks; its neighbour's edge comes to its last ones.
    widths = [m.across[1] - m.across[0] for m in found[:columns]]
    heights = [m.down[1] - m.down[0] for m in found[::columns]]
    plate = np.zeros((sum(heights), sum(widths)), np.uint8)
    for i, (page, m) in enumerate(zip(pages, found, strict=True)):
        row, column = divmod(i, columns)
        left, top = m.across[0], m.down[0]
        x, y = sum(widths[:column]), sum(heights[:row])
        plate[y : y + heights[row], x : x + widths[column]] = page[
            top : top + heights[row], left : left + widths[column]
        ]
    assert len(pages) == rows * columns
    return plate


@dataclass(frozen=True)
class Print:
    """A pad's plate on paper, to be photographed."""

    layout: PadLayout
    grey: U8  # (rows, columns), from its north-west corner
    dpi: float

    def paint(self, north: F32, east: F32) -> tuple[Mask, Mask]:
        """Tell which points (m) are on the plate, and which are white; see `scenes.render`."""
        plate, per_m = self.layout.plate, self.dpi / MM_PER_INCH * 1e3
        row = np.floor((plate.north_m - north) * per_m).astype(np.int64)
        column = np.floor((plate.west_m + east) * per_m).astype(np.int64)
        rows, columns = self.grey.shape
        on_plate = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        seen = self.grey[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        return on_plate, seen > 127

    def differences(self, other: "Print") -> int:
        """Count the pixels in which the two differ, but for a pixel beside an edge."""
        rows, columns = np.minimum(self.grey.shape, other.grey.shape)
        one, two = (p.grey[:rows, :columns] > 127 for p in (self, other))
        kernel = np.ones((5, 5), np.uint8)
        away_from_edges = np.ones_like(one)
        for p in (one.astype(np.uint8), two.astype(np.uint8)):
            away_from_edges &= cv2.erode(p, kernel) == cv2.dilate(p, kernel)
        return int(np.count_nonzero((one != two) & away_from_edges))


def trimmed(page: U8, layout: PadLayout, left_mm: float, top_mm: float, dpi: float) -> U8:
    """Return the plate cut out of a page, given the place of its corner."""
    k = dpi / MM_PER_INCH
    width, height = (round(k * size) for size in plate_size_mm(layout))
    left, top = round(k * left_mm), round(k * top_mm)
    return page[top : top + height, left : left + width]
