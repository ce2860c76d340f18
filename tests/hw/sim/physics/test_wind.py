"""Turbulence of Dryden's spectra."""

import statistics
from random import Random

import pytest

from hw.sim.physics.wind import UPDATE_S, DrydenTurbulence


def series(sigma: float, mean: float) -> tuple[list[float], list[float], float]:
    turbulence = DrydenTurbulence(sigma, mean, Random(3))
    pairs = [turbulence.next() for _ in range(400_000)]
    return [a for a, _ in pairs], [b for _, b in pairs], turbulence.time_s


def test_both_components_have_the_asked_size() -> None:
    along, across, _ = series(1.5, 8.0)
    assert statistics.stdev(along) == pytest.approx(1.5, rel=0.1)
    assert statistics.stdev(across) == pytest.approx(1.5, rel=0.1)


def test_along_the_wind_it_forgets_within_the_scale_length_over_the_airspeed() -> None:
    along, _, time_s = series(1.0, 8.0)
    # 8 m up: 26 ft / (0.177 + 0.0216)^1.2 = 183 ft = 56 m, at 8 m/s 7 s.
    assert time_s == pytest.approx(7.0, rel=0.05)
    lag = round(time_s / UPDATE_S)
    product = statistics.mean(a * b for a, b in zip(along, along[lag:], strict=False))
    assert product / statistics.variance(along) == pytest.approx(0.37, abs=0.15)
