"""Signs and zeros of a gimbal's mounting on the airframe."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from hw.gimbals.mounting import Mounting, MountOptions
from landerd.messages import GimbalCommand


def mounting(**options: object) -> Mounting:
    chosen = {"yaw_limits_deg": (-90.0, 90.0), "pitch_limits_deg": (-90.0, 20.0)} | options
    return Mounting(MountOptions.model_validate(chosen | {"rate_hz": 50.0, "latency_s": 0.0}))


@given(
    yaw=st.floats(-1.5, 1.5),
    pitch=st.floats(-1.5, 0.3),
    yaw_sign=st.sampled_from([1, -1]),
    pitch_sign=st.sampled_from([1, -1]),
    zero=st.floats(-20.0, 20.0).map(lambda degrees: round(degrees, 6)),
)
def test_an_order_passed_through_the_mounting_is_reported_unchanged(
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


def test_a_gimbal_with_a_negative_sign_turns_the_other_way() -> None:
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
