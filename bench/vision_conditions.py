"""Vision under ordinary cameras and light: detection rate, errors, stated sigmas and time.

    python -m bench.vision_conditions --images 200         # the table
    python -m bench.vision_conditions --only gamma,glare   # some lines
    python -m bench.vision_conditions --of whycode         # of 1 m alone, or a tag of 0.6 m
    python -m bench.vision_conditions --keep FOLDER        # made once, then read from there

Pictures show the thesis's pad from 2 to 15 m at 0 to 45 degrees, with nothing known beforehand.
Those of lines marked * are made by the tests' own renderer (area integration, exact pose), the
others by the simulator's. A pad counts as found if its centre is within a tenth of the range. For
comparison there are, for the tag, OpenCV and, if installed, the AprilTag 3 library (the tag's
centre within a tenth of the range), and for the ring, any --whycon PROGRAM (see bench/peers.py; its
centre within a tenth of the range across the line of sight).
"""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench import peers
from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.picture.shutter import POSE_PERIOD_S, Readout
from hw.sim.snapshot import CameraPose, PadPose, Snapshot, VehiclePose
from landerd.config.models import VisionSection
from landerd.geometry import IDENTITY
from landerd.messages import Frame, PoseSolution
from landerd.pad import PadLayout, Ring, Square, WhyCode
from landerd.vision import Vision
from tests.vision import scenes

U8 = NDArray[np.uint8]
F64 = NDArray[np.float64]

# Print and lens are exact here, and are stated to be: otherwise their allowances would hide a wrong
# sigma.
CAMERA = scenes.THESIS_CAMERA
_EXACT = {"print_scale_sigma": 0.0, "placement_sigma_m": 0.0, "flatness_deg": 0.0}
PAD = scenes.THESIS_PAD.model_copy(update=_EXACT)
RING = PAD.rings[0]
RING_PAD = PAD.model_copy(update={"name": "ring", "markers": (RING,)})
OPTIONS = VisionSection(focal_sigma=0.0, readout_s=0.0)


@dataclass(frozen=True)
class Target:
    """A pad, and the distances from which pictures of it are made."""

    pad: PadLayout
    distances: tuple[float, ...]  # m, used in turn

    @property
    def outlined(self) -> Ring | WhyCode:
        """The marker that must be wholly in the image; for a square, a ring round it."""
        if self.pad.rings:
            return self.pad.rings[0]
        if self.pad.whycodes:
            return self.pad.whycodes[0]
        return Ring(kind="whycon", outer_diameter_m=1.5 * self.pad.squares[0].size_m)


def _alone(marker: WhyCode | Square) -> PadLayout:
    """Return a pad with this marker only."""
    return PAD.model_copy(update={"name": "alone", "markers": (marker,)})


_TAG = PAD.squares[0].model_copy(update={"size_m": 0.6, "position_m": (0.0, 0.0)})
_CODE = WhyCode(kind="whycode", outer_diameter_m=1.0, bits=6, id=5)
TARGETS = {
    "thesis": Target(PAD, (2.0, 4.0, 7.0, 10.0, 15.0)),
    "tag": Target(_alone(_TAG), (1.0, 2.0, 4.0, 7.0, 10.0)),
    "whycode": Target(_alone(_CODE), (2.0, 4.0, 7.0, 10.0, 15.0)),
}
MAX_ANGLE_DEG = 45.0
CHI2_95 = 7.815  # 95 % quantile of chi-square with three degrees of freedom
FOUND_SHARE = 0.1  # largest error of the centre of a pad that counts as found, over the range
READOUT_S, SKEW_PX = 0.02, 5.0  # readout of a rolling shutter, and motion of the image meanwhile
ROLLING_OPTIONS = OPTIONS.model_copy(update={"readout_s": READOUT_S})
_AT_ORIGIN = PadPose((0.0, 0.0, 0.0), IDENTITY)
_NO_VEHICLE = VehiclePose((0.0, 0.0, -100.0), IDENTITY, (0.4, 0.3), 0.2)


Maker = Callable[[scenes.View, Target, np.random.Generator], U8]


@dataclass(frozen=True)
class Shot:
    """One picture, and the true pose of the pad."""

    image: U8
    view: scenes.View


# ---- the exact renderer ------------------------------------------------------------------------


@dataclass(frozen=True)
class Sensor:
    """A sensor that turns light (1: white paper) into grey levels."""

    white: float = 0.75  # share of full scale that white paper gives, before the tone curve
    gamma: float = 1.0
    noise: float = 3.0  # standard deviation, grey levels
    jpeg: int | None = None  # quality; None: not compressed


def exposed(light: F64, sensor: Sensor, rng: np.random.Generator) -> U8:
    """Return the picture that a sensor makes of light (height, width)."""
    level = 255.0 * np.clip(light * sensor.white, 0.0, 1.0) ** (1.0 / sensor.gamma)
    noisy = level + rng.normal(0.0, sensor.noise, level.shape)
    image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    if sensor.jpeg is not None:
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg])[1]
        image = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return image


def exact(
    sensor: Sensor, alter: Callable[[scenes.Optics, F64, np.random.Generator], scenes.Optics]
) -> Maker:
    """Return a maker of pictures by the tests' renderer, through altered optics, on a sensor."""

    def make(view: scenes.View, target: Target, rng: np.random.Generator) -> U8:
        optics = scenes.random_optics(rng)
        white = 220.0
        optics = replace(optics, white=white, black=optics.black / optics.white * white, noise=0.0)
        optics = alter(optics, scenes.outline(view, CAMERA, target.outlined), rng)
        light = scenes.render(view, CAMERA, optics, rng, target.pad).astype(np.float64) / white
        return exposed(light, sensor, rng)

    return make


def plainly(optics: scenes.Optics, _edge: F64, _rng: np.random.Generator) -> scenes.Optics:
    """Leave the optics as they are."""
    return optics


def moving(share: float) -> Callable[[scenes.Optics, F64, np.random.Generator], scenes.Optics]:
    """Return a change that adds motion by a share of the ring's diameter, at most 15 px."""

    def alter(optics: scenes.Optics, edge: F64, rng: np.random.Generator) -> scenes.Optics:
        size = float(np.ptp(edge, axis=0).max())
        px, a = min(share * size, 15.0), rng.uniform(0.0, 2.0 * math.pi)
        return replace(optics, motion_px=(px * math.cos(a), px * math.sin(a)))

    return alter


def with_leg(optics: scenes.Optics, edge: F64, rng: np.random.Generator) -> scenes.Optics:
    """Lay a bar over a tenth of the ring."""
    size = float(np.ptp(edge, axis=0).max())
    centre, a = edge.mean(axis=0), rng.uniform(0.0, 2.0 * math.pi)
    off = rng.uniform(-0.4, 0.4) * size
    point = (centre[0] - off * math.sin(a), centre[1] + off * math.cos(a))
    width = 0.1 * math.pi / 4.0 * size  # a tenth of the disc for a bar through its middle
    bar = scenes.Bar(point, (math.cos(a), math.sin(a)), width, rng.uniform(20.0, 120.0))
    return replace(optics, bar=bar)


# ---- the simulator's renderer ------------------------------------------------------------------


def simulated(camera: dict[str, Any], render: dict[str, Any], pad: dict[str, Any]) -> Maker:
    """Return a maker of the simulator's pictures by options of sim.camera, sim.render, sim.pad."""
    options = SimCameraOptions.model_validate(camera)
    worlds: dict[tuple[int, Target], Renderer] = {}

    def make(view: scenes.View, target: Target, rng: np.random.Generator) -> U8:
        seed = int(rng.integers(8))
        if (seed, target) not in worlds:
            scene = RenderOptions.model_validate(
                {"vehicle_shadow": False, "legs": False, "illumination": 0.95}
                | render
                | (
                    {
                        "shadow_edge_m": float(rng.uniform(-0.35, 0.35)),
                        "shadow_edge_heading_deg": float(rng.uniform(0, 360)),
                    }
                    if render.get("shadow_edge")
                    else {}
                )
            )
            at = PadOptions.model_validate({"position_m": (0.0, 0.0), **pad})
            print_ = printed(target.pad, at, seed)
            worlds[seed, target] = Renderer(print_, CAMERA, scene, seed, options, at)
        R = view.R_camera_pad.T
        middle = -R @ np.array(view.position)
        # During the readout the camera moves along its x axis, and so the image along its rows, by
        # SKEW_PX.
        across = R[:, 0] * (SKEW_PX * view.position[2] / CAMERA.fx)
        still = _pose(middle, R)
        readout = None
        if options.readout_s > 0.0:
            steps = math.ceil(options.readout_s / POSE_PERIOD_S)
            times = [options.readout_s * (k / steps - 0.5) for k in range(steps + 1)]
            shots = tuple(
                Snapshot(
                    t, _pose(middle + across * t / options.readout_s, R), _AT_ORIGIN, _NO_VEHICLE
                )
                for t in times
            )
            readout = Readout(0.0, options.readout_s, options.exposure_s, shots, None)
        frame = int(rng.integers(1000))
        return worlds[seed, target].render(frame, still, still, _AT_ORIGIN, None, None, readout)

    return make


def _pose(position: F64, R: F64) -> CameraPose:
    """Return a pose from arrays (3,) and (3, 3)."""
    x, y, z = position.tolist()
    a, b, c = R.tolist()
    return CameraPose((x, y, z), (tuple(a), tuple(b), tuple(c)))


ROLLING = "rolling shutter"
_SUN = {"sun_elevation_deg": 50.0}
CONDITIONS: dict[str, Maker] = {
    "plain*": exact(Sensor(), plainly),
    "plain": simulated({}, {}, {}),
    "gamma 2.2, JPEG*": exact(Sensor(0.85, 2.2, 3.0, 85), plainly),
    "gamma 2.2, JPEG": simulated(
        {"tone": {"curve": "gamma"}, "jpeg_quality": 85}, {"illumination": 1.08}, {}
    ),
    "S-curve, sharpened": simulated(
        {"tone": {"curve": "srgb", "contrast": 0.6}, "sharpening": 1.0}, {}, {}
    ),
    "white x1.6*": exact(Sensor(1.6), plainly),
    "white x2.5*": exact(Sensor(2.5), plainly),
    "white x2.5": simulated({}, {"illumination": 3.1}, {}),
    "dim 15 %*": exact(Sensor(0.15), plainly),
    "noise 8*": exact(Sensor(noise=8.0), plainly),
    "noise 15*": exact(Sensor(noise=15.0), plainly),
    ROLLING: simulated({"readout_s": READOUT_S}, {}, {}),
    "glare": simulated({}, {"glare": 0.8}, {}),
    "soft shadow": simulated(
        {}, {"shadow_edge": True, "shadow_softness_m": 0.1, "shadow_darkness": 0.8} | _SUN, {}
    ),
    "hard shadow": simulated(
        {}, {"shadow_edge": True, "shadow_softness_m": 0.005, "shadow_darkness": 0.8} | _SUN, {}
    ),
    "leaf shade 0.5": simulated({}, {"leaf_shade": 0.5} | _SUN, {}),
    "leg 10 %*": exact(Sensor(), with_leg),
    "dirt 12 %": simulated({}, {}, {"dirt": 0.12}),
    "motion 0.25*": exact(Sensor(), moving(0.25)),
    "motion 0.4*": exact(Sensor(), moving(0.4)),
}


def shots(name: str, of: str, images: int, seed: int, keep: Path | None) -> list[Shot]:
    """Return the pictures of a line, made now or read from a folder.

    Args:
        name: of the line.
        of: name of the target.
        images: number of pictures.
        seed: of all that is random.
        keep: folder in which pictures are kept; None: they are not.
    """
    target = TARGETS[of]
    file = None if keep is None else keep / f"{of}-{name.replace(' ', '_')}-{images}.npz"
    if file is not None and file.is_file():
        kept = np.load(file)
        return [
            Shot(i, scenes.View((t[0], t[1], t[2]), R))
            for i, t, R in zip(kept["images"], kept["t"].tolist(), kept["R"], strict=True)
        ]
    made: list[Shot] = []
    for k in range(images):
        rng = np.random.default_rng([seed, k])
        distance = target.distances[k % len(target.distances)]
        view = None
        while view is None:
            tilt = math.radians(rng.uniform(0.0, MAX_ANGLE_DEG))
            view = scenes.random_view(rng, CAMERA, distance, tilt, target.outlined)
        image = CONDITIONS[name](view, target, rng)
        if name == ROLLING:
            # The truth is the pad's position while the row of its centre is exposed.
            row = (CAMERA.pixels(np.array([view.position]))[0, 1] - 239.5) / CAMERA.height
            x, y, z = view.position
            view = scenes.View((x - row * SKEW_PX * z / CAMERA.fx, y, z), view.R_camera_pad)
        made.append(Shot(image, view))
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(
            file,
            images=np.stack([s.image for s in made]),
            t=np.array([s.view.position for s in made]),
            R=np.stack([s.view.R_camera_pad for s in made]),
        )
    return made


# ---- counting ----------------------------------------------------------------------------------


@dataclass
class Line:
    """What was found in the pictures of a line."""

    images: int = 0
    found: int = 0
    false: int = 0  # pictures in which something else was taken for the pad
    inside: int = 0  # errors within the stated 95 % region
    stages: dict[str, int] = field(default_factory=dict)  # number found by each stage
    missed: dict[int, int] = field(default_factory=dict)  # number not found, by range, m
    errors: list[float] = field(default_factory=list)  # of the centre, over the range
    ms: list[float] = field(default_factory=list)  # times of searches

    def add(
        self, poses: tuple[PoseSolution, ...], stage: str, view: scenes.View, ms: float
    ) -> None:
        """Count one picture.

        Args:
            poses: of what was taken for the pad, best first; empty: nothing was.
            stage: that found it.
            view: the truth.
            ms: time of the search.
        """
        self.images += 1
        self.ms.append(ms)
        truth = np.array(view.position)
        reach = float(np.linalg.norm(truth))
        error = np.array(poses[0].position) - truth if poses else None
        if error is None or float(np.linalg.norm(error)) > FOUND_SHARE * reach:
            self.false += error is not None
            at = round(reach)
            self.missed[at] = self.missed.get(at, 0) + 1
            return
        self.found += 1
        self.errors.append(float(np.linalg.norm(error)) / reach)
        self.stages[stage] = self.stages.get(stage, 0) + 1
        square = error @ np.linalg.solve(np.array(poses[0].covariance), error)
        self.inside += int(square < CHI2_95)

    def text(self) -> str:
        """Return the columns."""
        e = 1e3 * np.array(self.errors or [math.nan])
        return (
            f"{100.0 * self.found / self.images:6.1f} {self.false:3d}"
            f" {100.0 * self.inside / max(self.found, 1):6.1f} {np.median(e):7.3f}"
            f" {np.percentile(e, 95):7.2f} {np.median(self.ms):6.1f} {max(self.ms):6.1f}"
        )


def looked(layout: PadLayout, made: list[Shot], options: VisionSection) -> Line:
    """Search each picture for a pad with nothing known; return what was found."""
    line = Line()
    for shot in made:
        vision = Vision(layout, CAMERA, options)
        began = time.perf_counter()
        seen = vision.search_still(Frame(0.0, 0, shot.image))
        ms = (time.perf_counter() - began) * 1e3
        stage = getattr(seen.markers[0], "stage", None) if seen.markers else None
        line.add(seen.pad, stage or "-", shot.view, ms)
    return line


def beside(made: list[Shot], target: Target, whycon: Path | None) -> str:
    """Return the text of the percentages of pictures in which other detectors find their marker."""
    counts: dict[str, int] = {}
    for tag in target.pad.squares:
        for name, squares in peers.of_squares().items():
            found = [(squares(s.image, tag.dictionary), s.view) for s in made]
            counts[name] = sum(peers.is_tag(f or [], tag, view, CAMERA) for f, view in found)
    if whycon is not None:
        for ring in target.pad.rings:
            middles = [peers.rings(whycon, s.image, ring.inner_ratio, 1) for s in made]
            pairs = zip(middles, made, strict=True)
            counts["WhyCon"] = sum(peers.is_ring(found, s.view, CAMERA) for found, s in pairs)
    return ", ".join(f"{name} {100.0 * n / len(made):.1f}" for name, n in counts.items())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--images", type=int, default=20, help="pictures a line")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="lines whose names hold one of these")
    parser.add_argument("--keep", type=Path, help="folder in which pictures are kept")
    parser.add_argument("--pad", action="store_true", help="the whole pad besides its ring alone")
    parser.add_argument("--whycon", type=Path, metavar="PROGRAM", help="a detector of rings")
    parser.add_argument("--of", choices=TARGETS, default="thesis", help="what is looked at")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    layout = RING_PAD if args.of == "thesis" else TARGETS[args.of].pad
    columns = "found % bad  in 95 % med o/oo    p95     ms    max"
    print(f"{'':20} {layout.name:>5}: {columns}")
    for name in CONDITIONS:
        if not any(part in name for part in args.only.split(",")):
            continue
        made = shots(name, args.of, args.images, args.seed, args.keep)
        options = ROLLING_OPTIONS if name == ROLLING else OPTIONS
        line = looked(layout, made, options)
        print(f"{name:20} {line.text()}  {line.stages} missed {line.missed}", flush=True)
        if args.pad:
            print(f"{'  any marker':20} {looked(PAD, made, options).text()}", flush=True)
        print(f"{'  others':20} {beside(made, TARGETS[args.of], args.whycon)}", flush=True)


if __name__ == "__main__":
    main()
