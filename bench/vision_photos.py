"""Measures how many of the markers in photographs landerd finds, and how many other detectors do.

    python -m bench.vision_photos FOLDER MANIFEST.tsv
    python -m bench.vision_photos FOLDER MANIFEST.tsv --whycon PROGRAM --verbose

MANIFEST is a table with tabs and these columns; a row is one marker that a person sees.

    file    name in FOLDER
    kind    whycon, none (a picture in which no ring of this ratio may be found), or a dictionary
            as in a pad file: APRILTAG_36h11, 4X4_50, ...
    what    inner over outer diameter of the printed ring, which detectors are told; or the id
    x, y    its centre, px; empty: anywhere
    size    its larger diameter or its side, px; empty: any
    group   under which it is counted; empty: kind

The lens is unknown: its focal length is assumed to be --focal times the width. For comparison there
are OpenCV and, if installed, the AprilTag 3 library (both at the picture's own size), and for rings
any PROGRAM that prints "x y" of each ring when called with a grey picture (PGM), the ratio of the
print and the largest number of rings (like the original WhyCon).
"""

import argparse
import csv
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from bench import peers
from landerd.camera_model import CameraModel
from landerd.config.models import VisionSection
from landerd.messages import Frame, MarkerSighting
from landerd.pad import PadLayout, Plate, Ring, Square
from landerd.vision import Vision
from landerd.vision.ring_work import RingWork
from landerd.vision.whycon import find_rings

U8 = NDArray[np.uint8]

_PLATE = Plate(north_m=1.0, south_m=1.0, east_m=1.0, west_m=1.0)
# Largest distance of centres, over the size, and largest ratio of sizes, with which a marker found
# counts as the one asked for.
_SAME_MIDDLE, _SAME_SIZE = 0.35, 1.4
# Number of searches of a picture: at most for rings, and for squares.
_MOST_SEARCHES, _SQUARE_SEARCHES = 40, 16
_MOST_RINGS = 10  # largest number of rings that a program may find


@dataclass(frozen=True)
class Asked:
    """A row of the manifest: a marker that a person sees, or a ring that must not be found."""

    file: str
    kind: str
    what: str
    at: tuple[float, float] | None  # centre, px; None: anywhere
    size: float | None  # px; None: any
    group: str


@dataclass(frozen=True)
class Seen:
    """A marker that a detector found."""

    id: int | None  # of a square
    at: tuple[float, float]  # centre, px
    size: float | None  # px; None: the detector does not report it


# Finds markers of the kind of rows in a picture; None: it does not look for that kind.
Detector = Callable[[U8, list[Asked]], list[Seen] | None]


@dataclass
class Count:
    """What one detector found of one group."""

    asked: int = 0
    found: int = 0
    false: int = 0
    ms: list[float] = field(default_factory=list)  # CPU times of pictures


def manifest(path: Path) -> list[Asked]:
    """Return the rows of a manifest.

    Raises:
        SystemExit: a column is missing or holds no number.
    """
    rows = []
    with path.open(newline="") as lines:
        for number, row in enumerate(csv.DictReader(lines, delimiter="\t"), start=2):
            try:
                at = (float(row["x"]), float(row["y"])) if row["x"] else None
                size = float(row["size"]) if row["size"] else None
                float(row["what"])
                group = row["group"] or row["kind"]
                rows.append(Asked(row["file"], row["kind"], row["what"], at, size, group))
            except (KeyError, TypeError, ValueError) as error:
                raise SystemExit(f"{path}:{number}: not as --help says: {error}") from None
    return rows


def is_ring(asked: Asked) -> bool:
    """Tell whether a row is about rings."""
    return asked.kind in ("whycon", "none")


def is_same(seen: Seen, asked: Asked) -> bool:
    """Tell whether a marker found is the one of a row."""
    if not is_ring(asked) and seen.id != int(asked.what):
        return False
    if asked.size is not None and seen.size is not None:
        small, large = sorted((seen.size, asked.size))
        if large > _SAME_SIZE * small:
            return False
    if asked.at is None:
        return True
    reach = _SAME_MIDDLE * (asked.size or 40.0)
    return float(np.hypot(seen.at[0] - asked.at[0], seen.at[1] - asked.at[1])) < reach


def landerd(focal: float) -> Detector:
    """Return landerd's detector for lenses of a focal length, which is given in widths."""

    def detect(image: U8, asked: list[Asked]) -> list[Seen]:
        h, w = image.shape
        camera = CameraModel(w, h, focal * w, focal * w, 0.5 * (w - 1), 0.5 * (h - 1))
        one = asked[0]
        if is_ring(one):
            ring = Ring(kind="whycon", outer_diameter_m=1.0, inner_ratio=float(one.what))
            sightings = _rings(image, ring, camera)
        else:
            squares = tuple(
                Square(kind=_kind(one.kind), dictionary=one.kind, id=number, size_m=0.2)
                for number in sorted({int(a.what) for a in asked})
            )
            pad = PadLayout(name="photographs", markers=squares, plate=_PLATE)
            sightings = _squares(image, pad, camera)
        return [_seen(s.id, np.array(s.outline_px)) for s in sightings]

    return detect


def _kind(dictionary: str) -> Literal["apriltag", "aruco"]:
    return "apriltag" if dictionary.startswith("APRILTAG") else "aruco"


def _rings(image: U8, ring: Ring, camera: CameraModel) -> list[MarkerSighting]:
    """Return the rings in a picture; a search that is cut short goes on as in the next frame."""
    work = RingWork()
    found = find_rings(image, ring, camera, work=work)
    for _ in range(_MOST_SEARCHES):
        if found or not work.was_cut:
            break
        found = find_rings(image, ring, camera, work=work)
    return found


def _squares(image: U8, pad: PadLayout, camera: CameraModel) -> list[MarkerSighting]:
    """Return the squares in a picture by several searches, each of which looks differently."""
    vision = Vision(pad, camera, VisionSection())
    seen: list[MarkerSighting] = []
    for k in range(_SQUARE_SEARCHES):
        seen += vision.process(Frame(float(k), k, image)).markers
    return seen


def of_squares(find: Callable[[U8, str], peers.Squares | None]) -> Detector:
    """Return a detector of squares from a function that finds those of a dictionary."""

    def detect(image: U8, asked: list[Asked]) -> list[Seen] | None:
        squares = None if is_ring(asked[0]) else find(image, asked[0].kind)
        return None if squares is None else [_seen(i, o) for i, o in squares]

    return detect


def original_whycon(program: Path) -> Detector:
    """Return a detector of rings that calls a program."""

    def detect(image: U8, asked: list[Asked]) -> list[Seen] | None:
        if not is_ring(asked[0]):
            return None
        found = peers.rings(program, image, float(asked[0].what), _MOST_RINGS)
        return [Seen(None, at, None) for at in found]

    return detect


def _seen(number: int | None, outline: NDArray[np.floating]) -> Seen:
    """Return what a detector found, from an outline (n, 2), px."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    x, y = (0.5 * (low + high)).tolist()
    if number is None:
        return Seen(None, (x, y), float((high - low).max()))
    sides = np.hypot(*(outline - np.roll(outline, 1, axis=0)).T)
    return Seen(number, (x, y), float(sides.mean()))


def counted(
    folder: Path, rows: list[Asked], detectors: dict[str, Detector], *, verbose: bool
) -> dict[tuple[str, str], Count]:
    """Run all detectors on all rows; return the counts by group and detector.

    Args:
        folder: of the pictures.
        rows: of the manifest.
        detectors: by name.
        verbose: whether to print what was missed, and false alarms.
    """
    together: dict[tuple[str, str, str], list[Asked]] = defaultdict(list)
    for row in rows:
        together[row.file, row.kind, row.what if is_ring(row) else ""].append(row)
    counts: dict[tuple[str, str], Count] = defaultdict(Count)
    for (file, kind, _), asked in together.items():
        image = cv2.imread(str(folder / file), cv2.IMREAD_GRAYSCALE)
        if image is None:
            print(f"{file}: no picture", file=sys.stderr)
            continue
        for name, detect in detectors.items():
            began = time.process_time()
            seen = detect(np.asarray(image, dtype=np.uint8), asked)
            if seen is None:
                continue
            count = counts[asked[0].group, name]
            count.ms.append(1e3 * (time.process_time() - began))
            if kind == "none":
                count.false += len(seen)
                missed = [f"false at {s.at}" for s in seen]
            else:
                lost = [a for a in asked if not any(is_same(s, a) for s in seen)]
                count.asked += len(asked)
                count.found += len(asked) - len(lost)
                is_placed = is_ring(asked[0]) and all(a.at is not None for a in asked)
                others = [s for s in seen if not any(is_same(s, a) for a in asked)]
                count.false += len(others) if is_placed else 0
                missed = [f"missed {a.what} at {a.at}" for a in lost]
                missed += [f"false at {s.at}, {s.size} px" for s in others if is_placed]
            if verbose and missed:
                print(f"{name}: {file}: {'; '.join(missed)}", flush=True)
    return counts


def main() -> None:
    """Print the table."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("manifest", type=Path)
    parser.add_argument("--focal", type=float, default=0.8, help="length, in widths (0.8)")
    parser.add_argument("--whycon", type=Path, metavar="PROGRAM")
    parser.add_argument("--verbose", action="store_true", help="say what was missed")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    detectors = {"landerd": landerd(args.focal)}
    detectors |= {name: of_squares(find) for name, find in peers.of_squares().items()}
    if args.whycon is not None:
        detectors["WhyCon"] = original_whycon(args.whycon)
    counts = counted(args.folder, manifest(args.manifest), detectors, verbose=args.verbose)
    print(f"{'':28} {'':>10} {'found':>6} {'asked':>6} {'false':>6} {'ms':>7}")
    for (group, name), c in sorted(counts.items()):
        row = f"{c.found:6d} {c.asked:6d} {c.false:6d} {np.median(c.ms):7.1f}"
        print(f"{group:28} {name:>10} {row}")


if __name__ == "__main__":
    main()
