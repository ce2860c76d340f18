"""Errors of the autopilot's estimate besides noise: wandering, jumps, turning."""

import itertools
import math
import statistics
from random import Random

import pytest

from hw.sim.options import EkfOptions
from hw.sim.stand_in.ekf import PositionDrift
from tests.hw.sim.worlds import ekf_in, world


def test_positions_wander_as_far_in_a_minute_as_asked() -> None:
    ends = []
    for seed in range(200):
        drift = PositionDrift(EkfOptions(position_wander_m_per_min=0.5), Random(seed))
        drift.at(0.0)
        ends.append(drift.at(60.0)[0])
    assert statistics.stdev(ends) == pytest.approx(0.5, rel=0.15)


def test_positions_jump_as_often_and_as_far_as_asked() -> None:
    drift = PositionDrift(EkfOptions(position_jump_m=0.3, jump_every_s=5.0), Random(1))
    path = [drift.at(0.2 * i) for i in range(5000)]
    jumps = [math.dist(a, b) for a, b in itertools.pairwise(path) if a != b]
    assert len(jumps) == pytest.approx(200, rel=0.2)
    assert max(jumps) <= 0.3


def test_the_heading_is_off_and_drifts_and_the_climb_is_biased() -> None:
    w = world(
        ekf={"heading_error_deg": 2.0, "heading_drift_deg_per_min": 6.0, "vertical_bias_mps": 0.05}
    )
    ekf = ekf_in(w)
    at_start = math.degrees(ekf.estimate(0.0).yaw - w.vehicle.yaw)
    assert at_start == pytest.approx(2.0, abs=0.2)
    later = ekf.estimate(30.0)
    assert math.degrees(later.yaw - w.vehicle.yaw) == pytest.approx(5.0, abs=0.2)
    assert later.velocity[2] - w.vehicle.velocity[2] == pytest.approx(0.05, abs=0.02)
