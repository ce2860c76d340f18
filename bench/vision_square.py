"""Detection rate, errors, stated sigmas and time of the pad's square in rendered images.

There is a row for each distance and angle. Images of the thesis's pad are rendered exactly. Each is
searched with only gravity known, once more as the next frame, and, if pupil-apriltags is installed
(pip install pupil-apriltags), by the AprilTag 3 library (full frame, quad_decimate 2). One core is
used.
"""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np

from bench import peers
from landerd.camera_model import F64
from landerd.config.models import VisionSection
from landerd.geometry import Vec3
from landerd.messages import Frame, MarkerSighting, Prior
from landerd.vision import Vision
from landerd.vision.pose import rotation_from
from landerd.vision.square_pose import poses_from_corners, square_points
from tests.vision.scenes import THESIS_CAMERA, THESIS_PAD, View, look, random_optics, render

CAMERA, PAD = THESIS_CAMERA, THESIS_PAD
SQUARE = PAD.squares[0]
PLACE = np.array([*SQUARE.position_m, 0.0])
# A normal with a larger error is that of the other solution of the planar ambiguity.
FLIPPED = math.cos(math.radians(20.0))
CHI2_3_AT_95 = 7.815  # 95 % quantile of chi-square with three degrees of freedom

Search = Callable[[np.ndarray], F64 | None]


@dataclass
class Cell:
    """What was measured at one distance and angle."""

    images: int = 0
    errors_m: list[float] = field(default_factory=list)  # of the position
    yaws_deg: list[float] = field(default_factory=list)  # absolute errors of yaw
    flips: int = 0  # sightings with the wrong solution first
    inside: int = 0  # position errors inside the stated 95 % region
    inside_yaw: int = 0  # yaw errors inside 1.96 sigma
    full_s: list[float] = field(default_factory=list)  # CPU times of first frames
    next_s: list[float] = field(default_factory=list)  # CPU times of next frames
    peer_errors_m: list[float] = field(default_factory=list)  # the AprilTag 3 library's
    peer_s: list[float] = field(default_factory=list)

    def add(self, seen: MarkerSighting, truth: F64, R: F64) -> None:
        """Add one sighting with the marker's true position (3,), m, and rotation (3, 3)."""
        best = seen.solutions[0]
        assert best.north is not None
        assert best.sigma_yaw is not None
        error = np.array(best.position) - truth
        self.errors_m.append(float(np.linalg.norm(error)))
        self.flips += float(np.dot(best.normal, R[:, 2])) < FLIPPED
        self.inside += float(error @ np.linalg.solve(best.covariance, error)) < CHI2_3_AT_95
        found = rotation_from(np.array(best.normal), np.array(best.north))
        yaw = float(cv2.Rodrigues(found @ R.T)[0].ravel() @ R[:, 2])
        self.yaws_deg.append(abs(math.degrees(yaw)))
        self.inside_yaw += abs(yaw) < 1.96 * best.sigma_yaw


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=20, help="a cell (20)")
    parser.add_argument("--distances", type=float, nargs="+", default=[0.7, 1, 2, 3, 5, 8, 10, 12])
    parser.add_argument("--angles", type=float, nargs="+", default=[0, 30, 45, 60, 70])
    args = parser.parse_args()
    cv2.setNumThreads(1)
    peer = _peer()
    print("  d m  deg | found  pos mm   p95  yaw deg   p95 | flips  in95  yaw95 |", end="")
    print(" full ms  next ms | peer: found  pos mm   ms | full/peer next/peer")
    for distance in args.distances:
        for angle in args.angles:
            rng = np.random.default_rng([int(10 * distance), int(angle)])
            cell = Cell()
            while cell.images < args.images:
                _measure(cell, distance, math.radians(angle), rng, peer)
            print(_row(distance, angle, cell), flush=True)


def _measure(
    cell: Cell, distance: float, angle: float, rng: np.random.Generator, peer: Search | None
) -> None:
    """Make one image, search it, and add the results to a cell."""
    view = _view(rng, distance, angle)
    R = view.R_camera_pad
    truth = np.array(view.position) + R @ PLACE
    image = render(view, CAMERA, random_optics(rng), rng)
    down: Vec3 = (float(R[0, 2]), float(R[1, 2]), float(R[2, 2]))
    vision = Vision(PAD, CAMERA, VisionSection())
    start = time.thread_time()
    first = vision.process(Frame(0.0, 0, image), Prior(down=down))
    middle = time.thread_time()
    vision.process(Frame(1 / 30, 1, image), Prior(down=down))
    cell.full_s.append(middle - start)
    cell.next_s.append(time.thread_time() - middle)
    cell.images += 1
    for marker in first.markers:
        if marker.kind == "apriltag":
            cell.add(marker, truth, R)
    if peer is not None:
        start = time.thread_time()
        corners = peer(image)
        cell.peer_s.append(time.thread_time() - start)
        if corners is not None:
            pose = poses_from_corners(corners, SQUARE.size_m, CAMERA, 0.3)[0]
            cell.peer_errors_m.append(float(np.linalg.norm(pose.t - truth)))


def _view(rng: np.random.Generator, distance: float, angle: float) -> View:
    """Return a random view at a distance, m, and angle, rad, with the whole square in the image."""
    while True:
        pixel = (rng.uniform(0, CAMERA.width), rng.uniform(0, CAMERA.height))
        heading, towards = rng.uniform(0, 2 * math.pi, 2)
        tag = look(CAMERA, distance, angle, pixel=pixel, tilt_towards=towards, heading=heading)
        t = np.array(tag.position) - tag.R_camera_pad @ PLACE
        outline = np.array(tag.position) + square_points(1.25 * SQUARE.size_m) @ (
            tag.R_camera_pad[:, :2].T
        )
        if outline[:, 2].min() < 0.05:
            continue
        px = CAMERA.pixels(outline)
        if px.min() > 0 and (px < (CAMERA.width, CAMERA.height)).all():
            return View((float(t[0]), float(t[1]), float(t[2])), tag.R_camera_pad)


def _peer() -> Search | None:
    """Return the AprilTag 3 library's search for the square; None: it is not installed."""
    try:
        library = peers.AprilTag3(quad_decimate=2.0)
    except ImportError:
        return None

    def search(image: np.ndarray) -> F64 | None:
        found = library.squares(image, SQUARE.dictionary) or []
        return next((corners for number, corners in found if number == SQUARE.id), None)

    return search


def _row(distance: float, angle: float, cell: Cell) -> str:
    """Return a row of the table."""
    n, found = cell.images, max(1, len(cell.errors_m))

    def at(values: list[float], percent: float, unit: float = 1.0) -> float:
        return unit * float(np.percentile(values, percent)) if values else math.nan

    full, following = at(cell.full_s, 50, 1e3), at(cell.next_s, 50, 1e3)
    peer = at(cell.peer_s, 50, 1e3)
    return (
        f"{distance:5.1f} {angle:4.0f} | {len(cell.errors_m) / n:5.0%} "
        f"{at(cell.errors_m, 50, 1e3):7.2f} {at(cell.errors_m, 95, 1e3):6.1f} "
        f"{at(cell.yaws_deg, 50):7.3f} {at(cell.yaws_deg, 95):6.2f} | "
        f"{cell.flips / found:5.1%} {cell.inside / found:5.0%} {cell.inside_yaw / found:5.0%} | "
        f"{full:7.2f} {following:8.2f} | "
        f"{len(cell.peer_errors_m) / n:10.0%} {at(cell.peer_errors_m, 50, 1e3):7.1f} {peer:6.2f} | "
        f"{full / peer:8.2f} {following / peer:8.2f}"
    )


if __name__ == "__main__":
    main()
