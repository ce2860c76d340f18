import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from landerd.config.models import LimitsSection
from landerd.geometry import Vec3, horizontal, norm, sub
from landerd.guidance.limits import Limiter
from landerd.messages import Setpoint

LIMITS = LimitsSection(speed_mps=5.0)
DT = 0.025
SLACK = 1.0 + 1e-9

speeds = st.floats(-50.0, 50.0)
demands = st.lists(
    st.tuples(
        st.tuples(speeds, speeds, st.floats(-9.0, 9.0)),
        st.floats(-9.0, 9.0),
        st.integers(1, 60),  # ticks
    ),
    min_size=1,
    max_size=8,
)
tick = st.sampled_from([0.01, 0.025, 0.05])


def fly(limiter: Limiter, velocity: Vec3, seconds: float, yaw_rate: float = 0.0) -> list[Setpoint]:
    steps = round(seconds / DT)
    return [limiter.step(velocity, yaw_rate, DT, may_descend=True) for _ in range(steps)]


@settings(max_examples=60)
@given(demands, tick)
def test_no_demand_breaks_a_limit(wanted: list[tuple[Vec3, float, int]], dt: float) -> None:
    limiter = Limiter(LIMITS)
    before: Vec3 = (0.0, 0.0, 0.0)
    was: Vec3 = (0.0, 0.0, 0.0)
    for velocity, yaw_rate, ticks in wanted:
        for _ in range(ticks):
            setpoint = limiter.step(velocity, yaw_rate, dt, may_descend=True)
            v = setpoint.velocity
            a = ((v[0] - before[0]) / dt, (v[1] - before[1]) / dt, (v[2] - before[2]) / dt)
            assert horizontal(v) <= LIMITS.speed_mps * SLACK
            assert -LIMITS.climb_mps * SLACK <= v[2] <= LIMITS.descent_mps * SLACK
            assert horizontal(a) <= LIMITS.acceleration_mps2 * SLACK
            assert abs(a[2]) <= LIMITS.vertical_acceleration_mps2 * SLACK
            jerk = LIMITS.jerk_mps3 * dt * SLACK + 1e-9
            assert horizontal(sub(a, was)) <= jerk
            assert abs(a[2] - was[2]) <= jerk
            assert abs(setpoint.yaw_rate) <= math.radians(LIMITS.yaw_rate_deg_s) * SLACK
            before, was = v, a


@pytest.mark.parametrize("late_s", [0.1, 0.5, 2.0])
def test_a_late_tick_breaks_no_limit_either(late_s: float) -> None:
    """Its set-point is no farther from the last one than that of a tick 0.05 s after that."""
    for wanted in ((20.0, 0.0, 9.0), (20.0, 0.0, -9.0)):
        limiter = Limiter(LIMITS)
        for seconds in (0.1, 0.4, 0.9, 1.4, 1.9):
            fly(limiter, wanted, seconds)
            before = limiter.velocity
            v = limiter.step(wanted, 1.0, late_s, may_descend=True).velocity
            assert horizontal(v) <= LIMITS.speed_mps * SLACK
            assert -LIMITS.climb_mps * SLACK <= v[2] <= LIMITS.descent_mps * SLACK
            assert horizontal(sub(v, before)) <= LIMITS.acceleration_mps2 * 0.05 * SLACK


def test_a_demand_within_the_limits_is_reached_without_overshoot() -> None:
    limiter = Limiter(LIMITS)
    flown = fly(limiter, (3.0, -2.0, 0.5), 4.0)
    assert norm(sub(flown[-1].velocity, (3.0, -2.0, 0.5))) < 0.01
    assert max(s.velocity[0] for s in flown) < 3.0 * 1.01
    assert max(s.velocity[2] for s in flown) < 0.5 * 1.01
    # sqrt(13) m/s at 2.5 m/s^2 takes 1.5 s, and some for the jerk: not much longer.
    assert norm(sub(flown[round(2.2 / DT)].velocity, (3.0, -2.0, 0.5))) < 0.05


def test_a_demand_beyond_the_speed_limit_keeps_its_direction() -> None:
    limiter = Limiter(LIMITS)
    v = fly(limiter, (30.0, 40.0, 0.0), 6.0)[-1].velocity
    assert horizontal(v) == pytest.approx(LIMITS.speed_mps, rel=1e-3)
    assert math.atan2(v[1], v[0]) == pytest.approx(math.atan2(40.0, 30.0))


def test_descent_ends_at_once_when_it_is_no_longer_allowed() -> None:
    limiter = Limiter(LIMITS)
    assert fly(limiter, (2.0, 0.0, 1.0), 3.0)[-1].velocity[2] == pytest.approx(1.0, rel=1e-3)
    v = limiter.step((2.0, 0.0, 1.0), 0.0, DT, may_descend=False).velocity
    assert v[2] == 0.0
    assert v[0] == pytest.approx(2.0, rel=1e-3)  # the rest flies on


@settings(max_examples=60)
@given(demands)
def test_not_allowed_to_descend_it_never_does(wanted: list[tuple[Vec3, float, int]]) -> None:
    limiter = Limiter(LIMITS)
    for i, (velocity, yaw_rate, ticks) in enumerate(wanted):
        for _ in range(ticks):
            allowed = i % 2 == 0
            setpoint = limiter.step(velocity, yaw_rate, DT, may_descend=allowed)
            if not allowed:
                assert setpoint.velocity[2] <= 0.0


def test_climbing_is_possible_where_descent_is_not_allowed() -> None:
    limiter = Limiter(LIMITS)
    for _ in range(120):
        setpoint = limiter.step((0.0, 0.0, -0.5), 0.0, DT, may_descend=False)
    assert setpoint.velocity[2] == pytest.approx(-0.5, rel=1e-3)


def test_a_stop_is_immediate_and_lasts() -> None:
    limiter = Limiter(LIMITS)
    fly(limiter, (4.0, 2.0, 1.0), 2.0, yaw_rate=0.4)
    assert limiter.stop() == Setpoint((0.0, 0.0, 0.0), 0.0)
    for setpoint in fly(limiter, (0.0, 0.0, 0.0), 0.5):
        assert setpoint == Setpoint((0.0, 0.0, 0.0), 0.0)


def test_an_order_not_to_turn_is_immediate() -> None:
    limiter = Limiter(LIMITS)
    assert fly(limiter, (0.0, 0.0, 0.0), 1.0, yaw_rate=0.5)[-1].yaw_rate == pytest.approx(0.5)
    assert limiter.step((0.0, 0.0, 0.0), 0.0, DT, may_descend=True).yaw_rate == 0.0


def test_turning_begins_gently() -> None:
    limiter = Limiter(LIMITS)
    rates = [s.yaw_rate for s in fly(limiter, (0.0, 0.0, 0.0), 1.0, yaw_rate=9.0)]
    assert rates[0] < math.radians(5.0)
    assert rates[-1] == pytest.approx(math.radians(LIMITS.yaw_rate_deg_s))


def test_set_points_begin_at_the_velocity_that_is_flown() -> None:
    limiter = Limiter(LIMITS)
    limiter.reset((3.0, 0.0, -0.4))
    v = limiter.step((3.0, 0.0, -0.4), 0.0, DT, may_descend=False).velocity
    assert v == pytest.approx((3.0, 0.0, -0.4))
    limiter.reset((12.0, 0.0, 4.0))  # faster than it may fly itself
    v = limiter.step((12.0, 0.0, 4.0), 0.0, DT, may_descend=True).velocity
    assert v == pytest.approx((LIMITS.speed_mps, 0.0, LIMITS.descent_mps))


@pytest.mark.parametrize(("acceleration", "jerk"), [(0.5, 15.0), (0.5, 50.0), (1.0, 50.0)])
def test_a_gentle_acceleration_reached_at_once_neither_passes_the_speed_nor_swings_about_it(
    acceleration: float, jerk: float
) -> None:
    """At 20 Hz the jerk reaches the acceleration in a step: climbs swung from 0.27 to 0.32."""
    limits = LimitsSection(
        climb_mps=0.3,
        acceleration_mps2=acceleration,
        vertical_acceleration_mps2=acceleration,
        jerk_mps3=jerk,
        speed_mps=0.5,
    )
    limiter = Limiter(limits)
    flown = [limiter.step((9.0, 0.0, -9.0), 0.0, 0.05, may_descend=True) for _ in range(100)]
    assert max(s.velocity[0] for s in flown) <= 0.5 + 1e-9
    assert min(s.velocity[2] for s in flown) >= -0.3 - 1e-9
    assert flown[-1].velocity == pytest.approx((0.5, 0.0, -0.3), abs=1e-6)
    assert flown[-2].velocity == pytest.approx(flown[-1].velocity, abs=1e-6)
