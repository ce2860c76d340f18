"""CPU time of one simulated picture against range: of the ideal sensor, and of a real one.

Both sensors draw the same views in turn, so that the last columns hold on a busy machine too. The
real one has everything that `sim.camera` can switch on; the second table has each alone.
"""

import math
import time
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

import cv2

from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import RenderOptions
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.renderer import Renderer
from hw.sim.picture.shutter import POSE_PERIOD_S, Readout, Vibration
from hw.sim.snapshot import CameraPose, PadPose, Snapshot, VehiclePose
from landerd.camera_model import load_camera
from landerd.geometry import IDENTITY, R_GIMBAL_CAMERA, matmul, rot_zyx
from landerd.pad import load_pad

CONFIG = Path(__file__).parent.parent / "config"
REPEATS = 60
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
PAD = PadPose((0.0, 0.0, 0.0), IDENTITY)


class Sensor:
    """A renderer with one sensor, and what it would be handed by the camera."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        layout = load_pad(CONFIG / "pads/thesis.yaml")
        camera = load_camera(CONFIG / "cameras/thesis.yaml")
        self.options = SimCameraOptions.model_validate(options)
        self.renderer = Renderer(layout, camera, RenderOptions(), 1, self.options)
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
        """Take the slant range, where the camera looks, and the motion during an exposure."""
        pitch = math.radians(pitch_deg)
        self.lens = (range_m * -math.cos(pitch), 0.0, range_m * math.sin(pitch))
        self.R = matmul(rot_zyx(0.0, pitch, 0.0), R_GIMBAL_CAMERA)
        focal = load_camera(CONFIG / "cameras/thesis.yaml").fx
        self.speed = motion_px * range_m / focal / SimCameraOptions().exposure_s
        body = (self.lens[0] - 0.10, self.lens[1], self.lens[2] - 0.04)
        self.vehicle = VehiclePose(body, IDENTITY, (0.44, 0.26), 0.20)

    def pose(self, t: float) -> CameraPose:
        """Return the camera's pose at t, s."""
        north, east, down = self.lens
        return CameraPose((north, east + self.speed * t, down), self.R)


def least(sensors: list[Sensor], view: View) -> list[float]:
    """Return the least time of each sensor, in turn, ms."""
    times = [[s.time(i, view) for s in sensors] for i in range(REPEATS)]
    return [min(of_one) for of_one in zip(*times, strict=True)]


def main() -> None:
    """Print milliseconds a frame at several ranges."""
    cv2.setNumThreads(1)
    began = time.perf_counter()
    ideal = Sensor({})
    print(f"set-up {time.perf_counter() - began:.2f} s")
    together: dict[str, Any] = {}
    for options in EFFECTS.values():
        together |= options
    real = Sensor(together)
    print("range_m  pitch_deg  motion_px  ideal_ms  real_ms  ratio")
    sums = [0.0, 0.0]
    for range_m in RANGES_M:
        for pitch_deg in PITCHES_DEG:
            for motion_px in (0.0, 2.0):
                a, b = least([ideal, real], View(range_m, pitch_deg, motion_px))
                sums = [sums[0] + a, sums[1] + b]
                row = f"{range_m:7.1f} {pitch_deg:10.0f} {motion_px:10.1f}"
                print(f"{row} {a:9.2f} {b:8.2f} {b / a:6.2f}")
    print(f"all {sums[1] / sums[0]:58.2f}")
    print("alone, ms more at    20 m    5 m    1 m")
    sensors = [Sensor(options) for options in ({}, *EFFECTS.values())]
    rows = [least(sensors, View(range_m, -60.0, 2.0)) for range_m in (20.0, 5.0, 1.0)]
    for name, *times in zip(("", *EFFECTS), *rows, strict=True):
        if name:
            more = [t - row[0] for t, row in zip(times, rows, strict=True)]
            print(f"{name:18}" + "".join(f"{ms:7.2f}" for ms in more))


if __name__ == "__main__":
    main()
