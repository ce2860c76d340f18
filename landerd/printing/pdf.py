"""Writes a document as PDF (ISO 32000-1).

The pad is one form that all pages show through their windows, so a pad on a hundred sheets is not
much larger than on one. Text is in Helvetica, which every reader has.
"""

from collections.abc import Iterable

from landerd.printing.contours import Contour, Point
from landerd.printing.page import Document, Line, Page, Picture, Text

LARGEST_MM = 5080.0  # a page's side: 14400 units of 1/72 inch
_UNITS_PER_MM = 72.0 / 25.4
_CATALOG, _PAGES, _FONT, _INFO, _PAD, _FIRST_PAGE = range(1, 7)  # numbers of objects


def pdf(document: Document) -> bytes:
    """Return the file."""
    pages = document.pages
    numbers = [_FIRST_PAGE + 2 * i for i in range(len(pages))]
    print_ = "\n".join(_area(marker) for marker in document.markers)
    kids = " ".join(f"{n} 0 R" for n in numbers)
    objects = [
        f"<< /Type /Catalog /Pages {_PAGES} 0 R >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>",
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
        f"<< /Title {_string(document.title)} /Producer (landerd) >>",
        _stream(print_, f"/Type /XObject /Subtype /Form /BBox {_bounds(document)}"),
    ]
    for page, number in zip(pages, numbers, strict=True):
        objects += [_page(page, number + 1), _stream(_content(page))]
    return _file(objects)


def _file(objects: list[str]) -> bytes:
    """Return header, objects, table of their offsets and trailer."""
    out = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")
    offsets = []
    for number, text in enumerate(objects, 1):
        offsets.append(len(out))
        out += f"{number} 0 obj\n{text}\nendobj\n".encode("cp1252")
    table = len(out)
    out += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n".encode()
    out += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    trailer = f"<< /Size {len(objects) + 1} /Root {_CATALOG} 0 R /Info {_INFO} 0 R >>"
    out += f"trailer\n{trailer}\nstartxref\n{table}\n%%EOF\n".encode()
    return bytes(out)


def _page(page: Page, content: int) -> str:
    boxes = f"/MediaBox [0 0 {_units(page.width)} {_units(page.height)}]"
    if page.trim is not None:
        t = page.trim
        low, high = page.height - t.bottom, page.height - t.y
        edges = " ".join(_units(e) for e in (t.x, low, t.right, high))
        boxes += f" /TrimBox [{edges}]"
    return (
        f"<< /Type /Page /Parent {_PAGES} 0 R {boxes} /Contents {content} 0 R /Resources "
        f"<< /Font << /F {_FONT} 0 R >> /XObject << /Pad {_PAD} 0 R >> >> >>"
    )


def _content(page: Page) -> str:
    k = f"{_UNITS_PER_MM:.9f}"
    parts = [f"{k} 0 0 -{k} 0 {_units(page.height)} cm"]  # to mm, y down
    parts += [_picture(picture) for picture in page.pictures]
    parts += [_line(line) for line in page.lines]
    parts += [_text(text) for text in page.texts]
    return "\n".join(parts)


def _picture(p: Picture) -> str:
    w = p.window
    window = _numbers(w.x, w.y, w.width, w.height)
    place = f"{p.scale:.9f} 0 0 {p.scale:.9f} {_numbers(*p.origin)}"
    return f"q {window} re W n {place} cm {p.grey:g} g /Pad Do Q"


def _line(line: Line) -> str:
    dash = "[1 1] 0 d" if line.dashed else "[] 0 d"
    return f"{line.width:g} w {dash} {_numbers(*line.start)} m {_numbers(*line.end)} l S"


def _text(text: Text) -> str:
    # Upright again: the page's y is down.
    at = f"1 0 0 -1 {_numbers(*text.at)} Tm"
    return f"BT /F {text.size:g} Tf {at} {_string(text.text)} Tj ET"


def _area(contours: Iterable[Contour]) -> str:
    parts = []
    for contour in contours:
        parts.append(f"{_numbers(*contour.start)} m")
        for segment in contour.segments:
            flat = _numbers(*(v for point in segment for v in point))
            parts.append(f"{flat} {'l' if len(segment) == 1 else 'c'}")
        parts.append("h")
    return "\n".join([*parts, "f*"])


def _bounds(document: Document) -> str:
    contours = [contour for marker in document.markers for contour in marker]
    # A curve lies among its ends and control points.
    points: list[Point] = [p for c in contours for segment in c.segments for p in segment]
    xs, ys = zip(*points, strict=True)
    return f"[{_numbers(min(xs) - 1, min(ys) - 1, max(xs) + 1, max(ys) + 1)}]"


def _stream(content: str, entries: str = "") -> str:
    length = len(content.encode("cp1252"))
    return f"<< {entries} /Length {length} >>\nstream\n{content}\nendstream"


def _string(text: str) -> str:
    shown = text.encode("cp1252", "replace").decode("cp1252")
    for special in "\\()":
        shown = shown.replace(special, "\\" + special)
    return f"({shown})"


def _numbers(*values: float) -> str:
    return " ".join(f"{v:.4f}" for v in values)


def _units(mm: float) -> str:
    return f"{_UNITS_PER_MM * mm:.4f}"
