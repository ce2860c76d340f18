"""`landerd pad`: prints or cuts a pad at true size, proposes one, or enters measured sizes."""

import argparse
import math
from pathlib import Path
from typing import Any

from landerd.camera_model import CalibrationError, CameraModel, load_camera
from landerd.commands.shared import (
    InputError,
    add_json,
    check_output,
    file_name,
    pad_path,
    print_json,
    refusing,
    tell,
    write_bytes,
    write_text,
)
from landerd.config.files import config_dir, config_files, own_or
from landerd.pad import Marker, PadError, PadLayout, load_pad, size_m
from landerd.preflight.configuration import pad_findings
from landerd.printing.contours import plate_size_mm, reaching_out
from landerd.printing.measured import (
    RULER,
    came_out,
    length_m,
    marker_names,
    measured,
    pad_file,
    was_measured,
)
from landerd.printing.page import Document
from landerd.printing.pdf import LARGEST_MM, pdf
from landerd.printing.proposal import View, propose
from landerd.printing.sheets import LARGEST_OVERLAP_MM, PAPERS, RULER_MM, one_sheet, tiled, tiling
from landerd.printing.svg import outline_svg, svg

_Sheets = dict[str, Any]  # number and sizes of the sheets, as --json prints them

_SHEET = "sheet"  # value of --paper: one sheet as large as the pad
_MOST_SHEETS = 5000  # largest number of sheets: a pad of about 15 m
# Relative error of a measured length from which on the print was probably scaled: printers are more
# accurate, but a print dialog may fit the pad to the page.
_SCALED = 0.03
_SUFFIXES = (".pdf", ".svg", ".yaml")
_NONE = ("0", "0mm")  # texts for an overlap of 0, which is no length elsewhere
_DEFAULT_PAD = "thesis"
_THESIS_CAMERA = Path("cameras", "thesis.yaml")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    known = ", ".join(config_files("pads"))
    parser.add_argument(
        "pad",
        nargs="?",
        metavar="FILE",
        help=f"pad file, or one of landerd's own by name: {known} (thesis)",
    )
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        type=file_name,
        metavar="FILE",
        help=".pdf or .svg (one sheet); a pad file, .yaml, with --measured or --for",
    )
    parser.add_argument(
        "--paper",
        type=str.lower,
        choices=[*PAPERS, _SHEET],
        help="many sheets of this paper, or (sheet) one as large as the pad, for a print shop "
        "(a4; for an .svg: sheet)",
    )
    parser.add_argument(
        "--overlap",
        type=_overlap,
        default=0.010,
        metavar="LENGTH",
        help="width by which sheets overlap (10mm)",
    )
    parser.add_argument(
        "--outline",
        action="store_true",
        help="only the outlines of the black areas, for a vinyl cutter; an .svg",
    )
    _add_measured(parser)
    _add_proposed(parser)
    add_json(parser)


def _add_measured(parser: argparse.ArgumentParser) -> None:
    """Add --measured, which writes a pad file with the measured sizes of a print."""
    parser.add_argument(
        "--measured",
        action="append",
        default=[],
        type=_measurement,
        metavar="WHAT=LENGTH",
        help="write a pad file with a length that you measured on the print: ruler=99.2mm (the "
        "printed bar of 100 mm, which scales all markers and places), or one marker's outer "
        "diameter or black edge, as whycon=994mm or apriltag-0=311mm; may be given again",
    )


def _add_proposed(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that propose a pad of a given size: --for, --seen-from, --camera."""
    parser.add_argument(
        "--for",
        dest="side",
        type=_length,
        metavar="LENGTH",
        help="propose a layout for a pad of this width, and write its pad file beside the print",
    )
    parser.add_argument(
        "--seen-from",
        type=_length,
        metavar="LENGTH",
        help="with --for: distance from which it must be seen",
    )
    parser.add_argument(
        "--camera",
        type=file_name,
        metavar="FILE",
        help="with --for: calibration of the camera (the thesis's, 640x480 with 77 degrees of "
        "view)",
    )


def run(args: argparse.Namespace) -> int:
    """Write the pad and print what was written; return 0. Raises InputError."""
    _check_arguments(args)
    with refusing(PadError, CalibrationError):
        view = _view(args.camera)
        layout = _layout(args, view)
    files: list[Path] = []
    sheets: _Sheets = {}
    makes_pad_file = args.side or args.measured
    if makes_pad_file:
        files.append(args.output.with_suffix(".yaml"))
        _check_new(files[0], _file_text(args, layout))
    if args.output.suffix != ".yaml":
        sheets = _write_print(args, layout)
        files.append(args.output)
    if makes_pad_file:
        write_text(files[0], _file_text(args, layout))
    markers = [_described(name, m, view) for name, m in marker_names(layout).items()]
    if args.json:
        shown = {"pad": layout.name, "files": [str(f) for f in files], "markers": markers, **sheets}
        print_json(shown)
    else:
        _say(layout, files, markers, sheets)
    return 0


# ---- arguments ---------------------------------------------------------------------------------


def _length(text: str) -> float:
    """Return a length in m, as of "99.2mm"; the type of an argument."""
    try:
        return length_m(text)
    except ValueError as e:
        raise argparse.ArgumentTypeError(str(e)) from None


def _overlap(text: str) -> float:
    """Return the overlap of sheets in m, which may be 0; the type of --overlap."""
    try:
        length = 0.0 if text in _NONE else length_m(text)
    except ValueError:
        length = math.nan
    if not 1e3 * length <= LARGEST_OVERLAP_MM:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected 0 to {LARGEST_OVERLAP_MM:g}mm")
    return length


def _measurement(text: str) -> tuple[str, float]:
    """Return what was measured, and its length in m; the type of --measured."""
    what, _, length = text.partition("=")
    if not (what and length):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected WHAT=LENGTH, as ruler=99.2mm")
    return what, _length(length)


def _check_arguments(args: argparse.Namespace) -> None:
    """Raise InputError for arguments that exclude or need each other, or an -o of no use."""
    if (args.side is None) != (args.seen_from is None):
        raise InputError("--for and --seen-from: expected both or none")
    proposes = args.side is not None
    suffix = args.output.suffix
    tiles = args.paper not in (None, _SHEET)
    for wrong, line in (
        (proposes and args.pad, f"{args.pad}: not with --for, which proposes a layout of its own"),
        (
            proposes and args.measured,
            "--measured: not with --for; give the pad file of the print",
        ),
        (args.camera and not proposes, "--camera: only with --for"),
        (suffix not in _SUFFIXES, f"-o {args.output}: expected a {', '.join(_SUFFIXES)}"),
        (args.measured and suffix != ".yaml", "--measured: writes a pad file: -o NAME.yaml"),
        (
            suffix == ".yaml" and not (proposes or args.measured),
            f"-o {args.output}: a pad file only with --measured or --for; expected .pdf or .svg",
        ),
        (args.outline and suffix != ".svg", "--outline: an SVG: -o NAME.svg"),
        (
            args.outline and tiles,
            f"--outline: not on sheets of paper: leave out --paper {args.paper}",
        ),
        (suffix == ".svg" and tiles, f"--paper {args.paper}: an SVG has one page; -o NAME.pdf"),
    ):
        if wrong:
            raise InputError(line)
    check_output(args.output, suffix, "-o")


def _view(camera: Path | None) -> View:
    """Return the view of the camera with this calibration; None: of the thesis's camera."""
    return _seen_by(load_camera(own_or(camera) if camera else config_dir() / _THESIS_CAMERA))


def _seen_by(camera: CameraModel) -> View:
    """Return a camera's view, by the shorter side of its image."""
    return View(min(camera.fx, camera.fy), min(camera.width, camera.height))


def _layout(args: argparse.Namespace, view: View) -> PadLayout:
    """Return the layout of the pad to write: proposed, read from a file, or read and measured.

    Raises:
        PadError: it cannot be read or proposed, or the measured lengths cannot be used.
        InputError: the pad is unknown, does not fit its plate, or would be scaled twice; a length
            is given twice.
    """
    if args.side is not None:
        return propose(args.side, args.seen_from, view)
    name = _DEFAULT_PAD if args.pad is None else args.pad
    path = pad_path(name)
    layout = load_pad(path)
    for marker in reaching_out(layout):
        raise InputError(f"{name}: the {marker.kind} reaches over the plate's edge; see plate:")
    for finding in pad_findings(layout):
        if finding.level != "ok":
            tell(f"{name}: {finding.what}; {finding.mend}")
    if not args.measured:
        return layout
    lengths_m = dict(args.measured)
    if len(lengths_m) < len(args.measured):
        raise InputError("--measured: one thing is given twice; give the mean")
    if RULER in lengths_m and was_measured(path.read_text(encoding="utf-8")):
        raise InputError(
            f"{name}: was measured already, {RULER} would scale it again; name the pad as it was "
            "printed"
        )
    printed_m = {name: size_m(marker) for name, marker in marker_names(layout).items()}
    printed_m[RULER] = RULER_MM / 1e3
    layout = measured(layout, lengths_m)
    for what, length in lengths_m.items():
        if abs(length / printed_m[what] - 1.0) > _SCALED:
            tell(f"{what}: off by 3 % or more; was it printed at 100 %? It is taken as measured")
    return layout


# ---- files -------------------------------------------------------------------------------------


def _file_text(args: argparse.Namespace, layout: PadLayout) -> str:
    """Return the pad file's text, which begins with a remark on its origin."""
    if args.side is not None:
        return pad_file(layout, ["Proposed by landerd. Measure the print: landerd pad --measured."])
    found = ", ".join(f"{what} {1e3 * length:g} mm" for what, length in args.measured)
    return pad_file(layout, [came_out(args.pad or _DEFAULT_PAD, found)])


def _check_new(path: Path, text: str) -> None:
    """Raise InputError if a pad file exists with another text, or cannot be written.

    Args:
        path: of the pad file.
        text: that is to be written.
    """
    check_output(path, ".yaml")
    try:
        is_another = path.exists() and path.read_text(encoding="utf-8") != text
    except (OSError, UnicodeDecodeError):
        is_another = True
    if is_another:
        raise InputError(f"{path}: exists already, with other contents; choose another -o")


def _write_print(args: argparse.Namespace, layout: PadLayout) -> _Sheets:
    """Write the PDF or SVG; return number and sizes of its sheets, empty for outlines.

    Raises:
        InputError: the file cannot be written, or the pad is too large for it.
    """
    is_svg = args.output.suffix == ".svg"
    if args.outline:
        write_text(args.output, outline_svg(layout))
        return {}
    paper = args.paper or (_SHEET if is_svg else "a4")
    tiles = None if paper == _SHEET else tiling(layout, paper, 1e3 * args.overlap)
    if tiles is not None and tiles.sheets > _MOST_SHEETS:
        raise InputError(
            f"-o {args.output}: {tiles.sheets} sheets, more than {_MOST_SHEETS}; are the lengths "
            "in the pad file metres?"
        )
    document = one_sheet(layout) if tiles is None else tiled(layout, tiles)
    if is_svg:
        write_text(args.output, svg(document))
    else:
        _write_pdf(args.output, document)
    if tiles is None:
        page = document.pages[0]
        return {"paper": paper, "sheets": 1, "size_mm": [page.width, page.height]}
    return {
        "paper": paper,
        "sheets": tiles.sheets,
        "size_mm": list(tiles.paper),
        "rows": tiles.rows,
        "columns": tiles.columns,
        "part_mm": list(tiles.part),
        "overlap_mm": tiles.overlap,
    }


def _write_pdf(path: Path, document: Document) -> None:
    """Write a PDF. Raises InputError if it cannot be written, or a page is too large."""
    longest = max(max(page.width, page.height) for page in document.pages)
    if longest > LARGEST_MM:
        most = f"{LARGEST_MM / 1e3:g} m"
        raise InputError(
            f"-o {path}: a page of {longest / 1e3:.2f} m; a PDF's is at most {most}: .svg"
        )
    write_bytes(path, pdf(document))


# ---- what is said ------------------------------------------------------------------------------


def _described(name: str, marker: Marker, view: View) -> dict[str, Any]:
    """Return size, place and visibility of a marker, as --json prints them.

    Distances at which it is seen are estimates, and rounded accordingly.
    """
    return {
        "name": name,
        "kind": marker.kind,
        "size_m": size_m(marker),
        "position_m": list(marker.position_m),
        "seen_from_m": round(view.farthest_m(marker), 1),
        "whole_from_m": round(view.nearest_m(marker), 2),
    }


def _say(
    layout: PadLayout, files: list[Path], markers: list[dict[str, Any]], sheets: _Sheets
) -> None:
    width, height = plate_size_mm(layout)
    print(f"pad {layout.name}: plate {width / 1e3:.5g} m wide, {height / 1e3:.5g} m north to south")
    for m in markers:
        print(
            f"  {m['name']:12} {1e3 * m['size_m']:6.5g} mm, seen from {m['seen_from_m']:.2g} m, "
            f"whole in the image down to {m['whole_from_m']:.2g} m"
        )
    if "rows" in sheets:
        paper = sheets["paper"].capitalize()
        print(
            f"{sheets['sheets']} sheets of {paper}: {sheets['rows']} rows of {sheets['columns']}, "
            f"overlap {sheets['overlap_mm']:g} mm; print at 100 %"
        )
    elif sheets:
        w, h = sheets["size_mm"]
        print(f"one sheet of {w:g} x {h:g} mm")
    for file in files:
        print(f"wrote {file}")
