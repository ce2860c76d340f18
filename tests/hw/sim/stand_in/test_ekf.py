import math
import statistics

from landerd.geometry import sub
from tests.hw.sim.worlds import ekf_in, world


def test_the_autopilot_estimates_nearly_the_truth() -> None:
    w = world(start={"altitude_m": 20.0})
    w.vehicle.order((2.0, 0.0, 0.0), 0.0)
    w.advance(5.0)
    ekf = ekf_in(w)
    errors = []
    for _ in range(200):
        t = w.t + 0.02
        said = ekf.estimate(t)
        assert said.t == t
        errors.append(sub(said.velocity, w.vehicle.velocity))
        position = sub(said.position, w.vehicle.position)
        assert math.hypot(position[0], position[1]) < 0.03  # 8 ms at 2 m/s, and noise
        assert -0.06 * 20.0 < position[2] < 0.02
    bias = math.hypot(*(statistics.mean(e[i] for e in errors) for i in range(2)))
    assert 0.005 < bias < 0.035


def test_the_barometer_reads_too_high_by_up_to_five_percent() -> None:
    scales = [
        ekf_in(w, seed).estimate(0.0).position[2] / w.vehicle.position[2]
        for seed, w in ((seed, world(seed, start={"altitude_m": 50.0})) for seed in range(20))
    ]
    assert min(scales) > 0.999
    assert 1.03 < max(scales) < 1.051
