"""Boot times land on the loop's clock as exactly as the link's delays allow."""

import random

import pytest

from hw.autopilots.boot_clock import BootClock

OFFSET = 123.456  # loop time minus boot time


def test_before_the_first_exchange_the_earliest_arrival_counts() -> None:
    clock = BootClock()
    for i, delay in enumerate((0.030, 0.010, 0.050)):
        boot = 10.0 + 0.02 * i
        placed = clock.place(boot, boot + OFFSET + delay)
    assert placed == pytest.approx(10.04 + OFFSET + 0.010)


def test_the_quickest_exchange_counts() -> None:
    clock, rng = BootClock(), random.Random(4)
    for i in range(40):
        sent = 200.0 + 0.2 * i
        there, back = rng.uniform(0.002, 0.1), rng.uniform(0.002, 0.1)
        clock.exchanged(sent, sent + there - OFFSET, sent + there + back)
    now = 300.0
    # Half of a quick round trip is the most it can be wrong by.
    assert clock.place(now - 1.0 - OFFSET, now) == pytest.approx(now - 1.0, abs=0.010)


def test_it_follows_a_drifting_clock() -> None:
    clock, drift = BootClock(), 100e-6
    for i in range(3000):  # ten minutes
        sent = 0.2 * i
        boot = (sent + 0.004) * (1.0 + drift)
        clock.exchanged(sent, boot, sent + 0.008)
    assert clock.place(599.0 * (1.0 + drift), 600.0) == pytest.approx(599.0, abs=0.002)


def test_a_stepped_clock_is_taken_over_at_once() -> None:
    clock = BootClock()
    clock.exchanged(100.0, 100.002 - OFFSET, 100.004)
    clock.exchanged(101.0, 101.005 - OFFSET - 5.0, 101.010)  # it stood still for 5 s
    assert clock.place(101.0 - OFFSET - 5.0, 102.0) == pytest.approx(101.0, abs=0.006)


def test_no_message_is_dated_after_its_arrival() -> None:
    clock = BootClock()
    clock.exchanged(100.0, 100.0 - OFFSET, 100.5)  # all of the delay on the way back
    assert clock.place(101.0 - OFFSET, 101.0) == 101.0


def test_an_endless_or_impossible_exchange_is_ignored() -> None:
    clock = BootClock()
    clock.exchanged(100.0, 50.0, 103.0)
    clock.exchanged(100.0, 50.0, 99.0)
    assert clock.place(10.0, 10.0 + OFFSET) == pytest.approx(10.0 + OFFSET)


def test_a_slow_exchange_hardly_counts_beside_quick_ones() -> None:
    clock = BootClock()
    for i in range(100):
        sent = 0.2 * i
        clock.exchanged(sent, sent + 0.002 - OFFSET, sent + 0.004)
        # And one that waited for 60 ms on its way back.
        clock.exchanged(sent + 0.1, sent + 0.102 - OFFSET, sent + 0.162)
    assert clock.place(20.0 - OFFSET, 21.0) == pytest.approx(20.0, abs=0.001)


def test_the_clock_is_uncertain_by_half_the_round_trip() -> None:
    clock = BootClock()
    assert clock.uncertainty_s is None
    for i in range(100):
        sent = 0.2 * i
        clock.exchanged(sent, sent + 0.05 - OFFSET, sent + 0.08)  # 50 ms there, 30 ms back
    uncertainty = clock.uncertainty_s
    assert uncertainty == pytest.approx(0.040, abs=0.003)
    assert abs(clock.place(20.0 - OFFSET, 21.0) - 20.0) < 0.040


def test_a_link_that_has_become_slow_is_known_to_be() -> None:
    clock = BootClock()
    for i in range(200):
        sent, slow = 0.2 * i, i >= 100
        back = 0.35 if slow else 0.002
        clock.exchanged(sent, sent + 0.002 - OFFSET, sent + 0.002 + back)
    assert clock.uncertainty_s == pytest.approx(0.176, abs=0.005)


def test_a_stamp_of_32_bits_goes_on_when_it_begins_anew() -> None:
    clock, wrap = BootClock(), 2**32
    clock.heard(1e-3 * (wrap - 100), 50.0)
    assert clock.unwrapped(20, 50.12) == pytest.approx(1e-3 * (wrap + 20))
    assert clock.unwrapped(wrap - 50, 50.05) == pytest.approx(1e-3 * (wrap - 50))


def test_a_clock_that_goes_ahead_to_its_end_and_begins_anew_never_goes_back() -> None:
    clock, wrap = BootClock(), 2**32
    clock.heard(20.0, 50.0)
    ahead_s = clock.unwrapped(wrap - 200, 50.1)
    assert ahead_s == pytest.approx(1e-3 * (wrap - 200))
    clock.heard(ahead_s, 50.1)
    assert clock.unwrapped(100, 50.4) == pytest.approx(1e-3 * (wrap + 100))


def test_an_autopilot_that_restarts_begins_at_zero() -> None:
    clock = BootClock()
    clock.heard(500.0, 50.0)
    assert clock.unwrapped(300, 51.0) == pytest.approx(0.3)
