"""The sensor on made pictures: flat fields, grey ramps, edges."""

import math
import random
from typing import Any

import cv2
import numpy as np
import pytest

from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import RenderOptions
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.sensor import Sensor
from landerd.camera_model import CameraModel

CAMERA = CameraModel(320, 240, 300.0, 300.0, 159.5, 119.5)
U8 = np.uint8


def sensor(camera: dict[str, Any], **render: Any) -> Sensor:
    render = {"noise_sigma": 0.0, "gradient": 0.0} | render
    return Sensor(
        CAMERA, RenderOptions.model_validate(render), SimCameraOptions.model_validate(camera), 1
    )


def flat(level: int) -> np.ndarray:
    return np.full((240, 320), level, U8)


def ramp() -> np.ndarray:
    return np.tile(np.linspace(0, 255, 320).astype(U8), (240, 1))


@pytest.mark.parametrize("illumination", [0.3, 1.0, 2.6])
def test_the_ideal_sensor_is_light_plus_noise_to_the_bit(illumination: float) -> None:
    seed, frame = 5, 17
    render = RenderOptions(illumination=illumination, gradient=0.2, noise_sigma=4.0)
    seen = Sensor(CAMERA, render, SimCameraOptions(), seed).expose(ramp(), frame)

    rng = np.random.default_rng([seed, 2])
    bearing = rng.uniform(0.0, 2.0 * math.pi)
    across = np.add.outer(
        math.sin(bearing) * np.linspace(-1.0, 1.0, 240),
        math.cos(bearing) * np.linspace(-1.0, 1.0, 320),
    )
    noise = rng.standard_normal((240 + 256, 320 + 256), dtype=np.float32)
    offsets = random.Random(seed * 1_000_003 + frame)
    x, y = offsets.randrange(256), offsets.randrange(256)
    noise = np.clip(np.rint(4.0 * noise), -255, 255)[y : y + 240, x : x + 320].astype(int)
    light = (illumination * (1.0 + 0.2 * across)).astype(np.float32)
    lit = cv2.multiply(ramp(), light, dtype=cv2.CV_8U).astype(int)
    assert (
        seen == np.clip(np.clip(lit + np.maximum(noise, 0), 0, 255) + np.minimum(noise, 0), 0, 255)
    ).all()


@pytest.mark.parametrize("gain", [1.0, 4.0])
@pytest.mark.parametrize("level", [20, 60, 140])
def test_noise_grows_with_level_and_gain(level: int, gain: float) -> None:
    # A quarter of the light at four times the gain: the same grey, from fewer photons.
    s = sensor({"noise": {"shot": 0.08}, "exposure": "auto"}, noise_sigma=1.5)
    seen = s.expose(flat(level), 3, Exposure(0.008 / gain, gain)).astype(float)
    sigma = math.sqrt((1.5 * gain) ** 2 + 0.08 * gain * level)
    if level > 3 * sigma:
        assert seen.mean() == pytest.approx(level, abs=0.1)
        assert seen.std() == pytest.approx(sigma, rel=0.03)
    else:
        assert seen.min() == 0  # cut off at black, as a sensor does


def test_noise_is_that_of_the_light_before_the_tone_curve() -> None:
    s = sensor({"tone": {"curve": "gamma", "gamma": 2.2}}, noise_sigma=1.0)
    for level in (40, 120):
        slope = (level / 255) ** (1 / 2.2 - 1) / 2.2
        seen = s.expose(flat(level), 1)
        assert seen.std() == pytest.approx(math.hypot(slope, 1 / math.sqrt(12)), rel=0.05)


def test_noise_is_new_in_every_frame() -> None:
    s = sensor({"noise": {"shot": 0.1}}, noise_sigma=2.0)
    a, b = (s.expose(flat(100), i).astype(float) for i in (1, 2))
    assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.02
    assert (s.expose(flat(100), 1) == a).all()


def test_overexposed_light_is_clipped_and_loses_its_noise() -> None:
    for camera in ({}, {"noise": {"shot": 0.01}}):
        s = sensor(camera, illumination=2.5, noise_sigma=0.0)
        seen = s.expose(ramp(), 1)
        assert (seen == 255).mean() == pytest.approx(1 - 1 / 2.5, abs=0.02)
    s = sensor({"noise": {"shot": 0.01}}, illumination=2.5, noise_sigma=3.0)
    assert s.expose(flat(200), 1).min() == 255


def test_dim_light_keeps_its_steps() -> None:
    s = sensor({"tone": {"curve": "srgb"}}, illumination=0.15)
    seen = s.expose(ramp(), 1)[0].astype(int)
    steps = np.diff(seen)
    assert seen.max() > 100
    # Above the straight foot no step is larger than the curve's slope makes it.
    assert steps.min() >= 0
    assert steps[40:].max() <= 2


def test_black_level_lifts_and_vignetting_darkens_the_picture() -> None:
    s = sensor({"black_level": 12.0, "vignetting": 0.5, "tone": {"curve": "linear"}})
    assert (s.expose(flat(0), 1) == 12).all()
    seen = s.expose(flat(200), 1)
    middle, corner = seen[119, 159], seen[0, 0]
    assert middle == pytest.approx(12 + 243 / 255 * 200, abs=1)
    assert corner == pytest.approx(12 + 243 / 255 * 100, abs=1)


def test_a_halo_stands_a_third_of_the_step_either_side_of_an_edge() -> None:
    scene = flat(80)
    scene[:, 160:] = 140
    seen = sensor({"sharpening": 0.6}).expose(scene, 1)[100].astype(int)
    # Of the three by three that an unsharp mask is against one column lies beyond the edge.
    assert seen[158:162].tolist() == [80, 80 - 12, 140 + 12, 140]


def test_jpeg_is_the_last_step() -> None:
    scene = ramp()
    cv2.circle(scene, (160, 120), 60, (240.0,), -1, cv2.LINE_AA)
    plain = sensor({"sharpening": 1.0}).expose(scene.copy(), 1)
    packed = sensor({"sharpening": 1.0, "jpeg_quality": 50}).expose(scene.copy(), 1)
    _, data = cv2.imencode(".jpg", plain, [cv2.IMWRITE_JPEG_QUALITY, 50])
    true = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    assert true is not None
    assert np.abs(packed.astype(float) - true).mean() < 0.3
    assert np.abs(packed - plain.astype(float)).mean() > 0.3


def test_a_longer_exposure_is_brighter() -> None:
    s = sensor({"exposure": "auto"})
    assert s.expose(flat(50), 1, Exposure(0.016, 1.0)).mean() == pytest.approx(100, abs=0.5)
    assert s.expose(flat(50), 1, Exposure(0.008, 3.0)).mean() == pytest.approx(150, abs=0.5)
    assert s.expose(flat(50), 1).mean() == pytest.approx(50, abs=0.5)
