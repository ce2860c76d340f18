from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from landerd.calibration.vehicle import Response, ResponseError, Stretch, answer, fit, stretches
from landerd.campaigns.search import minimised
from landerd.flightlog.reader import read_log
from landerd.messages import LocalPosition, Setpoint

GOLDEN = Path(__file__).parents[1] / "golden"


def flown(response: Response, steps: list[float]) -> Stretch:
    """Return what a vehicle flies that is ordered a velocity to the north every 3 s."""
    times = np.arange(0.0, 3.0 * len(steps), 0.025).tolist()
    orders = [(steps[int(t / 3.0)], 0.0) for t in times]
    stretch = Stretch(times, orders, times, [(0.0, 0.0)] * len(times))
    stretch.flown = [(float(n), float(e)) for n, e in answer(response, stretch)]
    return stretch


@pytest.mark.parametrize(
    "vehicle",
    [Response(0.02, 5.0, 12.0, 14.0), Response(0.0, 2.5, 5.0, 9.0), Response(0.2, 1.2, 2.0, 5.0)],
    ids=["agile", "reference", "sluggish"],
)
def test_a_vehicles_response_is_fitted_from_its_flight(vehicle: Response) -> None:
    pytest.importorskip("cmaes")
    found = fit([flown(vehicle, [0.0, 8.0, -2.0, -1.0])], minimised)
    assert found.rms_mps < 0.02
    assert found.limits_reached
    late_s = vehicle.delay_s + vehicle.lag_s  # a little of both looks alike
    assert found.response.delay_s + found.response.lag_s == pytest.approx(late_s, abs=0.05)
    assert found.response.acceleration_mps2 == pytest.approx(vehicle.acceleration_mps2, rel=0.1)
    assert found.response.jerk_mps3 == pytest.approx(vehicle.jerk_mps3, rel=0.25)


def test_a_gentle_flight_does_not_reveal_the_limits_of_acceleration() -> None:
    pytest.importorskip("cmaes")
    ramp = [0.4 * i for i in range(4)]
    found = fit([flown(Response(0.05, 5.0, 10.0, 9.0), ramp)], minimised)
    assert not found.limits_reached
    assert found.response.acceleration_mps2 < 2.5


def test_the_stretch_flown_by_landerds_orders_is_found_in_a_log() -> None:
    (stretch,) = stretches(read_log(GOLDEN / "moving-pad.mcap"))
    assert stretch.orders_t[-1] - stretch.orders_t[0] > 4.0
    assert len(stretch.flown) > 100


def test_a_flight_that_only_hovers_is_refused() -> None:
    hovers = read_log(GOLDEN / "moving-pad.mcap")
    for step in hovers.steps:
        if isinstance(step.message, LocalPosition):
            step.message = replace(step.message, velocity=(0.0, 0.0, 0.0))
    with pytest.raises(ResponseError, match="found no 4 s of landerd's orders"):
        fit(stretches(hovers), minimised)


def test_a_speed_beyond_the_vehicles_power_is_not_taken_for_a_slow_response() -> None:
    """Ordered 8 m/s it flies 3, and no faster for 3 s: its lean and the air allow no more."""
    log = read_log(GOLDEN / "moving-pad.mcap")
    (whole,) = stretches(log)
    until = whole.orders_t[0] + 3.0
    for step in log.steps:
        if step.now < until:
            step.commands[:] = [
                replace(c, velocity=(8.0, 0.0, 0.0)) if isinstance(c, Setpoint) else c
                for c in step.commands
            ]
        if isinstance(step.message, LocalPosition) and step.message.t < until:
            step.message = replace(step.message, velocity=(3.0, 0.0, 0.0))
    assert all((8.0, 0.0) not in stretch.orders for stretch in stretches(log))
