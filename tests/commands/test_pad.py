"""`landerd pad`: what it prints, cuts, proposes, enters and refuses."""

import json
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from landerd.cli import main
from landerd.config.files import config_files
from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import load_pad
from landerd.vision import Vision
from tests.vision.scenes import THESIS_CAMERA, Optics, look, painted, render

SVG = "{http://www.w3.org/2000/svg}"
PADS = sorted(config_files("pads"))
TURNED = """name: turned
markers:
  - {kind: whycode, outer_diameter_m: 0.3, bits: 7, id: 11, heading_deg: 25}
  - {kind: aruco, dictionary: 4X4_50, id: 3, size_m: 0.09, position_m: [0.19, 0.1], heading_deg: 20}
  - {kind: whycon, outer_diameter_m: 0.1, inner_ratio: 0.6, position_m: [-0.2, -0.12]}
plate: {north_m: 0.251, south_m: 0.26, east_m: 0.185, west_m: 0.19}
"""


def said(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    assert main(["pad", *map(str, arguments), "--json"]) == 0
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def black_in(file: Path, size_mm: tuple[float, float], per_mm: float) -> np.ndarray:
    """Fill an SVG's paths as a browser does, curves by their ends and middles; 1 is black."""
    image = np.zeros([round(per_mm * s) for s in size_mm[::-1]], np.uint8)
    for path in ET.parse(file).getroot().iter(f"{SVG}path"):
        layer = np.zeros_like(image)
        loops = [flattened(loop) for loop in path.attrib["d"].split("Z") if loop.strip()]
        shift = 4
        points = [np.rint((p * per_mm - 0.5) * 2**shift).astype(np.int32) for p in loops]
        cv2.fillPoly(layer, points, 1, shift=shift)
        image |= layer
    return image


def flattened(loop: str) -> np.ndarray:
    points: list[np.ndarray] = []
    for letter, numbers in re.findall(r"([MLC]) ([-0-9. ]+)", loop):
        p = np.array(numbers.split(), float).reshape(-1, 2)
        if letter == "C":
            for t in np.linspace(0.05, 0.95, 19):
                weights = [(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3]
                points.append(weights @ np.array([points[-1 - round(t * 20) + 1], *p]))
        points.append(p[-1])
    return np.array(points)


@pytest.mark.parametrize("name", [*PADS, "turned"])
def test_a_print_shows_each_marker_where_its_file_says(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The reference is the pad drawn by the vision tests, which shares no code with the print."""
    file, pad = tmp_path / "cut.svg", tmp_path / "turned.yaml"
    pad.write_text(TURNED)
    pad = config_files("pads").get(name, pad)
    said(capsys, pad, "-o", file, "--outline")
    layout, per_mm = load_pad(pad), 0.5
    p = layout.plate
    size = 1e3 * (p.west_m + p.east_m), 1e3 * (p.north_m + p.south_m)
    root = ET.parse(file).getroot()
    assert root.attrib["width"] == f"{size[0]:.4f}mm"
    assert root.attrib["viewBox"] == f"0 0 {size[0]:.4f} {size[1]:.4f}"
    # Outlines are contours, one a path: what lies in an odd number of them is black.
    assert all(path.attrib["d"].count("Z") == 1 for path in root.iter(f"{SVG}path"))
    merged = " ".join(path.attrib["d"] for path in root.iter(f"{SVG}path"))
    whole = tmp_path / "whole.svg"
    whole.write_text(f'<svg xmlns="{SVG[1:-1]}"><path d="{merged}"/></svg>')
    black = black_in(whole, size, per_mm)
    rows, columns = black.shape
    east = (np.arange(columns) + 0.5) / (1e3 * per_mm) - p.west_m
    north = p.north_m - (np.arange(rows) + 0.5) / (1e3 * per_mm)
    grid = np.meshgrid(east.astype(np.float32), north.astype(np.float32))
    _, white = painted(layout, grid[1], grid[0])
    wrong = (black > 0) == white
    kernel = np.ones((3, 3), np.uint8)
    beside_edges = cv2.dilate(black, kernel) != cv2.erode(black, kernel)
    assert not (wrong & ~beside_edges).any()
    assert black.any()


def test_a_cutter_gets_only_closed_contours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "cut.svg"
    said(capsys, "whycode-nested", "-o", file, "--outline")
    root = ET.parse(file).getroot()
    assert {child.tag for child in root} == {f"{SVG}title", f"{SVG}path"}
    paths = list(root.iter(f"{SVG}path"))
    assert len(paths) == 4  # outer and inner edge of two codes
    assert {path.attrib["fill"] for path in paths} == {"none"}
    for path in paths:
        d = path.attrib["d"].split()
        assert (d[1:3], d[-1]) == (d[-3:-1], "Z")


@dataclass(frozen=True)
class PdfPage:
    """A page of a PDF, mm."""

    size: tuple[float, float]
    window: list[float]  # x, y, width and height of the print
    place: list[float]  # the matrix that puts the pad there
    text: str
    content: str


def pages_of(file: Path) -> list[PdfPage]:
    data = file.read_bytes().decode("cp1252")
    pages = []
    contents = re.findall(r"stream\n(.*?)\nendstream", data, re.DOTALL)[1:]
    sizes = re.findall(r"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data)
    for content, (width, height) in zip(contents, sizes, strict=True):
        found = re.search(r"q ([-\d. ]+) re W n ([-\d. ]+) cm", content)
        assert found is not None
        window, place = ([float(v) for v in group.split()] for group in found.groups())
        text = " ".join(re.findall(r"\((.*?)\) Tj", content))
        size = float(width) / 72 * 25.4, float(height) / 72 * 25.4
        pages.append(PdfPage(size, window, place, text, content))
    return pages


@pytest.mark.parametrize("name", PADS)
@pytest.mark.parametrize(
    ("paper", "sides"), [("a4", (210, 297)), ("a3", (297, 420)), ("letter", (215.9, 279.4))]
)
def test_sheets_cover_the_pad_with_overlap_at_true_size(
    name: str,
    paper: str,
    sides: tuple[float, float],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "pad.pdf"
    result = said(capsys, name, "-o", file, "--paper", paper, "--overlap", "12mm")
    plan, *sheets = pages_of(file)
    assert len(sheets) == result["sheets"] == result["rows"] * result["columns"]
    p = load_pad(config_files("pads")[name]).plate
    whole = 1e3 * (p.west_m + p.east_m), 1e3 * (p.north_m + p.south_m)
    for i, sheet in enumerate(sheets):
        assert sorted(sheet.size) == pytest.approx(sorted(sides), abs=1e-3)
        x, y, w, h = sheet.window
        a, b, c, d, left, top = sheet.place
        assert (a, b, c, d) == (1, 0, 0, 1)
        row, column = divmod(i, result["columns"])
        assert x - left == pytest.approx(column * (w - 12), abs=1e-3)
        assert y - top == pytest.approx(row * (h - 12), abs=1e-3)
        assert f"sheet {i + 1} of {len(sheets)}" in sheet.text
        assert min(x, y, sheet.size[0] - x - w) >= 9.999
        assert sheet.size[1] - y - h >= 25.999
        if i == len(sheets) - 1:
            assert (x - left + w, y - top + h) == pytest.approx(whole, abs=1e-3)
    assert "100 %" in plan.text


def test_a_pdf_is_sound_and_each_sheet_has_a_bar_of_100_mm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "pad.pdf"
    said(capsys, "thesis", "-o", file)
    data = file.read_bytes()
    table = int(data.rsplit(b"startxref\n", 1)[1].split()[0])
    assert data[table:].startswith(b"xref\n")
    offsets = re.findall(rb"(\d{10}) 00000 n ", data[table:])
    for number, offset in enumerate(offsets, 1):
        assert data[int(offset) :].startswith(b"%d 0 obj\n" % number)
    for length, stream in re.findall(
        rb"/Length (\d+) >>\nstream\n(.*?)\nendstream", data, re.DOTALL
    ):
        assert int(length) == len(stream)
    for page in pages_of(file):
        lines = re.findall(r"([\d.]+) ([\d.]+) m ([\d.]+) ([\d.]+) l S", page.content)
        level = [float(c) - float(a) for a, b, c, d in lines if b == d]
        assert any(length == pytest.approx(100.0, abs=1e-3) for length in level)
        assert "100 mm" in page.text


def test_one_sheet_for_a_print_shop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "pad.pdf"
    assert said(capsys, "thesis", "-o", file, "--paper", "sheet")["sheets"] == 1
    (page,) = pages_of(file)
    assert page.size == pytest.approx((1280, 1680), abs=1e-3)
    assert page.window == [20, 20, 1240, 1640]
    trim = re.search(rb"/TrimBox \[([\d. ]+)\]", file.read_bytes())
    assert trim is not None
    edges = [float(v) / 72 * 25.4 for v in trim[1].split()]
    assert edges == pytest.approx([20, 20, 1260, 1660], abs=1e-3)


def test_a_measured_ruler_scales_all_markers_and_places(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    said(capsys, "thesis", "--measured", "ruler=99.2mm", "-o", file)
    before, after = load_pad(config_files("pads")["thesis"]), load_pad(file)
    assert after.rings[0].outer_diameter_m == pytest.approx(0.992)
    assert after.rings[0].inner_ratio == before.rings[0].inner_ratio
    assert after.squares[0].size_m == pytest.approx(0.31)
    assert after.squares[0].position_m == pytest.approx((0.744, 0.0))
    assert after.plate.north_m == pytest.approx(0.992 * 1.02)
    assert after.name == before.name


def test_a_pad_file_is_not_scaled_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine, printed = str(tmp_path / "mine.yaml"), str(tmp_path / "printed.yaml")
    said(capsys, "--for", "60cm", "--seen-from", "8m", "-o", mine)
    measured = ["--measured", "ruler=99.2mm", "-o"]
    said(capsys, mine, *measured, printed)
    said(capsys, mine, *measured, printed)  # of the same print: the same file
    before = Path(printed).read_text(), Path(mine).read_text()
    for pad, output in ((mine, mine), ("thesis", printed)):
        assert main(["pad", pad, *measured, output]) == 2
        assert capsys.readouterr().err == (
            f"{output}: exists already, with other contents; choose another -o\n"
        )
    assert before == (Path(printed).read_text(), Path(mine).read_text())
    again = str(tmp_path / "again.yaml")
    for output in (printed, again):
        assert main(["pad", printed, *measured, output]) == 2
        assert capsys.readouterr().err == (
            f"{printed}: was measured already, ruler would scale it again; name the pad as it was "
            "printed\n"
        )
    assert before == (Path(printed).read_text(), Path(mine).read_text())
    assert not Path(again).exists()


def test_single_markers_are_measured_on_a_pad_that_the_ruler_scaled(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    by_ruler, mine = tmp_path / "by-ruler.yaml", tmp_path / "mine.yaml"
    said(capsys, "thesis", "--measured", "ruler=99.2mm", "-o", by_ruler)
    said(capsys, by_ruler, "--measured", "whycon=994mm", "-o", mine)
    after = load_pad(mine)
    assert after.rings[0].outer_diameter_m == pytest.approx(0.994)
    assert after.squares[0].size_m == pytest.approx(0.31)


def test_a_markers_own_measured_size_takes_precedence_over_the_ruler(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    measured = ["--measured", "whycon=99.5cm", "--measured", "ruler=99mm"]
    said(capsys, "nested", *measured, "-o", file)
    after = load_pad(file)
    assert after.rings[0].outer_diameter_m == pytest.approx(0.995)
    assert after.squares[0].size_m == pytest.approx(0.99 * 0.18)


def test_a_measured_pad_file_keeps_the_tolerances_that_it_states(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pad = tmp_path / "pad.yaml"
    text = config_files("pads")["whycode"].read_text() + "flatness_deg: 0.5\n"
    pad.write_text(text.replace("name: whycode", "name: 'yes: no'"))
    said(capsys, pad, "--measured", "whycode-5=446mm", "-o", tmp_path / "mine.yaml")
    after = load_pad(tmp_path / "mine.yaml")
    assert (after.name, after.flatness_deg) == ("yes: no", 0.5)
    assert after.whycodes[0].outer_diameter_m == pytest.approx(0.446)


@pytest.mark.parametrize(
    ("side", "distances", "kinds"),
    [
        ("0.6m", [8.0], ["whycode"]),
        ("1.2m", [15.0], ["whycode", "whycode"]),
        ("120cm", [20.0, 0.6], ["whycon", "apriltag"]),
    ],
)
def test_a_proposed_pad_is_seen_from_the_wanted_distance_and_near_the_ground(
    side: str,
    distances: list[float],
    kinds: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "mine.pdf"
    result = said(capsys, "--for", side, "--seen-from", f"{distances[0]}m", "-o", file)
    assert result["files"] == [str(tmp_path / "mine.yaml"), str(file)]
    layout = load_pad(tmp_path / "mine.yaml")
    assert [m.kind for m in layout.markers] == kinds
    for d in distances:
        view = look(THESIS_CAMERA, d, 0.05, pixel=(310, 235), heading=1.0)
        image = render(view, THESIS_CAMERA, Optics(), np.random.default_rng(2), layout)
        found = Vision(layout, THESIS_CAMERA, VisionSection()).process(Frame(0.0, 0, image))
        assert found.pad, f"not seen from {d} m"
        assert math.dist(found.pad[0].position, view.position) < 0.03 * d


def test_a_longer_lens_sees_a_smaller_pad_as_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration = yaml.safe_load((config_files("cameras")["thesis"]).read_text())
    matrix = calibration["camera_matrix"]["data"]
    matrix[0], matrix[4] = 2 * matrix[0], 2 * matrix[4]
    camera = tmp_path / "camera.yaml"
    camera.write_text(yaml.safe_dump(calibration))
    wanted = ["--for", "0.6m", "--seen-from", "16m", "-o", tmp_path / "mine.yaml"]
    result = said(capsys, *wanted, "--camera", camera)
    assert [m["name"] for m in result["markers"]] == ["whycode-5"]


def test_landerds_own_camera_is_found_anywhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wanted = ["--for", "60cm", "--seen-from", "8m", "-o", "mine.yaml"]
    by_name = said(capsys, *wanted, "--camera", "cameras/thesis.yaml")
    assert by_name == said(capsys, *wanted)


def test_it_prints_the_markers_the_sheets_and_the_files_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["pad", "nested", "-o", str(tmp_path / "pad.pdf")]) == 0
    out = capsys.readouterr().out
    assert "whycon         1000 mm, seen from 25 m" in out
    assert "sheets of A4" in out
    assert f"wrote {tmp_path / 'pad.pdf'}" in out


def test_a_length_off_by_more_than_printers_err_is_questioned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for what, told in (
        ("whycon=982mm", ""),
        ("whycon=1.1m", "whycon: off by 3 % or more; was it printed at 100 %?"),
        ("ruler=98.2mm", ""),
        ("ruler=94mm", "ruler: off by 3 % or more; was it printed at 100 %?"),
    ):
        file = str(tmp_path / f"{what}.yaml")
        assert main(["pad", "nested", "--measured", what, "-o", file]) == 0
        said = capsys.readouterr()
        assert told in said.err
        assert bool(told) == bool(said.err)
    assert "plate 1.1656 m wide" in said.out


def exit_code(*arguments: str) -> object:
    try:
        return main(arguments)
    except SystemExit as e:
        return e.code


WRONG = [
    ("none.yaml -o a.pdf", "none.yaml: no such file, and none of landerd's own pads: bundle, n"),
    ("nested -o no/a.pdf", "expected a .pdf in a folder that exists"),
    ("nested -o a.png", "expected a .pdf, .svg, .yaml"),
    ("nested -o a.yaml", "a pad file only with --measured or --for"),
    ("nested -o a.svg --paper a4", "an SVG has one page"),
    ("nested -o a.pdf --outline", "--outline: an SVG"),
    ("nested -o a.pdf --measured ruler=99mm", "-o NAME.yaml"),
    ("nested -o a.yaml --measured ring=99mm", "on this pad: ruler, whycon, apriltag-1"),
    ("nested -o a.yaml --measured ruler=9.92mm", "9.92 mm is far from the 100 mm"),
    ("nested -o a.yaml --measured ruler=99.2", "a length above 0 with its unit"),
    ("-o a.pdf --for 1.2m --seen-from 0m", "found '0m', expected a length above 0"),
    ("nested -o a.yaml --measured ruler", "WHAT=LENGTH"),
    ("nested -o a.pdf --overlap 80mm", "expected 0 to 50mm"),
    ("nested -o a.pdf --overlap=-1mm", "found '-1mm', expected 0 to 50mm"),
    ("nested -o a.pdf --camera c.yaml", "--camera: only with --for"),
    ("-o a.pdf --for 1.2m", "--for and --seen-from"),
    ("nested -o a.pdf --for 1.2m --seen-from 9m", "nested: not with --for"),
    ("-o a.pdf --for 1.2m --seen-from 90m", "a pad of 4.5 m, or a camera of longer focal length"),
    ("-o a.pdf --for 7m --seen-from 9m --paper sheet", "a PDF's is at most 5.08 m"),
    ("-o taken.pdf --for 1m --seen-from 9m", "taken.yaml: exists already"),
    ("over.yaml -o a.pdf", "over.yaml: the whycon reaches over the plate's edge"),
]


@pytest.mark.parametrize(("arguments", "says"), WRONG)
def test_wrong_input_is_one_clear_line_and_nothing_is_written(
    arguments: str,
    says: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.yaml").write_text("name: mine\n")
    nested = config_files("pads")["nested"].read_text()
    (tmp_path / "over.yaml").write_text(nested.replace("east_m: 0.62", "east_m: 0.4"))
    before = sorted(tmp_path.iterdir())
    assert exit_code("pad", *arguments.split()) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert len(told.err.splitlines()) == 1
    assert says in told.err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nested", "--measured", "ruler=99mm", "--measured", "ruler=98mm"], "given twice"),
        (["in_mm.yaml"], "in the pad file metres"),
        ([""], "expected the name of a pad"),
    ],
)
def test_slips_of_the_pen_in_arguments_and_pad_files_are_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in_mm.yaml").write_text(
        "name: in millimetres\nmarkers: [{kind: whycon, outer_diameter_m: 1000}]\n"
        "plate: {north_m: 620, south_m: 620, east_m: 620, west_m: 620}\n"
    )
    output = Path("out.yaml" if "--measured" in arguments else "out.pdf")
    assert main(["pad", *arguments, "-o", str(output)]) == 2
    assert expected in capsys.readouterr().err
    assert not output.exists()


def test_markers_that_lie_over_each_other_are_told_before_they_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "over.yaml"
    file.write_text(TURNED.replace("[0.19, 0.1]", "[0.15, 0.1]"))
    assert main(["pad", str(file), "-o", str(tmp_path / "over.pdf")]) == 0
    assert "aruco 3 of 90 mm lie over each other" in capsys.readouterr().err
    assert main(["pad", "-o", str(tmp_path / "thesis.pdf")]) == 0
    assert capsys.readouterr().err == ""
