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


def test_nothing_is_placed_after_its_arrival() -> None:
    clock = BootClock()
    clock.exchanged(100.0, 100.0 - OFFSET, 100.5)  # all of the delay on the way back
    assert clock.place(101.0 - OFFSET, 101.0) == 101.0


def test_an_endless_or_impossible_exchange_says_nothing() -> None:
    clock = BootClock()
    clock.exchanged(100.0, 50.0, 103.0)
    clock.exchanged(100.0, 50.0, 99.0)
    assert clock.place(10.0, 10.0 + OFFSET) == pytest.approx(10.0 + OFFSET)
