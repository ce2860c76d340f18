"""Documents of headings, paragraphs, tables and figures, written as an HTML page or as Markdown."""

import html
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 1100px; margin: 2em auto;
       padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin: 2em 0 .3em; } h3 { font-size: 1em; }
figure { margin: .5em 0; } figure svg, figure img { width: 100%; height: auto; }
figcaption, .small { color: #666; font-size: .9em; }
.views { display: grid; grid-template-columns: repeat(auto-fit, minmax(320px, 1fr)); gap: 1em; }
.note { background: #fff3cd; padding: .3em .8em; border-left: 4px solid #e0a800; }
table { border-collapse: collapse; } td { padding: .1em 1em .1em 0; vertical-align: top; }
"""
# On a narrow screen each row of a table becomes a card, with the columns' heads before the cells.
TABLE_STYLE = """
.figures td, .figures th { text-align: right; padding: .15em .7em .15em 0; font-size: .85em;
       font-variant-numeric: tabular-nums; }
.figures td:first-child, .figures th:first-child { text-align: left; }
.figures td + td { white-space: nowrap; }
.figures th { border-bottom: 1px solid #888; vertical-align: bottom; }
.figures tr.strong { background: #fde2dd; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: .8em; background: #f5f5f5;
      padding: .6em; } pre.table { white-space: pre; overflow-x: auto; }
@media screen and (max-width: 700px) {
  .figures, .figures tbody { display: block; } .figures thead { display: none; }
  .figures tr { display: block; border-top: 1px solid #bbb; padding: .4em 0; }
  .figures td, .figures td:first-child { display: flex; justify-content: space-between;
       gap: 1em; padding: 0; text-align: right; }
  .figures td:first-child { font-weight: bold; }
  .figures td::before { content: attr(data-head); color: #666; font-weight: normal; }
  .figures td:empty { display: none; }
}
.drawings { display: grid; gap: 1em;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); }
.drawings svg { max-width: 560px; }
@media print { body { font-size: 10pt; max-width: none; margin: 0; }
  tr, figure { break-inside: avoid; } pre.table { white-space: pre-wrap; } }
"""


_CODE = re.compile("`([^`]*)`")


@dataclass(frozen=True)
class Heading:
    """A heading; level 1 is that of the document."""

    text: str
    level: int


@dataclass(frozen=True)
class Text:
    """A paragraph; text between backticks is shown as code."""

    text: str


@dataclass(frozen=True)
class Lines:
    """Preformatted lines of a table or of commands."""

    lines: Sequence[str]
    is_table: bool = False  # a table's lines are not wrapped


@dataclass(frozen=True)
class Table:
    """A table of texts, with its first column aligned to the left."""

    head: Sequence[str]  # of the columns
    rows: Sequence[Sequence[str]]
    strong: frozenset[int] = frozenset()  # indices of rows that are highlighted


@dataclass(frozen=True)
class Figures:
    """SVG drawings side by side, with a caption; Markdown leaves them out."""

    drawings: Sequence[str]
    caption: str


Block = Heading | Text | Lines | Table | Figures


def page(title: str, body: str) -> str:
    """Return a whole HTML page with a title and the HTML of its body."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{html.escape(title)}</title><style>{STYLE}{TABLE_STYLE}</style></head><body>\n"
        f"{body}\n</body></html>\n"
    )


def as_html(title: str, blocks: Sequence[Block]) -> str:
    """Return a document as an HTML page in one file."""
    return page(title, "\n".join(html_of(block) for block in blocks))


def html_of(block: Block) -> str:
    """Return the HTML of one block."""
    match block:
        case Heading(text, level):
            return f"<h{level}>{html.escape(text)}</h{level}>"
        case Text(text):
            return "<p>" + _CODE.sub(r"<code>\1</code>", html.escape(text)) + "</p>"
        case Lines(lines, is_table):
            kind = ' class="table"' if is_table else ""
            return f"<pre{kind}>{html.escape(chr(10).join(lines))}</pre>"
        case Table():
            return _html_table(block)
        case Figures(drawings, caption):
            views = "".join(f"<div>{drawing}</div>" for drawing in drawings)
            caption = f"<figcaption>{html.escape(caption)}</figcaption>"
            return f'<figure><div class="drawings">{views}</div>{caption}</figure>'


def _html_table(table: Table) -> str:
    heads = [html.escape(each) for each in table.head]
    lines = ["".join(f"<th>{head}</th>" for head in heads)]
    lines = [f'<table class="figures"><thead><tr>{lines[0]}</tr></thead><tbody>']
    for i, row in enumerate(table.rows):
        cells = "".join(
            f'<td data-head="{head}">{html.escape(cell)}</td>'
            for head, cell in zip(heads, row, strict=True)
        )
        lines.append(
            f'<tr class="strong">{cells}</tr>' if i in table.strong else f"<tr>{cells}</tr>"
        )
    return "\n".join([*lines, "</tbody></table>"])


def as_markdown(blocks: Sequence[Block]) -> str:
    """Return a document as Markdown, without figures."""
    return "\n\n".join(_markdown(b) for b in blocks if not isinstance(b, Figures)) + "\n"


def _markdown(block: Heading | Text | Lines | Table) -> str:
    match block:
        case Heading(text, level):
            return f"{'#' * level} {text}"
        case Text(text):
            return text
        case Lines(lines):
            return "\n".join(["```", *lines, "```"])
        case Table(head, rows, strong):
            bars = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
            for i, row in enumerate(rows):
                cells = [cell.replace("|", "\\|") for cell in row]
                if i in strong:
                    cells = [f"**{cell}**" if cell else "" for cell in cells]
                bars.append("| " + " | ".join(cells) + " |")
            return "\n".join(bars)


def drawing(width_in: float, height_in: float, draw: Callable[[Any], None]) -> str:
    """Return a drawing by matplotlib as SVG, which is the same every time.

    Args:
        width_in: of the figure, inches.
        height_in: of the figure, inches.
        draw: draws onto a matplotlib figure.

    Raises:
        ImportError: matplotlib is not installed.
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    data = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "landerd"}):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        figure.savefig(data, format="svg", metadata={"Date": None})
    text = data.getvalue()
    return text[text.index("<svg") :]
