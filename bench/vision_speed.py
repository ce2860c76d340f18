"""Compares the time of vision to that of the AprilTag 3 library in the same run.

A pad with ring and tag is seen from several distances while the image drifts by a few pixels per
frame. Times are medians over frames, each the least of a few repeats, on one core. Ratios are to
pupil-apriltags on the full frame (quad_decimate 2, one thread): pip install 'landerd[peers]'.

Textures are the simulator's grounds without a pad; each is searched with nothing known beforehand,
as several frames in a row, of which the dearest counts.
"""

import resource
import time
from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from bench import peers
from bench.render import GROUNDS, World
from bench.render import View as Pass
from bench.vision_negatives import searched, timed_ms
from hw.sim.snapshot import PadPose
from landerd.camera_model import CameraModel
from landerd.config.models import VisionSection
from landerd.geometry import IDENTITY
from landerd.messages import Frame, PadPrior, Prior
from landerd.vision import Vision
from tests.vision import scenes

DISTANCES = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0)
FRAMES = 12  # at each distance
REPEATS = 3  # of each measurement, of which the least time counts
DRIFT_PX = 2.0  # per frame, at a width of 640 px
FRAME_S = 1 / 30
HEIGHTS_M = (2.0, 5.0, 12.0)  # above each of the simulator's grounds, with the pad out of sight
FAR_PAD = PadPose((500.0, 0.0, 0.0), IDENTITY)
TEXTURE_FRAMES = 6  # of one picture in a row

U8 = NDArray[np.uint8]


def sequence(camera: CameraModel, distance: float) -> list[tuple[U8, scenes.View]]:
    """Return frames of a pad that drifts through the image, each with the true view."""
    rng = np.random.default_rng(7)
    k = camera.width / 640
    frames = []
    for i in range(FRAMES):
        pixel = (camera.cx + k * DRIFT_PX * i, camera.cy - 20.0 * k)
        view = scenes.look(camera, distance, 0.3, pixel=pixel, heading=0.4)
        optics = scenes.Optics(background="grass")
        frames.append((scenes.render(view, camera, optics, rng), view))
    return frames


def least_ms(make: Callable[[], Callable[[], object]]) -> float:
    """Return the least time of a few calls, ms; `make` makes a new function for each call."""
    times = []
    for _ in range(REPEATS):
        work = make()
        at = time.perf_counter()
        work()
        times.append(time.perf_counter() - at)
    return 1e3 * min(times)


def prior_of(view: scenes.View, rng: np.random.Generator) -> Prior:
    """Return the prior of a pad whose position is known to about a hundredth of its distance."""
    position = np.array(view.position)
    off = rng.normal(0.0, 0.002 * float(np.linalg.norm(position)), 3)
    x, y, z = (position + off).tolist()
    down, north = view.normal.tolist(), view.R_camera_pad[:, 0].tolist()
    return Prior(tuple(down), PadPrior((x, y, z), 0.01 * z, tuple(north)))


def tracking_ms(camera: CameraModel, frames: list[tuple[U8, scenes.View]]) -> list[float]:
    """Return the time of each frame but the first while the pad is tracked, ms."""
    runs = []
    for _ in range(REPEATS):
        rng = np.random.default_rng(3)
        vision = Vision(scenes.THESIS_PAD, camera, VisionSection())
        times = []
        for i, (image, view) in enumerate(frames):
            prior = prior_of(view, rng)
            at = time.perf_counter()
            found = vision.process(Frame(FRAME_S * i, i, image), prior)
            times.append(1e3 * (time.perf_counter() - at))
            if not found.pad:
                print(f"  not found: {np.linalg.norm(view.position):.1f} m, frame {i}")
        runs.append(times)
    return [min(times) for times in zip(*runs, strict=True)][1:]


def searching_ms(camera: CameraModel, image: U8) -> float:
    """Return the time of a full search with nothing known, ms."""

    def fresh() -> Callable[[], object]:
        vision = Vision(scenes.THESIS_PAD, camera, VisionSection())
        return lambda: vision.process(Frame(0.0, 0, image))

    return least_ms(fresh)


def peer_ms(detect: Callable[[U8], object], image: U8) -> float:
    """Return the time of the peer's search of a full frame, ms."""
    return least_ms(lambda: lambda: detect(image))


def textures() -> Iterator[tuple[str, U8]]:
    """Yield names and pictures of the simulator's grounds, seen obliquely beside the pad."""
    for ground in ("grass", "asphalt", *GROUNDS):
        renderer = World({}, {"ground": ground}).renderer
        for height in HEIGHTS_M:
            pose = Pass(height, -60.0, 0.0).pose(0.0)
            yield f"{ground}, {height:.0f} m", renderer.render(0, pose, pose, FAR_PAD, None)


def print_textures(detect: Callable[[U8], object]) -> None:
    """Print times of searches where there is no pad, and their ratio to the peer's."""
    print(f"{'texture':>16} {'peer ms':>8} {'search ms':>10} {'ratio':>6}")
    ratios = []
    for name, image in textures():
        unit = timed_ms(partial(detect, image))
        runs = [searched(scenes.THESIS_PAD, image, TEXTURE_FRAMES)[0] for _ in range(REPEATS)]
        search = max(min(times) for times in zip(*runs, strict=True))
        ratios.append(search / unit)
        print(f"{name:>16} {unit:8.2f} {search:10.2f} {search / unit:6.2f}")
    print(f"median of the ratios {np.median(ratios):.2f}, most {max(ratios):.2f}")


def main() -> None:
    """Print the table."""
    detect = partial(peers.quick().squares, dictionary="APRILTAG_36h11")
    cv2.setNumThreads(1)
    small = scenes.THESIS_CAMERA
    large = small.scaled(1920, 1440)
    print(f"{'m':>5} {'peer ms':>8} {'track ms':>9} {'ratio':>6} {'search ms':>10} {'ratio':>6}")
    medians: list[tuple[float, float, float]] = []
    for distance in DISTANCES:
        frames = sequence(small, distance)
        unit = float(np.median([peer_ms(detect, image) for image, _ in frames]))
        track = float(np.median(tracking_ms(small, frames)))
        search = float(np.median([searching_ms(small, image) for image, _ in frames[:4]]))
        medians.append((unit, track, search))
        print(
            f"{distance:5.1f} {unit:8.2f} {track:9.2f} {track / unit:6.2f} "
            f"{search:10.2f} {search / unit:6.2f}"
        )
    unit, track, search = (float(np.median(column)) for column in zip(*medians, strict=True))
    print(
        f"{'all':>5} {unit:8.2f} {track:9.2f} {track / unit:6.2f} "
        f"{search:10.2f} {search / unit:6.2f}"
    )
    print("tracking at 1920x1440 over 640x480:")
    for distance in (2.0, 8.0):
        wide = float(np.median(tracking_ms(large, sequence(large, distance))))
        near = float(np.median(tracking_ms(small, sequence(small, distance))))
        print(f"{distance:5.1f} {wide:8.2f} ms {wide / near:6.2f}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory of this run, all images and the peer with it: {peak:.0f} MiB")
    print_textures(detect)


if __name__ == "__main__":
    main()
