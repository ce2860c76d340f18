"""Prints pads by `landerd pad`, joins the sheets by their marks, and measures photographs of them.

    python -m bench.pad_print                 # every layout of config/pads on every paper, 300 dpi
    python -m bench.pad_print --dpi 100

Nothing is printed on paper: pages are rasterised, and photographs rendered. For each layout and
paper there are the number of sheets; the number of pixels in which the joined pad differs from that
on a single sheet, except at edges; and for each marker the error of its size, as `landerd detect`
measures it in photographs, on average and in the worst one.
"""

import argparse
import contextlib
import io
import json
import math
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from landerd.cli import main as landerd
from landerd.config.files import config_dir, config_files
from landerd.pad import Marker, load_pad, size_m
from tests.printing.prints import Print, put_together, rasterised, trimmed
from tests.vision import scenes

CAMERA = scenes.THESIS_CAMERA
SHEET_MARGIN_MM = 20.0


def printed(pad: Path, paper: str, dpi: float, folder: Path) -> tuple[int, Print]:
    """Print a pad and join its sheets; return the number of sheets and the joined pad."""
    file = folder / "pad.pdf"
    (result,) = said_by("pad", str(pad), "-o", str(file), "--paper", paper, "--json")
    layout = load_pad(pad)
    if paper == "sheet":
        page = rasterised(file, 0, dpi)
        return 1, Print(layout, trimmed(page, layout, SHEET_MARGIN_MM, SHEET_MARGIN_MM, dpi), dpi)
    pages = [rasterised(file, 1 + i, dpi) for i in range(result["sheets"])]
    grey = put_together(pages, result["rows"], result["columns"], dpi)
    return result["sheets"], Print(layout, grey, dpi)


def said_by(*arguments: str) -> list[Any]:
    """Run landerd with some arguments and return the JSON objects that it prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert landerd(arguments) == 0
    return [json.loads(line) for line in out.getvalue().splitlines()]


def errors(pad: Path, on_paper: Print, marker: Marker, views: int, folder: Path) -> list[float]:
    """Return the relative errors of a marker's size, as measured in photographs.

    Args:
        pad: the pad's file.
        on_paper: the joined pad.
        marker: of the pad.
        views: number of photographs.
        folder: for the photographs.
    """
    rng = np.random.default_rng(1)
    truth = {}
    for i in range(views):
        offset = math.hypot(*marker.position_m)
        distance = max(6.0 * size_m(marker), 2.5 * offset) * (1.0 + 0.1 * i)
        view = scenes.look(
            CAMERA, distance, 0.1 * i, pixel=(300, 230), tilt_towards=i, heading=1.3 * i
        )
        image = scenes.render(
            view, CAMERA, scenes.Optics(), rng, on_paper.layout, paint=on_paper.paint
        )
        cv2.imwrite(str(folder / f"{i}.png"), image)
        north, east = marker.position_m
        truth[f"{i}.png"] = np.array(view.position) + view.R_camera_pad[:, :2] @ [north, east]
    camera = str(config_dir() / "cameras" / "thesis.yaml")
    found = []
    for seen in said_by("detect", str(folder), "--camera", camera, "--pad", str(pad), "--json"):
        true = truth[Path(seen["image"]).name]
        for m in seen["markers"]:
            if m["kind"] == marker.kind and m["id"] == getattr(marker, "id", None):
                # A marker that looks larger than its file says is taken to be nearer.
                found.append(float(np.linalg.norm(true) / np.linalg.norm(m["position_m"])) - 1.0)
    return found


def one(pad: Path, paper: str, dpi: float, views: int, whole: Print | None) -> Print:
    """Print the lines of a pad on a paper; return the joined pad.

    `whole` is the pad on a single sheet, with which it is compared; None: it is that sheet.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sheets, on_paper = printed(pad, paper, dpi, folder)
        off = "" if whole is None else f", {whole.differences(on_paper)} px differ"
        print(f"{pad.stem}, {paper}: {sheets} sheets{off}", flush=True)
        for i, marker in enumerate(on_paper.layout.markers):
            photographs = folder / str(i)
            photographs.mkdir()
            e = errors(pad, on_paper, marker, views, photographs)
            worst = max(map(abs, e), default=math.nan)
            what = f"{marker.kind} {getattr(marker, 'id', '')}"
            print(
                f"  {what:14} found {len(e)} of {views}, size off by {np.mean(e):+.3%} on average, "
                f"{worst:.3%} at worst",
                flush=True,
            )
    return on_paper


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--dpi", type=float, default=300.0)
    parser.add_argument("--views", type=int, default=6, help="photographs a marker (6)")
    parser.add_argument("--pads", nargs="+", default=list(config_files("pads")))
    parser.add_argument("--papers", nargs="+", default=["a4", "a3", "letter"])
    args = parser.parse_args()
    cv2.setNumThreads(1)
    for name in args.pads:
        pad = config_files("pads")[name]
        whole = one(pad, "sheet", args.dpi, args.views, None)
        for paper in args.papers:
            one(pad, paper, args.dpi, args.views, whole)


if __name__ == "__main__":
    main()
