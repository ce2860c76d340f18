from dataclasses import replace

import pytest

from hw.sim.judge.limits import SetpointLimits
from landerd.geometry import Vec3
from tests.hw.sim.judge.bounds import BOUNDS

DT = 0.025


def broken(
    *velocities: Vec3,
    yaw_rate: float = 0.0,
    dt: float = DT,
    jitter_s: float = 0.0,
    in_body_frame: bool = False,
) -> list[str]:
    """Return the rules that set-points dt apart break, in the order in which they did."""
    rules: list[str] = []
    limits = SetpointLimits(
        replace(BOUNDS, jitter_s=jitter_s), lambda t, rule: rules.append(f"{t:.3f} {rule}")
    )
    for i, velocity in enumerate(velocities):
        limits.check(dt * i, velocity, yaw_rate, in_body_frame=in_body_frame)
    assert limits.last_t == pytest.approx(dt * (len(velocities) - 1))
    return rules


@pytest.mark.parametrize(
    ("velocity", "yaw_rate", "rule"),
    [
        ((3.0, -4.0, 0.9), 0.5, None),
        ((4.0, -4.0, 0.0), 0.0, "3: too fast"),
        ((0.0, 0.0, 1.1), 0.0, "3: climbing or sinking too fast"),
        ((0.0, 0.0, -1.1), 0.0, "3: climbing or sinking too fast"),
        ((0.0, 0.0, 0.0), -0.6, "3: turning too fast"),
    ],
)
def test_each_set_point_is_within_the_limits(
    velocity: Vec3, yaw_rate: float, rule: str | None
) -> None:
    assert broken(velocity, yaw_rate=yaw_rate) == ([f"0.000 {rule}"] if rule else [])


def test_acceleration_and_jerk_need_two_and_three_set_points() -> None:
    # 4 m/s^2 at once: the acceleration before it is not known, so no jerk is told.
    assert broken((0.1, 0.0, 0.0), (0.2, 0.0, 0.0)) == ["0.025 3: horizontal acceleration"]
    # From 0 to 2 m/s^2 within 25 ms are 80 m/s^3.
    steady: Vec3 = (0.1, 0.0, 0.0)
    assert broken(steady, steady, (0.15, 0.0, 0.0)) == ["0.050 3: horizontal jerk"]
    down: Vec3 = (0.0, 0.0, 0.1)
    assert broken(down, down, (0.0, 0.0, 0.16)) == [
        "0.050 3: vertical acceleration",
        "0.050 3: vertical jerk",
    ]


def test_in_the_body_s_frame_the_heading_at_sending_counts_as_known_to_a_seventh_degree() -> None:
    """At 4 m/s, 0.1 degrees to the left and to the right make 0.56 m/s^2 and 45 m/s^3."""
    wobbles: list[Vec3] = [(4.0, 0.007 * (-1) ** i, 0.0) for i in range(6)]
    assert broken(*wobbles) != []
    assert broken(*wobbles, in_body_frame=True) == []
    assert broken((4.0, 0.0, 0.0), (4.1, 0.0, 0.0), in_body_frame=True) == [
        "0.025 3: horizontal acceleration"
    ]


def test_a_stop_breaks_no_limit_and_set_points_may_begin_anew_after_it() -> None:
    stop: Vec3 = (0.0, 0.0, 0.0)
    assert broken((3.0, 0.0, 0.5), stop) == []
    assert broken((3.0, 0.0, 0.5), stop, stop, (0.005, 0.0, 0.005)) == []


@pytest.mark.parametrize(
    ("velocity", "is_allowed"),
    [
        ((4.0, 0.0, -0.05), True),
        ((4.0, 0.0, -0.5), False),
        ((0.0, 4.0, 0.0), False),  # it flies elsewhere
        ((0.5, 0.0, 0.0), False),  # and so fast
    ],
)
def test_after_a_stop_order_set_points_may_begin_at_the_velocity_still_flown(
    velocity: Vec3, is_allowed: bool
) -> None:
    found: list[str] = []
    limits = SetpointLimits(BOUNDS, lambda t, rule: found.append(rule))
    for i, each in enumerate([(4.5, 0.0, 0.0), (0.0, 0.0, 0.0), velocity]):
        limits.check(DT * i, each, 0.0, flown=(4.3, 0.0, 0.0))
    assert (found == []) is is_allowed


def test_over_a_gap_in_the_set_points_no_acceleration_is_judged() -> None:
    assert broken((0.1, 0.0, 0.0), (3.0, 0.0, 0.0), dt=0.6) == []


def test_set_points_lost_by_a_cut_link_may_have_been_stop_orders() -> None:
    rules: list[str] = []
    limits = SetpointLimits(BOUNDS, lambda t, rule: rules.append(rule))
    for t, down in ((0.0, 0.8), (0.3, 0.01), (0.6, 0.9)):
        limits.check(t, (0.0, 0.0, down), 0.0)
        assert rules == ([] if t < 0.6 else ["3: vertical acceleration"])


def test_after_a_step_in_which_nothing_was_ordered_no_jerk_is_told() -> None:
    # Released for one control step: taken over two, the first acceleration seems half as large.
    rules: list[str] = []
    limits = SetpointLimits(BOUNDS, lambda t, rule: rules.append(rule))
    for t, down in ((0.0, 0.1), (DT, 0.1), (0.075, 0.1094), (0.1, 0.1281)):
        limits.check(t, (0.0, 0.0, down), 0.0)
    assert rules == []


def test_over_a_step_that_came_late_no_jerk_is_told() -> None:
    # A limiter that takes a late step for one of 50 ms goes on by less than it may.
    rules: list[str] = []
    limits = SetpointLimits(BOUNDS, lambda t, rule: rules.append(rule))
    for t, north in ((0.0, 0.0), (DT, 0.05), (0.085, 0.11), (0.11, 0.16)):
        limits.check(t, (1.0 + north, 0.0, 0.0), 0.0)
    assert rules == []


def test_a_wall_clock_that_jitters_is_allowed_for() -> None:
    steps: tuple[Vec3, ...] = ((0.1, 0.0, 0.0), (0.2, 0.0, 0.0))
    assert broken(*steps, jitter_s=0.01) == []


def test_after_a_level_order_it_begins_with_the_velocity_of_what_it_stands_on() -> None:
    # As the autopilot does: to begin from rest on a pad that moves is to be tipped over (rule 4).
    rules: list[str] = []
    limits = SetpointLimits(BOUNDS, lambda t, rule: rules.append(rule))
    limits.check(0.0, (1.0, 0.0, 0.0), 0.0)
    limits.levelled()
    limits.check(2.0 * DT, (4.0, 0.0, 0.0), 0.0)
    assert rules == []
    limits.check(3.0 * DT, (3.0, 0.0, 0.0), 0.0)
    assert rules == ["3: horizontal acceleration"]
