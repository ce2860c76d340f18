"""The camera's direction from a gimbal's angles, whatever they are measured against."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from landerd.geometry import matmul, rot_y, rot_z, rot_zyx
from landerd.gimbal_frames import rotation_local_base, rotation_local_gimbal
from landerd.messages import Reference

LEANS = st.floats(-0.4, 0.4)


@given(roll=LEANS, pitch=LEANS, heading=st.floats(-3.0, 3.0), yaw=st.floats(-1.5, 1.5))
@pytest.mark.parametrize("servo", [-2.0, -1.57, -0.7, 0.1])
def test_servos_are_placed_alike_by_the_airframe_and_by_a_sensor_on_the_camera(
    servo: float, roll: float, pitch: float, heading: float, yaw: float
) -> None:
    body = rot_zyx(heading, pitch, roll)
    true = matmul(body, matmul(rot_z(yaw), rot_y(servo)))
    by_body = rotation_local_gimbal(Reference.BODY, body, heading, (yaw, servo, 0.0))
    # What an accelerometer on the camera tells: the last row is gravity in its frame.
    felt = math.atan2(-true[2][0], true[2][2])
    by_tilt = rotation_local_gimbal(Reference.TILT, body, heading, (yaw, felt, 0.0))
    for i in range(3):
        assert by_body[i] == pytest.approx(true[i], abs=1e-9)
        assert by_tilt[i] == pytest.approx(true[i], abs=1e-9)


def test_a_stabilised_gimbal_compensates_the_lean_and_turns_with_the_heading() -> None:
    leaning, level, angles = rot_zyx(0.5, -0.2, 0.3), rot_z(0.5), (0.1, -0.6, 0.0)
    assert rotation_local_gimbal(Reference.HORIZON, leaning, 0.5, angles) == rotation_local_gimbal(
        Reference.HORIZON, level, 0.5, angles
    )
    assert rotation_local_base(Reference.HORIZON, leaning, 0.5) == level
    assert rotation_local_base(Reference.BODY, leaning, 0.5) == leaning
