"""Writes one page, or a cutter's outlines, as SVG: one unit is a millimetre."""

from collections.abc import Iterable
from xml.sax.saxutils import escape

from landerd.pad import PadLayout
from landerd.printing.contours import Contour, pad_contours, plate_size_mm
from landerd.printing.page import Document


def svg(document: Document) -> str:
    """Return the file of a document of one page, which shows the whole pad."""
    (page,) = document.pages
    parts = ['<rect width="100%" height="100%" fill="white"/>']
    for p in page.pictures:
        place = f"translate({_numbers(*p.origin)}) scale({p.scale:g})"
        parts.append(f'<g transform="{place}">')
        parts += [f'<path fill-rule="evenodd" d="{path_data(m)}"/>' for m in document.markers]
        parts.append("</g>")
    for line in page.lines:
        (x1, y1), (x2, y2) = line.start, line.end
        dash = ' stroke-dasharray="1 1"' if line.dashed else ""
        ends = f'x1="{x1:.4f}" y1="{y1:.4f}" x2="{x2:.4f}" y2="{y2:.4f}"'
        parts.append(f'<line {ends} stroke="black" stroke-width="{line.width:g}"{dash}/>')
    for text in page.texts:
        x, y = text.at
        font = f'font-family="Helvetica, Arial, sans-serif" font-size="{text.size:g}"'
        parts.append(f'<text x="{x:.4f}" y="{y:.4f}" {font}>{escape(text.text)}</text>')
    return _file(document.title, page.width, page.height, parts)


def outline_svg(layout: PadLayout) -> str:
    """Return the contours of the black areas, to be cut, and nothing else."""
    width, height = plate_size_mm(layout)
    paths = [
        f'<path fill="none" stroke="black" stroke-width="0.1" d="{path_data([contour])}"/>'
        for marker in pad_contours(layout)
        for contour in marker
    ]
    return _file(layout.name, width, height, paths)


def path_data(contours: Iterable[Contour]) -> str:
    """Return the `d` of a path."""
    parts = []
    for contour in contours:
        parts.append(f"M {_numbers(*contour.start)}")
        for segment in contour.segments:
            letter = "L" if len(segment) == 1 else "C"
            parts.append(f"{letter} {_numbers(*(v for point in segment for v in point))}")
        parts.append("Z")
    return " ".join(parts)


def _file(title: str, width: float, height: float, parts: Iterable[str]) -> str:
    w, h = f"{width:.4f}", f"{height:.4f}"
    head = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<svg xmlns="http://www.w3.org/2000/svg" '
        f'width="{w}mm" height="{h}mm" viewBox="0 0 {w} {h}">'
    )
    return "\n".join([head, f"<title>{escape(title)}</title>", *parts, "</svg>", ""])


def _numbers(*values: float) -> str:
    return " ".join(f"{v:.4f}" for v in values)
