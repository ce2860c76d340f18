"""CPU time of one simulated picture against range: the reference world's, and the field's scene."""

import math
import time
from pathlib import Path

import cv2

from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import CameraModel, load_camera
from landerd.geometry import IDENTITY, R_GIMBAL_CAMERA, matmul, rot_zyx
from landerd.pad import load_pad

CONFIG = Path(__file__).parent.parent / "config"
REPEATS = 60
RANGES_M = (30.0, 18.0, 10.0, 5.0, 3.0, 2.0, 1.0, 0.5, 0.3)
GROUNDS = ("meadow", "gravel", "paving", "canopy", "roof", "car_park", "water")
PRINT = PadOptions(
    position_m=(0.0, 0.0),
    print_scale=1.01,
    marker_error_m=0.005,
    bend_deg=4.0,
    black=0.25,
    dirt=0.1,
)
SCENE = RenderOptions(
    ground="meadow",
    look_alikes=6,
    wet=0.3,
    leaf_shade=0.5,
    glare=0.8,
    shadow_edge=True,
    shadow_softness_m=0.05,
)


def main() -> None:
    """Print milliseconds a picture at several ranges, and how many times the reference's."""
    cv2.setNumThreads(1)
    camera = load_camera(CONFIG / "cameras/thesis.yaml")
    layout = load_pad(CONFIG / "pads/thesis.yaml")
    Renderer(layout, camera, RenderOptions(), seed=1)  # what is slow only once
    began = time.thread_time()
    reference = Renderer(layout, camera, RenderOptions(), seed=1)
    plain_s = time.thread_time() - began
    print(f"set-up of the reference {plain_s:.2f} s")
    for ground in GROUNDS:
        began = time.thread_time()
        render = SCENE.model_copy(update={"ground": ground})
        renderer = Renderer(printed(layout, PRINT, 1), camera, render, seed=1, pad=PRINT)
        more_s = time.thread_time() - began - plain_s
        if ground == SCENE.ground:
            scene = renderer
        print(f"set-up of {ground:8} with everything: {more_s:+.2f} s")
    print("range_m  pitch_deg  motion_px  reference: least, median  scene: least, median  ratio")
    ratios = []
    for range_m in RANGES_M:
        for pitch_deg in (-30.0, -85.0):
            for motion_px in (0.0, 2.0):
                one, other = times([reference, scene], camera, range_m, pitch_deg, motion_px)
                ratios.append(other[0] / one[0])
                print(
                    f"{range_m:7.1f} {pitch_deg:10.0f} {motion_px:10.1f}"
                    f" {one[0]:17.2f} {one[REPEATS // 2]:8.2f}"
                    f" {other[0]:13.2f} {other[REPEATS // 2]:8.2f} {ratios[-1]:6.2f}"
                )
    print(f"ratio: mean {sum(ratios) / len(ratios):.2f}, worst {max(ratios):.2f}")


def times(
    renderers: list[Renderer],
    camera: CameraModel,
    range_m: float,
    pitch_deg: float,
    motion_px: float,
) -> list[list[float]]:
    """Return the sorted milliseconds that each takes for the same pictures, drawn in turn."""
    pad = PadPose((0.0, 0.0, 0.0), IDENTITY)
    pitch = math.radians(pitch_deg)
    lens = (range_m * -math.cos(pitch), 0.0, range_m * math.sin(pitch))
    R = matmul(rot_zyx(0.0, pitch, 0.0), R_GIMBAL_CAMERA)
    shift = motion_px * range_m / camera.fx
    start = CameraPose(lens, R)
    end = CameraPose((lens[0], lens[1] + shift, lens[2]), R)
    body = (lens[0] - 0.10, lens[1], lens[2] - 0.04)
    vehicle = VehiclePose(body, IDENTITY, (0.44, 0.26), 0.20)
    taken: list[list[float]] = [[] for _ in renderers]
    for i in range(REPEATS):
        for renderer, each in zip(renderers, taken, strict=True):
            began = time.thread_time()
            renderer.render(i, start, end, pad, vehicle)
            each.append(1e3 * (time.thread_time() - began))
    return [sorted(each) for each in taken]


if __name__ == "__main__":
    main()
