"""Measures the time of searches in pictures without a pad, and the rate of false alarms.

    python -m bench.vision_negatives                       # made look-alikes
    python -m bench.vision_negatives FOLDER                # tiles of a folder's photographs
    python -m bench.vision_negatives FOLDER --tiles 2000   # as quoted

Every tile, cut from a photograph without resizing, is searched with nothing known beforehand, as
several frames in a row, of which the first is searched thoroughly. Times are compared to those of
the AprilTag 3 library (quad_decimate 2, one thread): pip install 'landerd[peers]'. All are CPU
times.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench import peers
from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import PadLayout, Plate, Ring, Square, WhyCode
from landerd.vision import Vision
from tests.vision import scenes

U8 = NDArray[np.uint8]

CAMERA = scenes.THESIS_CAMERA
FRAME_S = 1 / 30
PICTURES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff"}
PLATE = Plate(north_m=0.62, south_m=0.62, east_m=0.62, west_m=0.62)
PADS = {
    "thesis": scenes.THESIS_PAD,
    "ring": PadLayout(
        name="ring",
        markers=(Ring(kind="whycon", outer_diameter_m=1.0),),
        plate=PLATE,
    ),
    "whycode": PadLayout(
        name="whycode",
        markers=(WhyCode(kind="whycode", outer_diameter_m=1.0, bits=6, id=3),),
        plate=PLATE,
    ),
    "tag": PadLayout(
        name="tag",
        markers=(Square(kind="apriltag", dictionary="APRILTAG_36h11", id=1, size_m=0.8),),
        plate=PLATE,
    ),
}


def tiles(folder: Path, count: int) -> Iterator[tuple[str, U8]]:
    """Yield names and tiles from a folder's pictures, about `count` in all.

    Pictures have about the same number of tiles, which are spread evenly over a picture.
    """
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in PICTURES)
    each = max(1, -(-count // max(1, len(files))))
    for file in files[:: max(1, len(files) * each // count)]:
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        if image is None:
            continue
        columns, rows = image.shape[1] // CAMERA.width, image.shape[0] // CAMERA.height
        here = min(each, columns * rows)
        for k in range(here):
            row, column = divmod((2 * k + 1) * columns * rows // (2 * here), columns)
            y, x = row * CAMERA.height, column * CAMERA.width
            tile = image[y : y + CAMERA.height, x : x + CAMERA.width]
            yield f"{file.name} {x},{y}", np.ascontiguousarray(tile, dtype=np.uint8)


def look_alikes(count: int, seed: int) -> Iterator[tuple[str, U8]]:
    """Yield kinds and rendered pictures of things that look like a ring."""
    ratio = scenes.THESIS_PAD.rings[0].inner_ratio
    made = scenes.hard_negatives(np.random.default_rng([seed, 99]), CAMERA, ratio)
    yield from islice(made, count)


def timed_ms(work: Callable[[], object]) -> float:
    """Return the CPU time of a call, ms: the lesser of two."""
    times = []
    for _ in range(2):
        at = time.process_time()
        work()
        times.append(time.process_time() - at)
    return 1e3 * min(times)


def searched(layout: PadLayout, image: U8, frames: int) -> tuple[list[float], int]:
    """Search a tile as several frames in a row.

    Returns:
        the CPU time of each frame, ms, and the number of frames in which a pad was seen.
    """
    vision = Vision(layout, CAMERA, VisionSection())
    times, alarms = [], 0
    for i in range(frames):
        at = time.process_time()
        alarms += bool(vision.process(Frame(i * FRAME_S, i, image)).markers)
        times.append(1e3 * (time.process_time() - at))
    return times, alarms


def line(name: str, times: list[float], peer: list[float]) -> str:
    """Return a row of the table: times, and their ratios to the peer's times on the same tiles."""
    ms, ratio = np.array(times), np.array(times) / np.array(peer)
    return (
        f"{name:>16} {np.median(ms):8.1f} {np.percentile(ms, 99):8.1f} {ms.max():8.1f}"
        f" {np.median(ratio):8.2f} {np.percentile(ratio, 99):8.2f} {ratio.max():8.2f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, nargs="?", help="of photographs without a pad")
    parser.add_argument("--tiles", type=int, default=200, help="about so many (200)")
    parser.add_argument("--frames", type=int, default=5, help="of one tile in a row (5)")
    parser.add_argument("--pads", nargs="+", choices=PADS, default=list(PADS))
    parser.add_argument("--seed", type=int, default=1, help="of made look-alikes (1)")
    args = parser.parse_args()
    detect = partial(peers.quick().squares, dictionary="APRILTAG_36h11")
    cv2.setNumThreads(1)
    peer: list[float] = []
    first: dict[str, list[float]] = {name: [] for name in args.pads}
    worst: dict[str, list[float]] = {name: [] for name in args.pads}
    alarms: dict[str, int] = dict.fromkeys(args.pads, 0)
    given = tiles(args.folder, args.tiles) if args.folder else look_alikes(args.tiles, args.seed)
    for where, image in given:
        peer.append(timed_ms(lambda image=image: detect(image)))  # type: ignore[misc]
        for name in args.pads:
            times, seen = searched(PADS[name], image, args.frames)
            first[name].append(times[0])
            worst[name].append(max(times[1:], default=times[0]))
            alarms[name] += seen > 0
            if seen:
                print(f"{name} pad seen in {where}", flush=True)
    print(f"{len(peer)} tiles, {args.frames} frames of each; false alarms: {alarms}")
    print(f"{'':>16} {'median':>8} {'p99':>8} {'most ms':>8} {'ratio':>8} {'p99':>8} {'most':>8}")
    print(line("AprilTag 3", peer, peer))
    for name in args.pads:
        print(line(f"{name}, first", first[name], peer))
        print(line("later, worst", worst[name], peer))


if __name__ == "__main__":
    main()
