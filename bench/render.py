"""CPU time of one simulated picture by range: of the reference world, and of others relative to it.

All worlds draw the same views in turn, so that the ratios hold on a busy machine as well. `real
sensor` has all effects of `sim.camera`, `scene` all of `sim.render` and `sim.pad`, `both` has all
of them. Days are the worlds that the first seeds draw of the field scenario. The last table shows
each effect alone.
"""

import math
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from random import Random
from typing import Any

import cv2

from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.picture.shutter import POSE_PERIOD_S, Readout, Vibration
from hw.sim.snapshot import CameraPose, PadPose, Snapshot, VehiclePose
from landerd.camera_model import load_camera
from landerd.devices import sim_options
from landerd.drivers import read_configuration
from landerd.geometry import IDENTITY, R_GIMBAL_CAMERA, matmul, rot_zyx
from landerd.pad import load_pad

CONFIG = Path(__file__).parent.parent / "config"
REPEATS = 60  # pictures of each view, of which the fastest counts
DAYS = 12  # number of days of the field scenario
RANGES_M = (30.0, 18.0, 10.0, 5.0, 3.0, 2.0, 1.0, 0.5, 0.3)
PITCHES_DEG = (-30.0, -85.0)
EFFECTS: dict[str, dict[str, Any]] = {
    "tone curve": {"tone": {"curve": "gamma", "contrast": 0.5}, "black_level": 8.0},
    "shot noise": {"noise": {"shot": 0.1}},
    "auto exposure": {"exposure": "auto"},
    "vignetting": {"vignetting": 0.5},
    "dirt": {"lens_dirt": 0.5},
    "rolling shutter": {"readout_s": 0.02},
    "vibration": {"vibration": {"deg": 0.1, "hz": 90.0}},
    "sharpening": {"sharpening": 1.0},
    "JPEG": {"jpeg_quality": 85},
}
# Effects of the scene: keys of sim.render, and of sim.pad.
SCENE: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "ground": ({"ground": "meadow"}, {}),
    "look-alikes": ({"look_alikes": 6}, {}),
    "wet, glare": ({"wet": 0.3, "glare": 0.8}, {}),
    "leaf shade": ({"leaf_shade": 0.5}, {}),
    "shadow's edge": ({"shadow_edge": True, "shadow_softness_m": 0.05}, {}),
    "print": ({}, {"print_scale": 1.01, "marker_error_m": 0.005, "black": 0.25, "dirt": 0.1}),
    "folded plate": ({}, {"bend_deg": 4.0}),
}
GROUNDS = ("meadow", "gravel", "paving", "canopy", "roof", "car_park", "water")
PAD = PadPose((0.0, 0.0, 0.0), IDENTITY)


class World:
    """A renderer of one world, and what the camera would give to it."""

    def __init__(
        self,
        sensor: Mapping[str, Any] | SimCameraOptions,
        render: Mapping[str, Any] | RenderOptions | None = None,
        pad: Mapping[str, Any] | None = None,
    ) -> None:
        """Make the renderer.

        Args:
            sensor: options of `sim.camera`.
            render: options of `sim.render`; None: the defaults.
            pad: options of `sim.pad`; None: the defaults, at the origin.
        """
        layout = load_pad(CONFIG / "pads/thesis.yaml")
        camera = load_camera(CONFIG / "cameras/thesis.yaml")
        self.options = SimCameraOptions.model_validate(sensor)
        scene = RenderOptions.model_validate(render or {})
        at_origin = PadOptions.model_validate({"position_m": (0.0, 0.0), **(pad or {})})
        began = time.thread_time()
        self.renderer = Renderer(
            printed(layout, at_origin, 1), camera, scene, 1, self.options, at_origin
        )
        self.set_up_s = time.thread_time() - began
        vibration = self.options.vibration
        self.vibration = Vibration(vibration, Random(1)) if vibration.deg > 0.0 else None

    def time(self, frame: int, view: "View") -> float:
        """Draw a view and return the CPU time, ms."""
        o = self.options
        half = 0.5 * o.exposure_s
        began = time.thread_time()
        readout = None
        if o.readout_s > 0.0 or self.vibration is not None:
            steps = math.ceil(o.readout_s / POSE_PERIOD_S)
            times = [o.readout_s * (k / steps - 0.5) for k in range(steps + 1)] if steps else [0.0]
            shots = tuple(Snapshot(t, view.pose(t), PAD, view.vehicle) for t in times)
            readout = Readout(0.1 * frame, o.readout_s, o.exposure_s, shots, self.vibration)
        self.renderer.render(
            frame,
            view.pose(-half),
            view.pose(half),
            PAD,
            view.vehicle,
            Exposure(o.exposure_s),
            readout,
        )
        return 1e3 * (time.thread_time() - began)


class View:
    """A vehicle that passes the pad."""

    def __init__(self, range_m: float, pitch_deg: float, motion_px: float) -> None:
        """Take the slant range, the pitch of the camera, and the image's path in an exposure."""
        pitch = math.radians(pitch_deg)
        self.lens = (range_m * -math.cos(pitch), 0.0, range_m * math.sin(pitch))
        self.R = matmul(rot_zyx(0.0, pitch, 0.0), R_GIMBAL_CAMERA)
        focal = load_camera(CONFIG / "cameras/thesis.yaml").fx
        self.speed = motion_px * range_m / focal / SimCameraOptions().exposure_s
        body = (self.lens[0] - 0.10, self.lens[1], self.lens[2] - 0.04)
        self.vehicle = VehiclePose(body, IDENTITY, (0.44, 0.26), 0.20)

    def pose(self, t: float) -> CameraPose:
        """Return the camera's pose at a time t, s, from the middle of the exposure."""
        north, east, down = self.lens
        return CameraPose((north, east + self.speed * t, down), self.R)


def least(worlds: list[World], view: View) -> list[float]:
    """Return the least time of each world for a view, ms; the worlds draw it in turn."""
    times = [[w.time(i, view) for w in worlds] for i in range(REPEATS)]
    return [min(of_one) for of_one in zip(*times, strict=True)]


def day(seed: int) -> World:
    """Return the world that a seed draws of the field scenario."""
    overlays = [CONFIG / "scenarios/field.yaml"]
    loaded = read_configuration(CONFIG / "default.yaml", overlays=overlays, seed=seed)
    options = sim_options(loaded)
    pad = options.pad.model_dump() | {"position_m": (0.0, 0.0)}
    # The exposure time is that of the reference, so that motion blur costs the same.
    camera = options.camera.model_copy(update={"exposure_s": SimCameraOptions().exposure_s})
    return World(camera, options.render, pad)


def print_days(reference: World) -> None:
    """Print the times of days relative to the reference, over all ranges at one pitch."""
    worlds = [reference, *(day(seed) for seed in range(1, DAYS + 1))]
    rows = [least(worlds, View(range_m, -60.0, 2.0)) for range_m in RANGES_M[1:]]
    of_reference, *of_days = (sum(times) for times in zip(*rows, strict=True))
    days = [times / of_reference for times in of_days]
    print(f"a day of the field world, x: mean {sum(days) / DAYS:.2f}, most {max(days):.2f}")


def together(effects: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Return the options of several effects together."""
    block: dict[str, Any] = {}
    for options in effects:
        block |= options
    return block


def ratios(times: list[float]) -> str:
    """Return the text of the last three of four times, each over the first."""
    sensor, scene, field = (t / times[0] for t in times[1:])
    return f"{sensor:16.2f}{scene:8.2f}{field:8.2f}"


def main() -> None:
    """Print the tables."""
    cv2.setNumThreads(1)
    World({})  # the first world is slower than others
    reference = World({})
    sensor = together(EFFECTS.values())
    render, pad = (together(scene[i] for scene in SCENE.values()) for i in (0, 1))
    print(f"set-up {reference.set_up_s:.2f} s; with everything in the scene")
    for ground in GROUNDS:
        more_s = World({}, render | {"ground": ground}, pad).set_up_s - reference.set_up_s
        print(f"  {ground:9} {more_s:+.2f} s")
    others = [World(sensor), World({}, render, pad), World(sensor, render, pad)]
    print("range_m  pitch_deg  motion_px  reference_ms  x: real sensor   scene    both")
    sums = [0.0] * 4
    for range_m in RANGES_M:
        for pitch_deg in PITCHES_DEG:
            for motion_px in (0.0, 2.0):
                times = least([reference, *others], View(range_m, pitch_deg, motion_px))
                sums = [s + t for s, t in zip(sums, times, strict=True)]
                row = f"{range_m:7.1f} {pitch_deg:10.0f} {motion_px:10.1f} {times[0]:13.2f}"
                print(row + ratios(times))
    print(f"all {'':38}" + ratios(sums))
    print_days(reference)
    print("alone, ms more at    20 m    5 m    1 m")
    alone = [World({}), *(World(options) for options in EFFECTS.values())]
    alone += [World({}, *scene) for scene in SCENE.values()]
    rows = [least(alone, View(range_m, -60.0, 2.0)) for range_m in (20.0, 5.0, 1.0)]
    for name, *times in zip(("", *EFFECTS, *SCENE), *rows, strict=True):
        if name:
            more = [t - row[0] for t, row in zip(times, rows, strict=True)]
            print(f"{name:18}" + "".join(f"{ms:7.2f}" for ms in more))


if __name__ == "__main__":
    main()
