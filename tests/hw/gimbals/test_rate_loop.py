"""The loop around a rate-commanded axis, on an axis with a spring."""

import math

import pytest

from hw.gimbals.rate_loop import RateLoop, RateLoopOptions

DT = 0.02
PULL = 0.2  # of the spring: rad/s per rad


def turn(
    options: RateLoopOptions, target: float, seconds: float, limit: float = 1.5
) -> list[float]:
    """Angles of an axis that starts at 0; its motor takes 40 ms to follow."""
    loop = RateLoop(options, limit, math.radians(options.integral_limit_deg_s))
    angle = rate = 0.0
    angles = []
    for _ in range(round(seconds / DT)):
        order = loop.step(target, angle, rate, DT)
        assert abs(order) <= limit
        rate += (order - PULL * angle - rate) * DT / 0.04
        angle += rate * DT
        angles.append(angle)
    return angles


def test_the_integral_holds_against_the_spring() -> None:
    held = turn(RateLoopOptions(), -1.5, 8.0)[-1]
    assert held == pytest.approx(-1.5, abs=math.radians(0.2))
    sagging = turn(RateLoopOptions(ki=0.0), -1.5, 8.0)[-1]
    assert sagging > -1.5 + math.radians(2.0)


def test_does_not_wind_up_during_a_long_turn() -> None:
    # Two seconds at the limit on the way; an unlimited integral would carry it far past.
    assert max(turn(RateLoopOptions(), 3.0, 8.0)) < 3.0 + math.radians(6.0)


def test_never_goes_the_short_way_round_through_its_stops() -> None:
    loop = RateLoop(RateLoopOptions(), 1.5, 0.3)
    assert loop.step(math.radians(-130.0), math.radians(130.0), 0.0, DT) < 0.0
    assert loop.step(math.radians(130.0), math.radians(-130.0), 0.0, DT) > 0.0
