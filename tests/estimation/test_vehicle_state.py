import math

import pytest

from landerd.config.models import Config
from landerd.estimation.camera_pose import PoseHistory
from landerd.estimation.vehicle_state import vehicle_state
from tests.estimation.vehicles import GEAR, flying, vehicle


def test_the_feet_are_below_the_autopilots_position_and_lean_with_the_airframe() -> None:
    assert vehicle(flying()).feet == pytest.approx((1.0, 2.0, -4.8))
    nose_down = vehicle(flying(pitch=-0.2)).feet  # the feet swing back
    assert nose_down == pytest.approx((1.0 - 0.2 * math.sin(0.2), 2.0, -5.0 + 0.2 * math.cos(0.2)))


def test_the_position_is_carried_on_by_the_velocity_to_now() -> None:
    moved = vehicle(flying(velocity=(5.0, 0.0, -1.0)), now=10.1)
    assert moved.feet == pytest.approx((1.5, 2.0, -4.9))


def test_a_leaning_vehicle_turns_as_its_heading_does_not_as_its_own_axis() -> None:
    """Turning at 0.5 rad/s with 0.5 rad of roll, by gyros that turn with it."""
    rates = (0.0, 0.5 * math.sin(0.5), 0.5 * math.cos(0.5))
    leaning = vehicle(flying(roll=0.5, rates=rates), now=10.1)
    assert leaning.yaw_rate == pytest.approx(0.5)
    assert leaning.yaw == pytest.approx(0.05)


def test_without_telemetry_there_is_no_vehicle() -> None:
    assert vehicle_state(PoseHistory(Config()), GEAR, 10.0) is None
