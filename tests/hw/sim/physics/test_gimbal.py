import math
from collections.abc import Callable
from itertools import pairwise

import pytest

from hw.sim.physics.world import World
from tests.hw.sim.worlds import world


def turn(w: World, until_s: float, yaw: Callable[[float], float]) -> list[tuple[float, float]]:
    """Move the yaw set-point; return set-point and angle every 10 ms."""
    pairs = []
    while w.t < until_s - 1e-9:
        w.gimbal.aim(yaw(w.t), -0.4)
        w.advance(w.t + 0.01)
        pairs.append((yaw(w.t), w.gimbal.yaw.angle))
    return pairs


def test_lags_behind_a_moving_target_by_its_lag() -> None:
    target, angle = turn(world(), 1.5, lambda t: 0.4 * t)[-1]
    assert (target - angle) / 0.4 == pytest.approx(0.08, abs=0.025)


def test_reaches_a_target_within_half_a_second() -> None:
    pairs = turn(world(), 1.0, lambda t: 0.2)
    assert all(angle == pytest.approx(0.2, abs=0.01) for _, angle in pairs[50:])


def test_turns_no_faster_than_its_motor() -> None:
    angles = [a for _, a in turn(world(gimbal={"rate_limit_deg_s": 60.0}), 1.0, lambda t: 1.5)]
    fastest = max(b - a for a, b in pairwise(angles)) / 0.01
    assert math.degrees(fastest) == pytest.approx(60.0, abs=1.0)


def test_stops_at_its_limits() -> None:
    w = world()
    w.gimbal.aim(math.radians(120.0), math.radians(-200.0))
    w.advance(10.0)
    assert math.degrees(w.gimbal.yaw.angle) == pytest.approx(90.0, abs=1.0)
    assert w.gimbal.yaw.angle <= math.pi / 2.0
    assert w.gimbal.pitch.angle >= -math.pi
