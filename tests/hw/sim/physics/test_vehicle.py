import math
import statistics

import pytest

from bench.step_response import MEASURED, TOLERANCE, answer
from hw.sim.physics.response import STEP_S, DampedYawResponse
from hw.sim.physics.world import World
from tests.hw.sim.worlds import world


def tilt_deg(w: World) -> float:
    v = w.vehicle
    return math.degrees(math.acos(math.cos(v.roll) * math.cos(v.pitch)))


@pytest.mark.parametrize("name", MEASURED)
def test_answers_a_step_as_the_measured_copter(name: str) -> None:
    axis, start, order, measured = MEASURED[name]
    assert answer(axis, start, order) == pytest.approx(measured, abs=TOLERANCE)


def test_the_whole_vehicle_flies_a_step_of_velocity() -> None:
    w = world()
    w.vehicle.order((0.0, 1.0, 0.0), 0.0)
    most_tilt = 0.0
    for _ in range(60):
        w.advance(w.t + 0.01)
        most_tilt = max(most_tilt, tilt_deg(w))
    assert w.vehicle.velocity[1] == pytest.approx(0.501, abs=0.06)
    w.advance(2.0)
    assert w.vehicle.velocity[1] == pytest.approx(0.951, abs=0.06)
    assert most_tilt == pytest.approx(9.0, abs=1.5)


def test_a_damped_vehicle_turns_without_overshoot() -> None:
    turn = DampedYawResponse()
    rates = []
    for _ in range(round(1.0 / STEP_S)):
        turn.step(math.radians(30.0))
        rates.append(math.degrees(turn.rate))
    assert rates[round(0.3 / STEP_S)] > 0.85 * 30.0
    assert max(rates) <= 30.001


def test_yaw_rate_is_limited_to_sixty_degrees_a_second() -> None:
    w = world(yaw_response="damped")
    w.vehicle.order((0.0, 0.0, 0.0), math.radians(90.0))
    w.advance(2.0)
    assert math.degrees(w.vehicle.rates[2]) == pytest.approx(60.0, abs=0.5)


@pytest.mark.parametrize(
    ("wind_mps", "order_mps", "expected_deg"),
    [(5.0, 0.0, 11.5), (10.0, 0.0, 28.9), (5.0, -1.0, 14.8), (5.0, 1.0, 8.5)],
)
def test_leans_against_the_air_as_measured(
    wind_mps: float, order_mps: float, expected_deg: float
) -> None:
    w = world(wind={"speed_mps": wind_mps, "from_deg": 180.0})  # blows to the north
    w.vehicle.order((order_mps, 0.0, 0.0), 0.0)
    w.advance(15.0)
    assert tilt_deg(w) == pytest.approx(expected_deg, abs=1.0)
    assert w.vehicle.velocity[0] == pytest.approx(order_mps, abs=0.03)


def test_leans_with_the_nose_into_the_wind() -> None:
    w = world(wind={"speed_mps": 5.0, "from_deg": 0.0})  # from ahead
    w.advance(1.0)
    assert math.degrees(w.vehicle.pitch) == pytest.approx(-11.5, abs=1.0)
    assert math.degrees(w.vehicle.roll) == pytest.approx(0.0, abs=0.3)


def test_drifts_when_the_wind_needs_more_lean_than_it_may() -> None:
    w = world(wind={"speed_mps": 12.0, "from_deg": 180.0})
    w.advance(10.0)
    assert tilt_deg(w) == pytest.approx(30.0, abs=0.1)
    assert w.vehicle.velocity[0] > 1.0


def test_a_fast_vehicle_holds_where_the_default_drifts() -> None:
    w = world(vehicle="fast", wind={"speed_mps": 20.0, "from_deg": 180.0})
    w.advance(10.0)
    assert tilt_deg(w) == pytest.approx(30.0, abs=0.5)
    assert w.vehicle.velocity[0] == pytest.approx(0.0, abs=0.03)


def test_a_gust_pushes_it_away_and_it_comes_back() -> None:
    # One gust of 5 m/s that lasts long: its rise is slower than the measured step's.
    w = world(wind={"gust_mps": 5.0, "gust_s": 4.0})
    away = 0.0
    start = w.vehicle.position
    for _ in range(400):
        w.advance(w.t + 0.02)
        away = max(away, math.dist(start[:2], w.vehicle.position[:2]))
    assert 0.2 < away < 0.9


def test_hovers_as_quietly_as_measured() -> None:
    w = world()
    positions, speeds = [], []
    for _ in range(1500):
        w.advance(w.t + 0.02)
        positions.append(w.vehicle.position[0])
        speeds.append(w.vehicle.velocity[0])
    assert 0.002 < statistics.pstdev(positions) < 0.012  # measured 0.006
    assert 0.002 < statistics.pstdev(speeds) < 0.012  # measured 0.006


@pytest.mark.parametrize(
    ("velocity", "expected_w"),
    [((0.0, 0.0, 0.0), 354.0), ((0.0, 0.0, -1.0), 363.0), ((0.0, 0.0, 1.0), 344.0)],
)
def test_draws_the_measured_power(velocity: tuple[float, float, float], expected_w: float) -> None:
    w = world(start={"altitude_m": 40.0})
    w.vehicle.order(velocity, 0.0)
    w.advance(5.0)
    before = w.battery.energy_j
    w.advance(15.0)
    assert (w.battery.energy_j - before) / 10.0 == pytest.approx(expected_w, abs=2.0)


def test_falls_without_motors() -> None:
    w = world(start={"altitude_m": 20.0})
    w.advance(1.0)
    height = -w.vehicle.position[2]
    w.vehicle.motors_off()
    w.advance(2.0)
    assert height + w.vehicle.position[2] == pytest.approx(0.5 * 9.80665, rel=0.02)
    assert w.battery.power_w == 0.0


def test_after_a_level_attitude_it_leans_no_faster_than_an_airframe_turns() -> None:
    # To hold 8 m/s of wind it leans by 20 degrees; at once, feet on a pad would throw it up.
    w = world(wind={"speed_mps": 8.0})
    w.advance(1.0)
    before = tilt_deg(w)
    w.vehicle.order((0.0, 0.0, 0.3), 0.0, level=True)
    w.advance(1.5)
    w.vehicle.order((0.0, 0.0, 0.3), 0.0)
    tilt, fastest = tilt_deg(w), 0.0
    while w.t < 3.0:
        w.advance(w.t + STEP_S)
        now = tilt_deg(w)
        tilt, fastest = now, max(fastest, abs(now - tilt) / STEP_S)
    assert before > 10.0
    assert fastest < 600.0  # deg/s; a multicopter turns so fast
    assert tilt > 0.7 * before
