"""CPU time of one simulated picture against range, with everything switched on."""

import math
import time
from pathlib import Path

import cv2

from hw.sim.options import RenderOptions
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import load_camera
from landerd.geometry import IDENTITY, R_GIMBAL_CAMERA, matmul, rot_zyx
from landerd.pad import load_pad

CONFIG = Path(__file__).parent.parent / "config"
REPEATS = 60


def main() -> None:
    """Print milliseconds a frame at several ranges."""
    cv2.setNumThreads(1)
    camera = load_camera(CONFIG / "cameras/thesis.yaml")
    layout = load_pad(CONFIG / "pads/thesis.yaml")
    began = time.perf_counter()
    renderer = Renderer(layout, camera, RenderOptions(), seed=1)
    print(f"set-up {time.perf_counter() - began:.2f} s")
    pad = PadPose((0.0, 0.0, 0.0), IDENTITY)
    print("range_m  pitch_deg  motion_px  least_ms median_ms")
    for range_m in (30.0, 18.0, 10.0, 5.0, 3.0, 2.0, 1.0, 0.5, 0.3):
        for pitch_deg in (-30.0, -85.0):
            for motion_px in (0.0, 2.0):
                pitch = math.radians(pitch_deg)
                lens = (range_m * -math.cos(pitch), 0.0, range_m * math.sin(pitch))
                R = matmul(rot_zyx(0.0, pitch, 0.0), R_GIMBAL_CAMERA)
                shift = motion_px * range_m / camera.fx
                start = CameraPose(lens, R)
                end = CameraPose((lens[0], lens[1] + shift, lens[2]), R)
                body = (lens[0] - 0.10, lens[1], lens[2] - 0.04)
                vehicle = VehiclePose(body, IDENTITY, (0.44, 0.26), 0.20)
                times = []
                for i in range(REPEATS):
                    began = time.thread_time()
                    renderer.render(i, start, end, pad, vehicle)
                    times.append(1e3 * (time.thread_time() - began))
                times.sort()
                print(
                    f"{range_m:7.1f} {pitch_deg:10.0f} {motion_px:10.1f}"
                    f" {times[0]:9.2f} {times[REPEATS // 2]:9.2f}"
                )


if __name__ == "__main__":
    main()
