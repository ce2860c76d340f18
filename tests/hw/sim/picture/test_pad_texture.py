"""The pad's print in the simulator, against the exact drawing of the vision tests."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from hw.sim.picture.pad_texture import BLACK, WHITE, pad_texture
from landerd.camera_model import CameraModel
from landerd.geometry import R_GIMBAL_CAMERA, matmul, rot_zyx
from landerd.pad import PadLayout, Plate, WhyCode
from tests.vision import scenes


@pytest.mark.parametrize(("bits", "number", "heading_deg"), [(6, 5, 0.0), (8, 23, 77.0)])
def test_a_whycode_is_drawn_as_the_exact_generator_draws_it(
    bits: int, number: int, heading_deg: float
) -> None:
    code = WhyCode(
        kind="whycode",
        outer_diameter_m=0.5,
        bits=bits,
        id=number,
        position_m=(0.05, -0.1),
        heading_deg=heading_deg,
    )
    plate = Plate(north_m=0.5, south_m=0.5, east_m=0.5, west_m=0.5)
    layout = PadLayout(name="code", markers=(code,), plate=plate)
    # Straight above with north up: a pixel is 2 mm of the pad.
    camera = CameraModel(400, 400, 5000.0, 5000.0, 199.5, 199.5)
    down = np.array(matmul(rot_zyx(0.0, -math.pi / 2, 0.0), R_GIMBAL_CAMERA)).T
    optics = replace(scenes.Optics(), white=WHITE, black=BLACK, noise=0.0, blur_px=0.3)
    exact = scenes.render(
        scenes.View((0.0, 0.0, 10.0), down), camera, optics, np.random.default_rng(0), layout
    )
    level = pad_texture(layout)[1]
    assert level.texel_m == pytest.approx(1 / 512)
    east, north = np.meshgrid(np.arange(400) - 199.5, 199.5 - np.arange(400))
    to_texels = level.from_pad()
    u = to_texels[0, 1] * east * 0.002 + to_texels[0, 2]
    v = to_texels[1, 0] * north * 0.002 + to_texels[1, 2]
    drawn = cv2.remap(level.grey, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
    middle = np.s_[5:-5, 5:-5]
    off = np.abs(exact[middle].astype(float) - drawn[middle].astype(float))
    assert off.max() < 0.5 * (WHITE - BLACK)  # edges within half a pixel everywhere,
    assert (off > 20).mean() < 0.02  # and alike beside them
