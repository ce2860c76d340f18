"""The heading that velocities in the body's frame are turned by."""

import math
from itertools import pairwise
from random import Random

import pytest

from hw.autopilots.heading import Heading

RATE_HZ = 50.0


def turned(noise_deg: float, rate_deg_s: float, duration_s: float = 4.0) -> list[float]:
    """Return the heading's error at each measurement of a turning vehicle, rad."""
    rng, heading, off = Random(1), Heading(), []
    rate = math.radians(rate_deg_s)
    for i in range(round(duration_s * RATE_HZ)):
        t = i / RATE_HZ
        noise = rng.gauss(0.0, math.radians(noise_deg))
        heading.measured(t, math.remainder(rate * t + noise, 2.0 * math.pi), rate)
        at = heading.at(t + 0.01)
        assert at is not None
        off.append(math.remainder(at - rate * (t + 0.01), 2.0 * math.pi))
    return off


def test_the_heading_is_unknown_before_it_was_measured() -> None:
    assert Heading().at(1.0) is None


@pytest.mark.parametrize("rate_deg_s", [0.0, 30.0, -60.0])
def test_the_heading_turns_with_the_vehicle(rate_deg_s: float) -> None:
    assert max(map(abs, turned(0.0, rate_deg_s))) < 1e-9


def test_noise_of_the_heading_makes_no_jerk_beyond_the_limit() -> None:
    """At 5 m/s across, with set-points 25 ms apart and 0.1 degrees of noise."""
    off = turned(0.1, 10.0)[50:]
    steps = [b - a for a, b in pairwise(off)]
    jerks = [5.0 * abs(b - a) / 0.025**2 for a, b in pairwise(steps)]
    assert max(jerks) < 0.2 * 15.0
    assert max(map(abs, off)) < math.radians(0.1)


def test_a_heading_that_begins_anew_is_taken_when_it_stays() -> None:
    heading = Heading()
    for i in range(12):
        heading.measured(0.02 * i, 0.1 if i == 0 else 0.5, 0.0)
    assert heading.at(0.22) == pytest.approx(0.5)
    heading.measured(2.0, 0.52, 0.0)
    assert heading.at(2.0) == pytest.approx(0.52)


@pytest.mark.parametrize("samples", [1, 3])
def test_spikes_of_the_heading_are_not_flown_on(samples: int) -> None:
    heading = Heading()
    for i in range(50):
        is_spike = i % (2 * samples + 1) > samples
        heading.measured(0.02 * i, 0.9 if is_spike else 0.1, 0.0)
        assert heading.at(0.02 * i) == pytest.approx(0.1)
