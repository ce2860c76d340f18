"""Errors of the landing point of pads that differ from their file, in rendered pictures.

    python -m bench.vision_pad --images 20            # single pictures, nothing known beforehand
    python -m bench.vision_pad --images 20 --approach # after six pictures on the way there

`aside` is the part of the error across the line of sight, `along` that along it; `inside` is the
share of errors within the stated 95 % region in three dimensions; `told` is the share of pictures
in which landerd says that markers disagree.
"""

import argparse
import math
from dataclasses import dataclass, replace

import numpy as np

from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, PadPose
from landerd.config.models import VisionSection
from landerd.geometry import IDENTITY
from landerd.messages import Frame
from landerd.vision import Vision
from landerd.vision.pose import mat3
from tests.vision import scenes

PAD, CAMERA = scenes.THESIS_PAD, scenes.THESIS_CAMERA
CHI2_95 = 7.815  # 95 % quantile of chi-square with three degrees of freedom
DISTANCES = (0.7, 1.0, 2.0, 4.0, 7.0, 10.0)
MOST_DEG = 45.0  # largest angle between the line of sight and the pad's normal
AT = PadPose((0.0, 0.0, 0.0), IDENTITY)


@dataclass(frozen=True)
class Kind:
    """A difference of pad or lens from their files."""

    name: str
    pad: PadOptions
    focal: float = 1.0  # true focal length over the calibrated one


def _pad(**changes: float) -> PadOptions:
    """Return options of a pad at the origin with some changes."""
    return PadOptions(position_m=(0.0, 0.0)).model_copy(update=changes)


KINDS = (
    Kind("as filed", _pad()),
    Kind("bent 4 deg", _pad(bend_deg=4.0)),
    Kind("bent -4 deg", _pad(bend_deg=-4.0)),
    Kind("print 2 %", _pad(print_scale=1.02)),
    Kind("misplaced 5 mm", _pad(marker_error_m=0.005)),
    Kind("focal 1 %", _pad(), 1.01),
)


@dataclass
class Cell:
    """Errors of the pictures of one kind at one distance."""

    aside_mm: list[float]  # across the line of sight
    along_mm: list[float]  # along it, absolute
    inside: int = 0  # number within the stated 95 % region
    images: int = 0
    told: int = 0  # number of pictures in which landerd says that markers disagree

    def line(self) -> str:
        """Return the table's columns."""
        found = len(self.aside_mm)
        if not found:
            return f"{self.images:6d}      0 %"
        aside, along = np.array(self.aside_mm), np.array(self.along_mm)
        return (
            f"{self.images:6d} {100 * found / self.images:6.0f} % {np.median(aside):8.1f} "
            f"{np.percentile(aside, 95):8.1f} {np.median(along):8.1f} "
            f"{100 * self.inside / found:7.0f} % {100 * self.told / self.images:6.0f} %"
        )


def view_at(distance: float, tilt: float, rng: np.random.Generator) -> scenes.View:
    """Return a random view of the pad near the image's centre.

    Args:
        distance: of the pad, m.
        tilt: angle between the line of sight and the pad's normal, rad.
        rng: of everything else.
    """
    return scenes.look(
        CAMERA,
        distance,
        tilt,
        pixel=(rng.uniform(250.0, 350.0), rng.uniform(200.0, 260.0)),
        tilt_towards=rng.uniform(0.0, 2.0 * math.pi),
        heading=rng.uniform(0.0, 2.0 * math.pi),
    )


def measure(kind: Kind, distance: float, images: int, *, approach: bool, verbose: bool) -> Cell:
    """Return what was measured in pictures of one kind at one distance.

    Args:
        kind: of pad and lens.
        distance: of the pad, m.
        images: number of pictures.
        approach: whether each picture is the last of seven on the way from 4 m, or from half as far
            again if that is more.
        verbose: whether to print what landerd says of disagreements.
    """
    camera = replace(CAMERA, fx=kind.focal * CAMERA.fx, fy=kind.focal * CAMERA.fy)
    rng = np.random.default_rng(7)
    cell = Cell([], [])
    for seed in range(images):
        layout = printed(PAD, kind.pad, seed)
        renderer = Renderer(layout, camera, RenderOptions(gradient=0.0), seed, None, kind.pad)
        vision = Vision(PAD, CAMERA, VisionSection())
        tilt = math.radians(rng.uniform(0.0, MOST_DEG))
        view = view_at(distance, tilt, rng)
        t = np.array(view.position)
        further = [t * k for k in np.geomspace(max(4.0, 1.5 * distance) / distance, 1.0, 7)]
        for i, at in enumerate(further if approach else [t]):
            R = view.R_camera_pad
            position = -R.T @ at
            pose = CameraPose((position[0], position[1], position[2]), mat3(R.T))
            image = renderer.render(i, pose, pose, AT, None)
            seen = vision.process(Frame(i / 30.0, i, image))
        cell.images += 1
        wrong = vision.disagreement()
        cell.told += wrong is not None
        if wrong is not None and verbose:
            print(f"    {wrong.text}")
        if not seen.pad:
            continue
        error = np.array(seen.pad[0].position) - t
        sight = t / np.linalg.norm(t)
        if np.linalg.norm(error) > 0.1 * distance:
            continue
        cell.along_mm.append(1e3 * abs(float(error @ sight)))
        cell.aside_mm.append(1e3 * float(np.linalg.norm(error - sight * (error @ sight))))
        covariance = np.array(seen.pad[0].covariance)
        cell.inside += float(error @ np.linalg.solve(covariance, error)) < CHI2_95
    return cell


def main() -> None:
    """Print the tables asked for."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=20, help="per line")
    parser.add_argument("--approach", action="store_true", help="after pictures from farther off")
    parser.add_argument("--verbose", action="store_true", help="what is told of disagreements")
    parser.add_argument("--distances", default=",".join(f"{d:g}" for d in DISTANCES))
    args = parser.parse_args()
    print("                       images   found  aside_mm   95 % mm  along_mm   inside    told")
    for kind in KINDS:
        for distance in (float(d) for d in args.distances.split(",")):
            cell = measure(
                kind, distance, args.images, approach=args.approach, verbose=args.verbose
            )
            print(f"{kind.name:15s} {distance:5.1f} m {cell.line()}", flush=True)


if __name__ == "__main__":
    main()
