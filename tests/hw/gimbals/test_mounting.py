"""How a gimbal sits on the airframe."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from hw.gimbals.mounting import Mounting, MountOptions, gimbal_order, level_angles
from landerd.geometry import Mat3, matmul, rot_x, rot_y, rot_z, rot_zyx
from landerd.messages import GimbalCommand, Reference


def mounting(**options: object) -> Mounting:
    chosen = {"yaw_limits_deg": (-90.0, 90.0), "pitch_limits_deg": (-90.0, 20.0)} | options
    return Mounting(MountOptions.model_validate(chosen), Reference.BODY, 50.0)


def angle_between(a: Mat3, b: Mat3) -> float:
    trace = sum(a[i][j] * b[i][j] for i in range(3) for j in range(3))
    return math.acos(max(-1.0, min(1.0, 0.5 * (trace - 1.0))))


@given(
    yaw=st.floats(-1.5, 1.5),
    pitch=st.floats(-1.5, 0.3),
    yaw_sign=st.sampled_from([1, -1]),
    pitch_sign=st.sampled_from([1, -1]),
    zero=st.floats(-20.0, 20.0),
)
def test_what_is_ordered_is_what_is_reported(
    yaw: float, pitch: float, yaw_sign: int, pitch_sign: int, zero: float
) -> None:
    mount = mounting(
        yaw_sign=yaw_sign, pitch_sign=pitch_sign, yaw_zero_deg=zero, pitch_zero_deg=-zero
    )
    device = mount.order(GimbalCommand(yaw, pitch))
    assert device is not None
    state = mount.state(1.0, *device)
    assert state is not None
    assert (state.yaw, state.pitch) == pytest.approx((yaw, pitch), abs=1e-9)


def test_a_gimbal_that_turns_the_other_way() -> None:
    mount = mounting(yaw_sign=-1, yaw_zero_deg=7.0)
    device = mount.order(GimbalCommand(math.radians(17.0), 0.0))
    assert device is not None
    assert math.degrees(device[0]) == pytest.approx(-10.0)


def test_orders_stay_within_the_limits_and_are_numbers() -> None:
    mount = mounting()
    device = mount.order(GimbalCommand(3.0, -3.0))
    assert device is not None
    assert [math.degrees(a) for a in device] == pytest.approx([90.0, -90.0])
    assert mount.order(GimbalCommand(math.nan, 0.0)) is None
    assert mount.order(GimbalCommand(0.0, math.inf)) is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, 7.0])
def test_reports_that_are_no_angles_are_dropped(bad: float) -> None:
    assert mounting().state(0.0, bad, 0.0) is None
    assert mounting().state(0.0, 0.0, bad) is None
    assert mounting().state(0.0, 0.0, 0.0, bad) is None


def test_limits_the_wrong_way_round_are_refused() -> None:
    with pytest.raises(ValidationError, match=r"\[lowest, highest\]"):
        mounting(yaw_limits_deg=(10.0, -10.0))


@given(yaw=st.floats(-3.0, 3.0), pitch=st.floats(-1.2, 1.2), roll=st.floats(-0.02, 0.02))
def test_the_order_of_the_axes_is_turned_to_first_order(
    yaw: float, pitch: float, roll: float
) -> None:
    R = matmul(matmul(rot_z(yaw), rot_x(roll)), rot_y(pitch))
    y, p, r = level_angles(yaw, pitch, roll)
    assert angle_between(R, rot_zyx(y, p, r)) < 0.003


@given(roll=st.floats(-0.02, 0.02), off=st.floats(-0.2, 0.2))
def test_looking_down_yaw_does_not_jump_about(roll: float, off: float) -> None:
    yaw, pitch, rolled = level_angles(0.5, -math.pi / 2.0 + off, roll)
    assert (yaw, rolled) == pytest.approx((0.5, 0.0))
    assert pitch == pytest.approx(-math.pi / 2.0 + off)


@given(yaw=st.floats(-3.1, 3.1), pitch=st.floats(-3.1, 3.1), roll=st.floats(-0.3, 0.3))
def test_angles_of_a_rotation_also_straight_down(yaw: float, pitch: float, roll: float) -> None:
    R = matmul(matmul(rot_z(yaw), rot_x(roll)), rot_y(pitch))
    assert gimbal_order(R) == pytest.approx((yaw, pitch, roll), abs=1e-6)
