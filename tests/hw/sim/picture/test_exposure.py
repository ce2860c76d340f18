"""Auto exposure: where it ends, how fast, and what it does with time and gain."""

import math
from typing import Any

import pytest

from hw.sim.camera_options import SimCameraOptions
from hw.sim.picture.exposure import AutoExposure, Exposure


def automatic(**auto: Any) -> AutoExposure:
    options = {"exposure": "auto", "exposure_s": 0.008, "auto_exposure": auto}
    return AutoExposure(SimCameraOptions.model_validate(options))


def amount(exposure: Exposure) -> float:
    return exposure.time_s * exposure.gain / 0.008


def test_it_finds_the_target_first_order_in_stops() -> None:
    auto = automatic(target=0.5, lag_s=0.4)
    light = 0.1  # mean at the exposure it begins with
    stops = []
    for i in range(60):
        auto.see(light * amount(auto.exposure), i / 30)
        stops.append(math.log2(0.5 / (light * amount(auto.exposure))))
    # The first picture only starts the clock; in 0.4 s all but 1/e of the way is gone.
    assert stops[0] == pytest.approx(math.log2(5.0), abs=0.05)
    assert stops[12] / stops[0] == pytest.approx(math.exp(-1.0), abs=0.02)
    assert stops[-1] == pytest.approx(0.0, abs=0.05)


def test_the_lag_is_the_same_through_a_tone_curve() -> None:
    options = SimCameraOptions.model_validate(
        {"exposure": "auto", "tone": {"curve": "gamma", "gamma": 2.2}, "black_level": 10.0}
    )
    auto = AutoExposure(options)

    def mean() -> float:
        lit: float = (0.02 * amount(auto.exposure)) ** (1 / 2.2)
        return (10.0 + 245.0 * lit) / 255.0

    auto.see(mean(), 0.0)
    wanted = 0.17 / 0.02  # of the light, whatever the curve makes of it
    for i in range(1, 10):
        auto.see(mean(), i / 30)
    assert math.log2(amount(auto.exposure)) == pytest.approx(
        (1 - math.exp(-1.0)) * math.log2(wanted), abs=0.05
    )


def test_gain_only_where_the_longest_exposure_is_not_enough() -> None:
    auto = automatic(longest_s=0.02, gain_max=4.0, lag_s=0.02)
    auto.see(0.9, 0.0)
    for i in range(1, 30):
        auto.see(0.9, i / 30)
    assert auto.exposure.gain == 1.0
    assert auto.exposure.time_s < 0.008
    for i in range(30, 90):
        auto.see(0.001, i / 30)
    assert auto.exposure.time_s == 0.02
    assert auto.exposure.gain == pytest.approx(4.0, rel=0.02)
