"""Calibration of gimbals from views of a pad: figures from good views, reasons for poor ones."""

import math
import random
from dataclasses import replace

import pytest

from landerd.calibration.gimbal import calibrate
from landerd.calibration.gimbal_fit import View, turn_between
from landerd.calibration.gimbal_motion import Measured
from landerd.geometry import (
    R_GIMBAL_CAMERA,
    Mat3,
    Vec3,
    diagonal,
    matmul,
    norm,
    rot_zxy,
    rot_zyx,
    rotate,
    sub,
    transpose,
)
from landerd.messages import PoseSolution

DEGREE = math.pi / 180.0
PAD: Vec3 = (2.0, 0.0, 1.2)  # in the base frame
DOWN: Vec3 = (0.0, 0.0, 1.0)
CAMERA = rot_zyx(2.0 * DEGREE, 0.0, 3.0 * DEGREE)  # how it sits turned


def pad_seen(R_base_camera: Mat3, place: Vec3, rng: random.Random) -> PoseSolution:
    R = transpose(R_base_camera)
    x, y, z = rotate(R, place)
    noisy = (x + rng.gauss(0.0, 1e-3), y + rng.gauss(0.0, 1e-3), z + rng.gauss(0.0, 5e-3))
    variance = diagonal(1e-6, 1e-6, 25e-6)
    north = rotate(R, (1.0, 0.0, 0.0))
    return PoseSolution(noisy, rotate(R, DOWN), north, variance, 0.002, 0.004, 0.0)


def measured(
    *,
    yaw_sign: int = 1,
    yaw_zero_deg: float = 0.0,
    pitch_zero_deg: float = 0.0,
    scale: float = 1.0,
    across_deg: float = 20.0,
    down_deg: float = 15.0,
    pad_moves_m: float = 0.0,
) -> Measured:
    """Views on a grid around the pad; signs as they were found."""
    rng = random.Random(1)
    out = Measured(signs={"yaw": yaw_sign, "pitch": 1})
    for i in range(5):
        for j in range(5):
            yaw, pitch = (0.5 * i - 1.0) * across_deg, -30.0 + (0.5 * j - 1.0) * down_deg
            true_yaw = scale * yaw_sign * yaw + yaw_zero_deg
            true_pitch = pitch + pitch_zero_deg
            R = matmul(rot_zxy(true_yaw * DEGREE, 0.0, true_pitch * DEGREE), CAMERA)
            place = (PAD[0], pad_moves_m * ((i + j) % 2), PAD[2])
            pad = pad_seen(matmul(R, R_GIMBAL_CAMERA), place, rng)
            out.views.append(View(0, yaw * DEGREE, pitch * DEGREE, 0.0, pad, DOWN))
    return out


@pytest.mark.parametrize("tables", [False, True])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_gimbal_is_found_as_it_is_built_in(sign: int, tables: bool) -> None:
    views = measured(yaw_sign=sign, yaw_zero_deg=-7.0, pitch_zero_deg=5.0)
    result, reasons = calibrate(views, tables=tables, turns=True, aside_m=0.0)
    assert reasons == []
    assert result is not None
    assert result.yaw is not None
    if tables:
        assert result.yaw.table is not None
        assert result.pitch.table is not None
        for reported, true in result.yaw.table:
            assert true == pytest.approx(sign * reported - 7.0 * DEGREE, abs=0.5 * DEGREE)
        for reported, true in result.pitch.table:
            assert true == pytest.approx(reported + 5.0 * DEGREE, abs=0.3 * DEGREE)
    else:
        assert result.yaw.zero == pytest.approx(-7.0 * DEGREE, abs=0.5 * DEGREE)
        assert result.pitch.zero == pytest.approx(5.0 * DEGREE, abs=0.3 * DEGREE)
    roll, _, yaw = result.camera_rotation
    assert (roll, yaw) == pytest.approx((3.0 * DEGREE, 2.0 * DEGREE), abs=0.5 * DEGREE)


def test_a_servos_bent_table_is_found() -> None:
    views = measured()
    # A servo that turns less towards its end: what it was ordered for these angles.
    bent = [replace(v, yaw=v.yaw + 0.3 * v.yaw * abs(v.yaw)) for v in views.views]
    result, reasons = calibrate(replace(views, views=bent), tables=True, turns=True, aside_m=0.0)
    assert reasons == []
    assert result is not None
    assert result.yaw is not None
    assert result.yaw.table is not None
    true = [angle for _, angle in result.yaw.table]
    assert true == pytest.approx([a * DEGREE for a in (-20, -10, 0, 10, 20)], abs=0.5 * DEGREE)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"scale": 1.1}, "yaw turns by 1.10 degrees for each one"),
        ({"down_deg": 3.0}, "pitch was turned by 6 degrees only"),
        ({"pad_moves_m": 0.1}, "from where it should have been"),
    ],
)
def test_a_poor_set_is_refused_with_the_reason(options: dict[str, float], why: str) -> None:
    _, reasons = calibrate(measured(**options), tables=False, turns=True, aside_m=0.0)  # type: ignore[arg-type]
    assert any(why in reason for reason in reasons), reasons


def test_too_few_views_are_refused() -> None:
    few = measured()
    few.views = few.views[:5]
    result, reasons = calibrate(few, tables=False, turns=True, aside_m=0.0)
    assert result is None
    assert "5 pictures, 8 are needed" in reasons[0]


def test_the_rotation_of_a_camera_is_found_from_its_views_of_the_pad() -> None:
    rng = random.Random(1)
    before = matmul(rot_zxy(0.0, 0.0, -0.5), R_GIMBAL_CAMERA)
    up = matmul(rot_zxy(0.0, 0.0, -0.4), R_GIMBAL_CAMERA)
    turned = turn_between(pad_seen(before, PAD, rng), pad_seen(up, PAD, rng))
    assert norm(sub(turned, (0.1, 0.0, 0.0))) < 1e-6  # about the camera's x
