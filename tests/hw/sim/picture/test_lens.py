"""The lens: light lost in the corners and under dirt, and what calibration did not find."""

from pathlib import Path

import numpy as np
import pytest

from hw.sim.camera_options import CalibrationErrorOptions
from hw.sim.picture.lens import dirt, true_camera, vignetting
from landerd.camera_model import CameraModel, load_camera

CAMERA = load_camera(Path(__file__).parents[4] / "config/cameras/thesis.yaml")
POINT = np.array([[0.4, -0.3, 1.0]])


def seen(**error: object) -> tuple[float, float]:
    true = true_camera(CAMERA, CalibrationErrorOptions.model_validate(error))
    x, y = true.pixels(POINT)[0].tolist()
    return x, y


def test_a_point_moves_as_the_calibration_is_wrong() -> None:
    x, y = CAMERA.pixels(POINT)[0]
    assert seen() == pytest.approx((x, y))
    assert seen(principal_px=(3.0, -2.0)) == pytest.approx((x + 3.0, y - 2.0))
    further = 1.005
    assert seen(focal=0.005) == pytest.approx(
        (CAMERA.cx + further * (x - CAMERA.cx), CAMERA.cy + further * (y - CAMERA.cy))
    )
    # Without distortion the same point lies where the pinhole has it; half way at half of it.
    pinhole = (CAMERA.cx + 0.4 * CAMERA.fx, CAMERA.cy - 0.3 * CAMERA.fy)
    assert seen(distortion=-1.0) == pytest.approx(pinhole)
    halfway = (np.array((x, y)) + pinhole) / 2
    assert seen(distortion=-0.5) == pytest.approx(halfway)


def test_the_true_camera_is_never_the_believed_one() -> None:
    assert true_camera(CAMERA, CalibrationErrorOptions()) == CAMERA
    assert true_camera(CAMERA, CalibrationErrorOptions()) is not CAMERA


def test_vignetting_follows_the_fourth_power_of_the_cosine() -> None:
    camera = CameraModel(101, 81, 80.0, 80.0, 50.0, 40.0)
    light = vignetting(camera, 0.6)
    assert light[40, 50] == 1.0
    assert light[[0, 0, -1, -1], [0, -1, 0, -1]] == pytest.approx(0.4, abs=1e-6)
    # cos(a)^4 with tan(a) = r / f, f of the corner's: 0.4 = 1 / (1 + t)^2.
    t = 0.4**-0.5 - 1.0
    halfway = 1.0 / (1.0 + t / 4) ** 2
    assert light[20, 25] == pytest.approx(halfway, abs=1e-6)


def test_dirt_keeps_off_its_share_in_soft_spots() -> None:
    passed = dirt(640, 480, 0.6, np.random.default_rng(4))
    assert passed.min() == pytest.approx(0.4, abs=0.01)
    assert passed.max() == 1.0
    assert 0.05 < (passed < 0.97).mean() < 0.7
    steps = np.abs(np.diff(passed, axis=1)).max()
    assert steps < 0.6 / (0.02 * 640)  # no sharper than the smallest spot's edge
    assert (passed != dirt(640, 480, 0.6, np.random.default_rng(5))).any()
