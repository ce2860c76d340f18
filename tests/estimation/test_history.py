import math

import pytest

from landerd.estimation.history import History


def angle_history(*, max_gap_s: float = 0.2) -> History:
    return History(angles=1, max_gap_s=max_gap_s)


def test_between_two_measurements_values_are_interpolated() -> None:
    history = History(angles=0)
    history.add(1.0, (10.0, -4.0))
    history.add(1.1, (20.0, -8.0))
    assert history.at(1.025) == pytest.approx((12.5, -5.0))
    assert history.at(1.0) == (10.0, -4.0)
    assert history.at(1.1) == (20.0, -8.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_angle_is_interpolated_the_short_way_across_180_degrees(sign: float) -> None:
    history = angle_history()
    history.add(0.0, (sign * math.radians(179.0),))
    history.add(0.1, (sign * math.radians(-177.0),))  # 4 degrees further
    quarter, half = history.at(0.025), history.at(0.05)
    assert quarter is not None
    assert half is not None
    assert abs(quarter[0]) == pytest.approx(math.radians(180.0))
    assert half[0] == pytest.approx(sign * math.radians(-179.0))


def test_values_that_are_no_angles_are_interpolated_without_wrapping() -> None:
    history = History(angles=0)
    history.add(0.0, (3.0,))
    history.add(0.1, (-3.0,))
    assert history.at(0.05) == pytest.approx((0.0,))


def swing(t: float) -> tuple[float, float]:
    """An angle that swings by 16 degrees at 1.3 Hz, and its rate."""
    size, w = math.radians(16.0), 2.0 * math.pi * 1.3
    return size * math.sin(w * t), size * w * math.cos(w * t)


def test_with_rates_a_slow_stream_of_a_quick_swing_is_followed() -> None:
    history = History(angles=1, rates=lambda values: values[1:])
    lines = History(angles=1)
    for i in range(26):
        history.add(0.04 * i, swing(0.04 * i))
        lines.add(0.04 * i, swing(0.04 * i))
    for i in range(90):
        t = 0.05 + 0.01 * i
        got, straight, true = history.at(t), lines.at(t), swing(t)[0]
        assert got is not None
        assert straight is not None
        assert abs(got[0] - true) < math.radians(0.005)
        assert abs(straight[0] - true) < math.radians(0.25)
    ahead = history.at(1.03)  # 30 ms after the newest
    assert ahead is not None
    assert abs(ahead[0] - swing(1.03)[0]) < math.radians(0.5)
    assert abs(swing(1.0)[0] - swing(1.03)[0]) > math.radians(1.5)


def test_with_rates_an_angle_is_interpolated_the_short_way_across_180_degrees() -> None:
    history = History(angles=1, rates=lambda values: values[1:])
    history.add(0.0, (math.radians(179.0), math.radians(40.0)))
    history.add(0.1, (math.radians(-177.0), math.radians(40.0)))
    half, ahead = history.at(0.05), history.at(0.15)
    assert half is not None
    assert ahead is not None
    assert half[0] == pytest.approx(math.radians(-179.0))
    assert ahead[0] == pytest.approx(math.radians(-175.0))


def test_values_go_on_by_their_rates_for_a_moment_only() -> None:
    history = History(angles=0, rates=lambda values: values[1:])
    history.add(1.0, (5.0, 2.0))
    assert history.at(1.05) == pytest.approx((5.1, 2.0))
    assert history.at(1.1) == history.at(1.19) == pytest.approx((5.2, 2.0))
    assert history.at(1.21) is None


def test_a_gap_is_not_interpolated_over() -> None:
    history = angle_history(max_gap_s=0.2)
    history.add(1.0, (0.0,))
    history.add(1.3, (0.3,))
    assert history.at(1.15) is None
    assert history.at(1.3) == (0.3,)


def test_the_newest_measurement_holds_for_the_longest_gap_and_no_longer() -> None:
    history = angle_history(max_gap_s=0.2)
    history.add(1.0, (0.5,))
    assert history.at(1.19) == (0.5,)
    assert history.at(1.21) is None


def test_before_the_oldest_measurement_nothing_is_known() -> None:
    history = angle_history()
    assert history.at(1.0) is None
    history.add(1.0, (0.5,))
    assert history.at(0.99) is None


@pytest.mark.parametrize("late", [1.0, 0.9, -5.0])
def test_a_measurement_that_is_not_newer_is_refused(late: float) -> None:
    history = angle_history()
    assert history.add(1.0, (0.5,))
    assert not history.add(late, (9.9,))
    assert history.newest == (1.0, (0.5,))


def test_age_counts_from_the_newest_measurements_own_time() -> None:
    history = angle_history()
    assert history.age(3.0) == math.inf
    history.add(2.5, (0.0,))
    assert history.age(3.0) == 0.5
    history.clear()
    assert history.age(3.0) == math.inf
    assert history.newest is None
    assert history.add(0.1, (0.0,))  # the source's clock may have started again


def test_the_last_second_stays_known_and_what_is_older_is_let_go() -> None:
    history = History(angles=0)
    for i in range(5001):
        history.add(0.01 * i, (0.001 * i,))
    assert history.at(49.505) == pytest.approx((4.9505,))
    assert history.at(49.0) is not None
    assert history.at(40.0) is None


def test_the_newest_value_is_held_no_longer_than_configured() -> None:
    history = History(angles=1, max_gap_s=0.3, held_s=0.15)
    history.add(1.0, (0.1,))
    assert history.at(1.14) == (0.1,)
    assert history.at(1.16) is None
    history.add(1.25, (0.2,))
    assert history.at(1.125) == pytest.approx((0.15,))


def test_a_measurement_that_comes_later_counts_at_a_time_that_was_asked_for_before() -> None:
    history = History(angles=0)
    history.add(1.0, (5.0,))
    assert history.at(1.1) == (5.0,)
    history.add(1.2, (7.0,))
    assert history.at(1.1) == pytest.approx((6.0,))
    history.clear()
    assert history.at(1.1) is None
