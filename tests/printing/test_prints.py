"""Printed pads as pictures: put together by their marks, photographed and measured."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("pypdfium2")

from landerd.cli import main
from landerd.config.files import config_files
from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import PadLayout, load_pad
from landerd.printing.contours import cell_outlines
from landerd.printing.sheets import tiling
from landerd.vision import Vision
from tests.printing.prints import Print, marks, put_together, rasterised, trimmed
from tests.vision.scenes import THESIS_CAMERA, Optics, look, render

DPI = 100.0


def whole(pad: str, folder: Path) -> Print:
    file = folder / "sheet.pdf"
    assert main(["pad", pad, "-o", str(file), "--paper", "sheet"]) == 0
    layout = load_pad(config_files("pads")[pad])
    return Print(layout, trimmed(rasterised(file, 0, DPI), layout, 20.0, 20.0, DPI), DPI)


def glued(pad: str, paper: str, folder: Path) -> Print:
    file = folder / "sheets.pdf"
    assert main(["pad", pad, "-o", str(file), "--paper", paper]) == 0
    layout = load_pad(config_files("pads")[pad])
    tiles = tiling(layout, paper, 10.0)
    pages = [rasterised(file, 1 + i, DPI) for i in range(tiles.sheets)]
    return Print(layout, put_together(pages, tiles.rows, tiles.columns, DPI), DPI)


@pytest.mark.parametrize(("pad", "paper"), [("whycode-nested", "a4"), ("bundle", "a3")])
def test_sheets_cut_and_laid_by_their_marks_are_the_pad(
    pad: str, paper: str, tmp_path: Path
) -> None:
    sheets, sheet = glued(pad, paper, tmp_path), whole(pad, tmp_path)
    # A mark is found to half a pixel (0.13 mm here), and each seam adds its own.
    assert np.abs(np.subtract(sheets.grey.shape, sheet.grey.shape)).max() <= 4
    assert sheet.differences(sheets) == 0
    seen = size_ratio(sheets, 3.0)
    assert seen == pytest.approx(1.0, abs=0.005)


def size_ratio(on_paper: Print, distance: float) -> float:
    """Photograph a print; return how large it looks against what its file says."""
    layout: PadLayout = on_paper.layout
    view = look(THESIS_CAMERA, distance, 0.2, pixel=(310, 235), heading=0.7)
    rng = np.random.default_rng(3)
    image = render(view, THESIS_CAMERA, Optics(), rng, layout, paint=on_paper.paint)
    found = Vision(layout, THESIS_CAMERA, VisionSection()).process(Frame(0.0, 0, image))
    return math.hypot(*view.position) / math.hypot(*found.pad[0].position)


def test_the_thesis_pad_is_measured_on_its_print(tmp_path: Path) -> None:
    assert size_ratio(whole("thesis", tmp_path), 3.0) == pytest.approx(1.0, abs=0.005)


def test_marks_ruler_and_texts_stand_beside_the_print(tmp_path: Path) -> None:
    """A pad that fills its sheets to the margins leaves least room."""
    pad = tmp_path / "pad.yaml"
    text = config_files("pads")["whycode"].read_text().replace("0.45", "0.3")
    edge = "plate: {north_m: 0.251, south_m: 0.251, east_m: 0.185, west_m: 0.185}\n"
    pad.write_text(text[: text.index("plate:")] + edge)
    file = tmp_path / "pad.pdf"
    assert main(["pad", str(pad), "-o", str(file)]) == 0
    layout = load_pad(pad)
    tiles = tiling(layout, "a4", 10.0)
    assert (tiles.rows, tiles.columns) == (2, 2)
    assert tiles.part[0] == pytest.approx(190.0)
    page = rasterised(file, 1, DPI)
    per_mm = DPI / 25.4
    found = marks(page, DPI)
    assert found.across == pytest.approx([10 * per_mm, 190 * per_mm], abs=1.5)
    # Marks, ruler and each line of text are apart from one another.
    foot = (page[round((10 + tiles.part[1] + 0.5) * per_mm) :] < 128).astype(np.uint8)
    count, _, stats, _ = cv2.connectedComponentsWithStats(foot)
    lengths = [s[cv2.CC_STAT_WIDTH] / per_mm for s in stats[1:]]
    assert count > 40
    assert max(lengths) == pytest.approx(100.0, abs=0.5)
    heights = [s[cv2.CC_STAT_HEIGHT] / per_mm for s in stats[1:]]
    assert max(heights) == pytest.approx(6.0, abs=0.5)  # of the ruler's end strokes


def test_cells_that_touch_at_a_corner_are_pieces_of_their_own() -> None:
    two = cell_outlines(np.array([[True, False], [False, True]]))
    assert sorted(len(loop) for loop in two) == [4, 4]
    ring = cell_outlines(np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=bool))
    assert sorted(len(loop) for loop in ring) == [4, 4]
    holes = cell_outlines(~np.pad(np.array([[True, False], [False, True]]), 1))
    assert sorted(len(loop) for loop in holes) in ([4, 4, 4], [4, 8])
