"""Rates of right and wrong readings, and errors of pose and north, of WhyCodes in rendered images.

    python -m bench.vision_whycode                 # one 1 m code of 6 bits, small cells
    python -m bench.vision_whycode --images 200    # as quoted

Every third image of a cell shows another number than the pad's: whatever is reported then is wrong.
Nothing is known beforehand, not even gravity.
"""

import argparse
import math
import time
from dataclasses import dataclass, field

import cv2
import numpy as np

from landerd.config.models import VisionSection
from landerd.messages import Frame
from landerd.pad import PadLayout, Plate, WhyCode, whycode_ids
from landerd.vision import Vision
from tests.vision import scenes

CAMERA = scenes.THESIS_CAMERA
# A normal with a larger error is that of the other solution.
FLIPPED = math.cos(math.radians(20.0))


@dataclass
class Cell:
    """What was read in the images of one distance and angle."""

    images: int = 0  # images of the pad's number
    read: int = 0  # sightings in them
    wrong: int = 0  # images of another number in which the pad's was reported
    others: int = 0  # images of another number
    flips: int = 0  # sightings with the wrong solution first
    errors_mm: list[float] = field(default_factory=list)  # of the position
    yaws_deg: list[float] = field(default_factory=list)  # absolute errors of north
    ms: list[float] = field(default_factory=list)  # CPU times of searches

    def line(self) -> str:
        """Return the table's columns."""
        text = f"{self.images:5d} {self.read / max(1, self.images):7.1%}"
        text += f" {self.wrong:3d} of {self.others:3d} {self.flips / max(1, self.read):7.2%}"
        if self.read:
            e, y = np.array(self.errors_mm), np.array(self.yaws_deg)
            text += f" {np.median(e):8.2f} {np.percentile(e, 95):7.1f}"
            text += f" {np.median(y):7.3f} {y.max():6.2f}"
        else:
            text += " " * 31
        return text + f" {np.median(self.ms):7.2f}"


def pad(number: int, bits: int) -> PadLayout:
    """Return a pad with one WhyCode of 1 m, with a number of some bits."""
    code = WhyCode(kind="whycode", outer_diameter_m=1.0, bits=bits, id=number)
    plate = Plate(north_m=0.62, south_m=0.62, east_m=0.62, west_m=0.62)
    return PadLayout(name="code", markers=(code,), plate=plate)


def run_cell(images: int, bits: int, distance: float, angle: float, seed: int) -> Cell:
    """Make, search and count the images of one cell.

    Args:
        images: number of images of the pad's number, about.
        bits: of the numbers.
        distance: of the pad, m.
        angle: between the line of sight and the pad's normal, degrees.
        seed: of all that is random.
    """
    rng = np.random.default_rng([seed, bits, round(distance * 10), round(angle)])
    ids = whycode_ids(bits)
    cell = Cell()
    for i in range(images * 3 // 2):
        number = int(rng.choice(ids))
        printed = number if i % 3 else int(rng.choice([n for n in ids if n != number]))
        layout = pad(printed, bits)
        view = scenes.random_view(rng, CAMERA, distance, math.radians(angle), layout.whycodes[0])
        if view is None:
            continue
        image = scenes.render(view, CAMERA, scenes.random_optics(rng), rng, layout)
        vision = Vision(pad(number, bits), CAMERA, VisionSection())
        began = time.process_time()
        found = vision.process(Frame(0.0, 0, image))
        cell.ms.append((time.process_time() - began) * 1e3)
        if printed != number:
            cell.others += 1
            cell.wrong += len(found.markers) > 0
            continue
        cell.images += 1
        for marker in found.markers:
            best = marker.solutions[0]
            assert best.north is not None
            cell.read += 1
            cell.errors_mm.append(1e3 * math.dist(best.position, view.position))
            cell.flips += float(np.dot(best.normal, view.normal)) < FLIPPED
            north, east, _ = np.array(best.north) @ view.R_camera_pad
            cell.yaws_deg.append(abs(math.degrees(math.atan2(east, north))))
    return cell


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--images", type=int, default=10, help="images a cell (10)")
    parser.add_argument("--bits", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--distances", type=float, nargs="+", default=[3, 5, 8, 10, 12, 15, 20, 25])
    parser.add_argument("--angles", type=float, nargs="+", default=[0, 30, 45])
    args = parser.parse_args()
    cv2.setNumThreads(1)
    print("  d m  deg  images  read  wrong id    flips  median_mm  p95_mm yaw_deg    max  ms med")
    for distance in args.distances:
        for angle in args.angles:
            cell = run_cell(args.images, args.bits, distance, angle, args.seed)
            print(f"{distance:5.1f} {angle:4.0f} {cell.line()}", flush=True)


if __name__ == "__main__":
    main()
