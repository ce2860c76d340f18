"""Detection rate, errors, flips, stated sigmas and time of WhyCon rings in rendered images.

    python -m bench.vision_ring --images 20            # the table of distances and angles
    python -m bench.vision_ring --images 20 --tracking # the same, with a position within 5 %
    python -m bench.vision_ring --only shadow,motion,negatives

All images are made from the seed. The Cramér-Rao bound is that for known optics, computed for the
same view (see `bound_m`). A flip is a fit whose first solution is the wrong one.
"""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel, Window
from landerd.messages import MarkerSighting
from landerd.pad import Ring
from landerd.vision.whycon import find_rings
from tests.vision import scenes

DISTANCES = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 10.0, 12.0, 15.0, 18.0, 20.0, 25.0, 30.0, 40.0)
ANGLES = (0, 30, 45, 60, 70)
CHI2_95 = 7.815  # 95 % quantile of chi-square with three degrees of freedom
RING = scenes.THESIS_PAD.rings[0]
CAMERA = scenes.THESIS_CAMERA


@dataclass
class Cell:
    """What was found in the images of one kind."""

    images: int = 0
    found: int = 0
    false: int = 0  # sightings of something else
    flips: int = 0  # sightings with the wrong solution first
    inside: int = 0  # errors within the stated 95 % region
    errors_mm: list[float] = field(default_factory=list)  # of the position
    bounds_mm: list[float] = field(default_factory=list)  # Cramér-Rao bounds of these errors
    ms: list[float] = field(default_factory=list)  # times of searches

    def add(self, sightings: list[MarkerSighting], view: scenes.View, ms: float) -> None:
        """Count one image with its sightings, truth, and time of the search, ms."""
        self.images += 1
        self.ms.append(ms)
        truth = np.array(view.position)
        reach = 0.1 * float(np.linalg.norm(truth)) + 0.05
        good = False
        for s in sightings:
            best = s.solutions[0]
            error = np.array(best.position) - truth
            if float(np.linalg.norm(error)) > reach or good:
                self.false += 1
                continue
            good = True
            self.found += 1
            self.errors_mm.append(float(np.linalg.norm(error)) * 1e3)
            self.bounds_mm.append(bound_m(view, CAMERA, RING) * 1e3)
            square = error @ np.linalg.solve(np.array(best.covariance), error)
            self.inside += int(square < CHI2_95)
            self.flips += int(float(np.array(best.normal) @ view.normal) < math.cos(0.349))

    def __add__(self, other: "Cell") -> "Cell":
        return Cell(
            self.images + other.images,
            self.found + other.found,
            self.false + other.false,
            self.flips + other.flips,
            self.inside + other.inside,
            self.errors_mm + other.errors_mm,
            self.bounds_mm + other.bounds_mm,
            self.ms + other.ms,
        )

    def line(self) -> str:
        """Return the table's columns."""
        if not self.images:
            return "      - not in view"
        detected = 100.0 * self.found / self.images
        text = f"{self.images:5d} {detected:6.1f} % {self.false:4d}"
        if self.found:
            e = np.array(self.errors_mm)
            text += (
                f" {np.median(e):9.2f} {np.percentile(e, 95):9.1f}"
                f" {np.median(e / np.array(self.bounds_mm)):6.2f}"
                f" {100.0 * self.flips / self.found:6.1f} %"
                f" {100.0 * self.inside / self.found:6.1f} %"
            )
        else:
            text += " " * 44
        return text + f" {np.median(self.ms):7.2f} {np.percentile(self.ms, 95):7.2f}"


HEAD = (
    "                     images  found  false median_mm    p95_mm  xCRLB    flips"
    "   in 95%  ms med  ms p95"
)


def bound_m(view: scenes.View, camera: CameraModel, ring: Ring) -> float:
    """Return the Cramér-Rao bound of the rms error of a ring's position, m.

    The offset of an edge with a contrast A, a blur s and noise sigma has a variance of
    2 sqrt(pi) s (sigma / A)^2 for each pixel of its length. The five parameters of the pose move
    the outline, and the information of both edges adds up. Levels and blur are taken as known:
    unknown ones raise the bound by only a few per cent.

    Args:
        view: true pose of the pad.
        camera: the lens.
        ring: its size and ratio.
    """
    optics = scenes.Optics()
    contrast, blur = optics.white - optics.black, math.hypot(optics.blur_px, 0.289)
    variance = 2.0 * math.sqrt(math.pi) * blur * (optics.noise / contrast) ** 2
    information = np.zeros((5, 5))
    for r in (ring.outer_diameter_m / 2, ring.outer_diameter_m / 2 * ring.inner_ratio):
        base = _outline(view, camera, r, np.zeros(5))
        columns = []
        for k in range(5):
            step = np.zeros(5)
            step[k] = 1e-4
            columns.append((_outline(view, camera, r, step) - base) / 1e-4)
        along = np.roll(base, -1, axis=0) - np.roll(base, 1, axis=0)
        length = np.hypot(*along.T) / 2.0
        across = np.column_stack([along[:, 1], -along[:, 0]]) / (2.0 * length[:, None])
        J = np.stack([(c * across).sum(axis=1) for c in columns], axis=1)
        information += (J * length[:, None]).T @ J / variance
    # Frontal views show no tilt to first order; tilts beyond a radian do not occur.
    information[3, 3] += 1.0
    information[4, 4] += 1.0
    return math.sqrt(float(np.trace(np.linalg.inv(information)[:3, :3])))


def _outline(
    view: scenes.View, camera: CameraModel, radius: float, change: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return points (n, 2), px, of a circle of the pad after a small change of its pose.

    The change (5,) is that of the position, camera frame, m, and of the tilt about the pad's
    axes, rad.
    """
    a = np.linspace(0.0, 2.0 * math.pi, 180, endpoint=False)
    R, rest = view.R_camera_pad, np.hypot(change[3], change[4])
    p = np.stack([np.cos(a), np.sin(a), np.zeros_like(a)]) * radius
    if rest > 0.0:
        turn, _ = cv2.Rodrigues(np.array([change[3], change[4], 0.0]))
        p = turn @ p
    return camera.pixels(((np.array(view.position) + change[:3])[:, None] + R @ p).T)


def run_cell(
    images: int,
    rng: np.random.Generator,
    distance: float,
    angle: float,
    tracking: bool,
    alter: Callable[[scenes.Optics, scenes.View], scenes.Optics] | None = None,
) -> Cell:
    """Make, search and count the images of one distance and angle.

    Args:
        images: number of images.
        rng: of all that is random.
        distance: of the pad, m.
        angle: between the line of sight and the pad's normal, degrees.
        tracking: whether the position is known within 5 % of the distance.
        alter: changes the optics of each image; None: nothing does.
    """
    cell = Cell()
    for i in range(images):
        view = scenes.random_view(
            rng, CAMERA, distance, math.radians(angle), RING, centred=i % 2 == 0
        )
        if view is None:
            continue
        optics = scenes.random_optics(rng)
        if alter is not None:
            optics = alter(optics, view)
        image = scenes.render(view, CAMERA, optics, rng)
        window, size = None, None
        if tracking:
            window, size = _window(view, distance, rng)
        began = time.perf_counter()
        found = find_rings(image, RING, CAMERA, window=window, expected_diameter_px=size)
        cell.add(found, view, (time.perf_counter() - began) * 1e3)
    return cell


def _window(view: scenes.View, distance: float, rng: np.random.Generator) -> tuple[Window, float]:
    """Return window and expected diameter, px, for a position within 5 % of the distance."""
    off = rng.normal(0.0, 0.05 / math.sqrt(3.0) * distance, 3)
    off *= min(1.0, 0.05 * distance / float(np.linalg.norm(off)))
    centre = np.array(view.position) + off
    x, y = CAMERA.pixels(centre[None])[0]
    size = CAMERA.fx * RING.outer_diameter_m / float(np.linalg.norm(centre))
    half = 0.75 * size + 0.05 * CAMERA.fx
    return Window(int(x - half), int(y - half), int(x + half), int(y + half)), size


def shadowed(rng: np.random.Generator) -> Callable[[scenes.Optics, scenes.View], scenes.Optics]:
    """Return a change that puts a shadow's edge across the ring."""

    def alter(optics: scenes.Optics, view: scenes.View) -> scenes.Optics:
        edge = scenes.outline(view, CAMERA, RING)
        centre, reach = edge.mean(axis=0), np.ptp(edge, axis=0).max() / 2.0
        a, off = rng.uniform(0, 2 * math.pi), rng.uniform(-0.7, 0.7) * reach
        n = (math.cos(a), math.sin(a))
        point = (float(centre[0] + off * n[0]), float(centre[1] + off * n[1]))
        return replace(optics, shadow=scenes.Shadow(rng.uniform(0.3, 0.55), point, n))

    return alter


def moving(
    px: float, rng: np.random.Generator
) -> Callable[[scenes.Optics, scenes.View], scenes.Optics]:
    """Return a change that moves the image by some pixels during exposure."""

    def alter(optics: scenes.Optics, view: scenes.View) -> scenes.Optics:
        a = rng.uniform(0, 2 * math.pi)
        return replace(optics, motion_px=(px * math.cos(a), px * math.sin(a)))

    return alter


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--images", type=int, default=20, help="images a cell")
    parser.add_argument("--negatives", type=int, default=200, help="hard negatives")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tracking", action="store_true", help="position known within 5 %%")
    parser.add_argument("--only", default="grid,shadow,motion,negatives")
    parser.add_argument("--distances", default=",".join(str(d) for d in DISTANCES))
    parser.add_argument("--angles", default=",".join(str(a) for a in ANGLES))
    args = parser.parse_args()
    cv2.setNumThreads(1)
    what = args.only.split(",")
    if "grid" in what:
        print_grid(args.images, args.seed, args.tracking, args.distances, args.angles)
    if "shadow" in what:
        print_disturbed("shadow", 0.0, args.images, args.seed, args.tracking)
    if "motion" in what:
        for px in (5.0, 10.0, 15.0):
            print_disturbed("motion", px, args.images, args.seed, args.tracking)
    if "negatives" in what:
        print_negatives(args.negatives, args.seed)


def print_grid(images: int, seed: int, tracking: bool, distances: str, angles: str) -> None:
    """Print a row for every distance and angle."""
    print(HEAD)
    for d in (float(v) for v in distances.split(",")):
        row = Cell()
        for a in (float(v) for v in angles.split(",")):
            rng = np.random.default_rng([seed, round(d * 10), round(a)])
            cell = run_cell(images, rng, d, a, tracking)
            print(f"{d:5.1f} m {a:4.0f} deg     {cell.line()}", flush=True)
            row += cell
        print(f"{d:5.1f} m all          {row.line()}", flush=True)


def print_disturbed(name: str, px: float, images: int, seed: int, tracking: bool) -> None:
    """Print rows of images with a shadow's edge across the ring, or with motion by `px` pixels."""
    rng = np.random.default_rng([seed, 77, round(px)])
    total = Cell()
    for d in (2.0, 5.0, 10.0, 15.0):
        for a in (0, 30, 45):
            alter = moving(px, rng) if name == "motion" else shadowed(rng)
            cell = run_cell(max(1, images // 2), rng, d, a, tracking, alter)
            total += cell
            print(f"{name} {px:3.0f} px {d:4.0f} m {a:2d} {cell.line()}", flush=True)
    print(f"{name} {px:3.0f} px all       {total.line()}", flush=True)


def print_negatives(count: int, seed: int) -> None:
    """Print the false alarms in images without a ring."""
    made = scenes.hard_negatives(np.random.default_rng([seed, 99]), CAMERA, RING.inner_ratio)
    alarms: dict[str, int] = {}
    times = []
    for _ in range(count):
        kind, image = next(made)
        began = time.perf_counter()
        found = find_rings(image, RING, CAMERA)
        times.append((time.perf_counter() - began) * 1e3)
        alarms[kind] = alarms.get(kind, 0) + len(found)
    print(
        f"negatives: {count} images, false alarms {alarms}, "
        f"ms median {np.median(times):.2f} p95 {np.percentile(times, 95):.2f}"
    )


if __name__ == "__main__":
    main()
