"""A pad on sheets of paper: how it is divided, and what stands round the print.

All sheets of a pad show equal parts of it. Each overlaps the next to its right and below; it is cut
on its left and top and laid over those before it, up to the marks there. Marks, ruler and texts
stand outside the print.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from landerd.pad import PadLayout
from landerd.printing.contours import pad_contours, plate_size_mm
from landerd.printing.page import Box, Document, Line, Page, Picture, Text

PAPERS = {  # width and height, mm
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "letter": (215.9, 279.4),
}
LARGEST_OVERLAP_MM = 50.0
RULER_MM = 100.0

_MARGIN = 10.0  # round the print: no printer reaches the edge, and the marks need room
_FOOT = 16.0  # ruler and texts, between print and lower margin
_SHEET_MARGIN = 20.0  # of the one sheet of a print shop
_GAP, _MARK = 1.0, 5.0  # between print and mark; length of a mark
_STEP = 4.6  # from line to line of text


@dataclass(frozen=True)
class Tiling:
    """How a plate is divided. All lengths in mm.

    Attributes:
        paper: width and height of a sheet, turned as it is used.
        rows: of sheets, counted from the north.
        columns: of sheets, counted from the west.
        part: width and height of the print on one sheet.
        overlap: of neighbours.
    """

    paper: tuple[float, float]
    rows: int
    columns: int
    part: tuple[float, float]
    overlap: float

    @property
    def sheets(self) -> int:
        """How many there are."""
        return self.rows * self.columns

    def corner(self, row: int, column: int) -> tuple[float, float]:
        """Return where the top left corner of a sheet's part lies on the plate: x, y."""
        return column * (self.part[0] - self.overlap), row * (self.part[1] - self.overlap)


def tiling(layout: PadLayout, paper: str, overlap: float) -> Tiling:
    """Return the division that needs the fewest sheets, upright or across.

    Args:
        layout: the pad.
        paper: one of PAPERS.
        overlap: of neighbours, mm, 0 to LARGEST_OVERLAP_MM.
    """
    plate = plate_size_mm(layout)
    short, long = PAPERS[paper]
    ways = [_divided(plate, turned, overlap) for turned in ((short, long), (long, short))]
    return min(ways, key=lambda way: way.sheets)


def _divided(plate: tuple[float, float], paper: tuple[float, float], overlap: float) -> Tiling:
    room = paper[0] - 2 * _MARGIN, paper[1] - 2 * _MARGIN - _FOOT
    counts = [
        max(1, math.ceil((whole - overlap) / (most - overlap)))
        for whole, most in zip(plate, room, strict=True)
    ]
    width, height = (
        (whole + (count - 1) * overlap) / count for whole, count in zip(plate, counts, strict=True)
    )
    return Tiling(paper, counts[1], counts[0], (width, height), overlap)


def tiled(layout: PadLayout, tiles: Tiling) -> Document:
    """Return the pad on many sheets: the plan of how they go together, then each."""
    places = [(row, column) for row in range(tiles.rows) for column in range(tiles.columns)]
    pages = [_tile(layout, tiles, row, column) for row, column in places]
    if tiles.sheets > 1:
        pages.insert(0, _plan(layout, tiles))
    return Document(f"{layout.name}, landing pad", pad_contours(layout), tuple(pages))


def one_sheet(layout: PadLayout) -> Document:
    """Return the pad on one sheet as large as it needs, with cut marks."""
    width, height = plate_size_mm(layout)
    m = _SHEET_MARGIN
    window = Box(m, m, width, height)
    page = (max(width, 200.0) + 2 * m, height + 2 * m)
    lines = [*_upright_marks(window, window.x, window.right)]
    lines += _level_marks(window, window.y, window.bottom)
    foot = window.bottom + 8.0
    lines += _ruler(m + 10.0, foot)
    texts = _foot_texts(
        m + 10.0, foot, f"{layout.name}: {width:g} x {height:g} mm between the marks"
    )
    sheet = Page(*page, (Picture(window, (m, m)),), tuple(lines), tuple(texts), window)
    return Document(f"{layout.name}, landing pad", pad_contours(layout), (sheet,))


# ---- one of many sheets ------------------------------------------------------------------------


def _tile(layout: PadLayout, tiles: Tiling, row: int, column: int) -> Page:
    window = Box((tiles.paper[0] - tiles.part[0]) / 2, _MARGIN, *tiles.part)
    x, y = tiles.corner(row, column)
    number = row * tiles.columns + column + 1
    is_last = column == tiles.columns - 1, row == tiles.rows - 1
    ends = [
        w - (0.0 if last else tiles.overlap) for w, last in zip(tiles.part, is_last, strict=True)
    ]
    right, bottom = window.x + ends[0], window.y + ends[1]
    lines = [
        *_upright_marks(window, window.x, right),
        *_level_marks(window, window.y, bottom),
    ]
    texts = []
    if not is_last[0]:
        texts += [
            Text((right + 0.8, y), f"{number + 1}", 2.5)
            for y in (window.y - 3.0, window.bottom + _GAP + _MARK)
        ]
    if not is_last[1]:
        below = f"{number + tiles.columns}"
        texts += [
            Text((x, bottom + 3.0), below, 2.5)
            for x in (window.x - _GAP - _MARK, window.right + _GAP + 0.5)
        ]
    left, foot = _MARGIN + 2.0, tiles.paper[1] - _MARGIN - 4.5
    lines += _ruler(left, foot)
    place = f"sheet {number} of {tiles.sheets}"
    if tiles.sheets > 1:
        place += f": row {row + 1}, column {column + 1}"
    texts += _foot_texts(left, foot, f"{layout.name}, {place}")
    picture = Picture(window, (window.x - x, window.y - y))
    return Page(*tiles.paper, (picture,), tuple(lines), tuple(texts))


def _upright_marks(window: Box, *across: float) -> Iterator[Line]:
    """Yield upright marks above and below a window."""
    for x in across:
        yield Line((x, window.y - _GAP - _MARK), (x, window.y - _GAP))
        yield Line((x, window.bottom + _GAP), (x, window.bottom + _GAP + _MARK))


def _level_marks(window: Box, *down: float) -> Iterator[Line]:
    """Yield level marks to the left and right of a window."""
    for y in down:
        yield Line((window.x - _GAP - _MARK, y), (window.x - _GAP, y))
        yield Line((window.right + _GAP, y), (window.right + _GAP + _MARK, y))


def _ruler(x: float, y: float) -> list[Line]:
    """Return a level bar with a stroke every 10 mm: from middle to middle of its end strokes."""
    strokes = [(x + 10.0 * i, 4.0 if i in (0, 10) else 1.5) for i in range(11)]
    bar = Line((x, y), (x + RULER_MM, y))
    return [bar, *(Line((at, y - length), (at, y + length / 2)) for at, length in strokes)]


def _upright_ruler(x: float, y: float) -> list[Line]:
    return [
        Line(
            (x + line.start[1] - y, y + line.start[0] - x),
            (x + line.end[1] - y, y + line.end[0] - x),
        )
        for line in _ruler(x, y)
    ]


def _foot_texts(x: float, y: float, first: str) -> list[Text]:
    return [
        Text((x + RULER_MM + 4.0, y - 1.5), first, 2.8),
        Text(
            (x + RULER_MM + 4.0, y + 2.3),
            "Print at 100 %. This bar is 100 mm long: measure it.",
            2.8,
        ),
    ]


# ---- how they go together ----------------------------------------------------------------------


def _plan(layout: PadLayout, tiles: Tiling) -> Page:
    width, height = tiles.paper
    plate = plate_size_mm(layout)
    texts = _lines_of_text(_instructions(layout, tiles))
    top = texts[-1].at[1] + 8.0
    # Left of the upright ruler and above the level one, whichever is less.
    room = width - 2 * _MARGIN - 30.0, height - top - _MARGIN - _FOOT
    scale = min(room[0] / plate[0], room[1] / plate[1])
    window = Box(_MARGIN + 2.0, top, scale * plate[0], scale * plate[1])
    lines = [*_frame(window), *_seams(window, scale, tiles)]
    for row in range(tiles.rows):
        for column in range(tiles.columns):
            x, y = (
                window_at + scale * at
                for window_at, at in zip(
                    (window.x, window.y), tiles.corner(row, column), strict=True
                )
            )
            texts.append(Text((x + 1.0, y + 4.0), f"{row * tiles.columns + column + 1}"))
    foot = height - _MARGIN - 8.0
    lines += _ruler(_MARGIN + 2.0, foot)
    lines += _upright_ruler(width - _MARGIN - 5.0, foot - RULER_MM - 10.0)
    texts.append(Text((_MARGIN + RULER_MM + 6.0, foot), "Both bars are 100 mm long: measure them."))
    picture = Picture(window, (window.x, window.y), scale, grey=0.75)
    return Page(width, height, (picture,), tuple(lines), tuple(texts))


def _instructions(layout: PadLayout, tiles: Tiling) -> list[str]:
    wide, high = (f"{size / 1e3:g}" for size in plate_size_mm(layout))
    return [
        f"Landing pad {layout.name}: {wide} m wide, {high} m from north (top) to south",
        f"{tiles.sheets} sheets: {tiles.rows} rows of {tiles.columns}. "
        f"Neighbours overlap by {tiles.overlap:g} mm.",
        "1. Print this page first, at 100 % (actual size), not fitted to the page.",
        "2. Measure both bars below. If they differ by more than 0.5 mm, rings come out oval: take",
        "    another printer or a print shop. If both are not quite 100 mm: step 6 puts it right.",
        "3. Rows: cut each sheet but the first of its row at its left marks. Lay it over the sheet",
        "    before it, its edge at the marks that bear its number; glue it flat.",
        "4. Pad: cut each row but the first at its top marks. Lay it over the row above it, its",
        "    edge at the marks that bear its first number; glue it flat.",
        "5. Cut round the outermost marks. The white round the print belongs to the pad.",
        "6. Measure what you have glued, and tell landerd: landerd pad --help, under --measured.",
    ]


def _lines_of_text(lines: list[str]) -> list[Text]:
    sizes = [5.0, *[3.2] * (len(lines) - 1)]
    return [
        Text((_MARGIN + 2.0, _MARGIN + 6.0 + (i + (i > 0)) * _STEP), line, size)
        for i, (line, size) in enumerate(zip(lines, sizes, strict=True))
    ]


def _frame(box: Box) -> list[Line]:
    corners = [
        (box.x, box.y),
        (box.right, box.y),
        (box.right, box.bottom),
        (box.x, box.bottom),
    ]
    return [Line(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]


def _seams(window: Box, scale: float, tiles: Tiling) -> Iterator[Line]:
    """Yield where the sheets' edges lie on the finished pad."""
    for column in range(1, tiles.columns):
        x = window.x + scale * tiles.corner(0, column)[0]
        yield Line((x, window.y), (x, window.bottom))
    for row in range(1, tiles.rows):
        y = window.y + scale * tiles.corner(row, 0)[1]
        yield Line((window.x, y), (window.right, y))
