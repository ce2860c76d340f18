"""What the tests of the scene look at: a small camera over the thesis's pad, and its pictures."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, PadPose
from landerd.camera_model import CameraModel
from landerd.geometry import (
    IDENTITY,
    R_GIMBAL_CAMERA,
    Vec3,
    matmul,
    rot_zyx,
    rotate,
    sub,
    transpose,
)
from landerd.pad import PadLayout, Ring, load_pad

U8 = NDArray[np.uint8]
F64 = NDArray[np.float64]

CAMERA = CameraModel(320, 240, 300.0, 300.0, 159.5, 119.5)
PAD = load_pad(Path(__file__).parents[4] / "config/pads/thesis.yaml")
DOT = Ring(kind="whycon", outer_diameter_m=0.01, inner_ratio=0.4)
BLANK = PadLayout(name="blank", markers=(DOT,), plate=PAD.plate)  # as good as a white plate
AT_ORIGIN = PadPose((0.0, 0.0, 0.0), IDENTITY)


def down(height_m: float, north: float = 0.0, east: float = 0.0) -> CameraPose:
    """Return the pose of a camera that looks straight down, its top to the north."""
    return looking((north, east, -height_m), -90.0)


def looking(lens: Vec3, pitch_deg: float) -> CameraPose:
    """Return the pose of a camera that looks north, and down."""
    return CameraPose(lens, matmul(rot_zyx(0.0, math.radians(pitch_deg), 0.0), R_GIMBAL_CAMERA))


def render_options(**changes: Any) -> RenderOptions:
    """Return a scene in even light without noise, blur, shadows or legs but for the changes."""
    plain: dict[str, Any] = {
        "noise_sigma": 0.0, "defocus_px": 0.0, "gradient": 0.0, "ground": "plain",
        "vehicle_shadow": False, "legs": False,
    }  # fmt: skip
    return RenderOptions.model_validate(plain | changes)


def pad_options(**changes: Any) -> PadOptions:
    """Return a new pad at the origin but for the changes."""
    return PadOptions.model_validate({"position_m": (0.0, 0.0)} | changes)


def picture(
    pose: CameraPose,
    render: dict[str, Any] | None = None,
    pad: dict[str, Any] | None = None,
    *,
    layout: PadLayout = PAD,
    at: PadPose = AT_ORIGIN,
    seed: int = 1,
) -> U8:
    """Return the picture of a pad as it was printed and used."""
    options = pad_options(**(pad or {}))
    as_printed = printed(layout, options, seed)
    scene = render_options(**(render or {}))
    return Renderer(as_printed, CAMERA, scene, seed, pad=options).render(0, pose, pose, at, None)


def projected(pose: CameraPose, *points: Vec3) -> F64:
    """Return the pixels (n, 2) of points in the local frame."""
    R = transpose(pose.R_local_camera)
    return CAMERA.pixels(np.array([rotate(R, sub(p, pose.position)) for p in points]))
