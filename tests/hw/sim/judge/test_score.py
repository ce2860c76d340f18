import math

import pytest

from hw.sim.judge.score import Score
from hw.sim.judge.truth import Feet
from hw.sim.physics.world import World
from landerd.config.models import VehicleSection
from tests.hw.sim.worlds import PLATE, descend, over_pad, world

GEAR_M, FOOTPRINT_M = VehicleSection().gear_height_m, VehicleSection().footprint_m


def feet_of(w: World) -> Feet:
    return Feet(w, VehicleSection(), PLATE)


def score_of(w: World) -> Score:
    return Score(w, feet_of(w))


@pytest.mark.parametrize(
    ("east_m", "lifted_m", "landed"),
    [
        (0.0, 0.0, True),
        (0.0, 0.002, True),  # a gust takes the load off the springs of one side
        (0.0, 0.05, False),  # it lies on an edge
        (PLATE.east_m - 0.1, 0.0, False),
        (PLATE.east_m - 0.1, 0.002, False),
    ],
)
def test_landed_is_all_four_feet_on_the_plate(east_m: float, lifted_m: float, landed: bool) -> None:
    w = over_pad()
    score = score_of(w)
    vehicle, pad = w.vehicle, w.pad.position
    vehicle.yaw, vehicle.pitch, vehicle.roll = 0.0, 0.0, math.asin(lifted_m / FOOTPRINT_M[1])
    up = GEAR_M * math.cos(vehicle.roll) + 0.5 * lifted_m
    vehicle.position = (pad[0], pad[1] + east_m, pad[2] - up)
    vehicle.feet = (lifted_m == 0.0, True, lifted_m == 0.0, True)
    assert not score.landed  # the motors still turn
    vehicle.motors_off()
    assert score.landed is landed


def test_over_the_plate_without_a_foot_on_it_is_not_landed() -> None:
    w = over_pad()
    w.vehicle.motors_off()
    assert not score_of(w).landed


# ---- contact -----------------------------------------------------------------------------------


@pytest.mark.parametrize("speed_mps", [0.2, 0.5])
def test_contact_is_how_a_level_vehicle_sinks(speed_mps: float) -> None:
    w = over_pad()
    score = score_of(w)
    descend(w, speed_mps, 5.0)
    assert score.contact is not None
    assert score.contact.vertical_mps == pytest.approx(speed_mps, abs=0.05)
    assert score.contact.horizontal_mps < 0.05
    assert score.contact.error_m == pytest.approx(math.hypot(*w.offset), abs=0.05)
    assert score.contact.on_plate
    assert score.touch_and_climbs == 0


@pytest.mark.parametrize("roll_rate", [0.0, 1.0])
def test_a_foot_that_swings_down_touches_faster_than_the_vehicle_sinks(roll_rate: float) -> None:
    w = over_pad()
    vehicle = w.vehicle
    vehicle.velocity, vehicle.rates = (0.0, 0.0, 0.3), (roll_rate, 0.0, 0.0)
    vehicle.roll, vehicle.pitch, vehicle.yaw = 0.02, 0.0, 0.0  # the right feet are the lower ones
    w._record()
    w._steps += 1
    w._record()
    down = feet_of(w).touching_velocity()[2]
    assert down == pytest.approx(0.3 + 0.5 * FOOTPRINT_M[1] * roll_rate, abs=0.01)


def test_contact_is_relative_to_a_pad_that_drives_and_heaves() -> None:
    w = over_pad(pad={"speed_mps": 2.0, "heave_m": 0.3, "heave_hz": 0.2})
    score = score_of(w)
    before = w.relative_velocity
    while score.contact is None:
        before = w.relative_velocity
        w.vehicle.order((*w.pad.velocity[:2], 0.4), 0.0)
        w.advance(w.t + 0.0025)
    assert score.contact.vertical_mps == pytest.approx(before[2], abs=0.05)
    assert score.contact.horizontal_mps == pytest.approx(math.hypot(*before[:2]), abs=0.05)


def test_the_first_contact_counts_and_climbing_away_is_counted() -> None:
    w = over_pad()
    score = score_of(w)
    descend(w, 0.8, 1.6)
    first = score.contact
    assert first is not None
    assert first.vertical_mps > 0.5
    for times in (1, 2):
        w.vehicle.order((0.0, 0.0, -0.5), 0.0)
        w.advance(w.t + 2.5)
        assert w.height > 0.2
        assert score.touch_and_climbs == times
        descend(w, 0.3, w.t + 5.0)
        assert any(w.vehicle.feet)
    assert score.contact == first


def test_a_contact_beside_the_plate_is_scored_as_such() -> None:
    w = world(start={"altitude_m": 0.5, "position_m": [3.0, 0.0], "spread_m": 0.0, "bearings": 1})
    score = score_of(w)
    descend(w, 0.3, 5.0)
    assert score.contact is not None
    assert not score.contact.on_plate
    assert score.contact.error_m == pytest.approx(3.0, abs=0.2)


# ---- time and energy ---------------------------------------------------------------------------


def test_time_and_energy_count_from_the_first_sighting_within_18_m() -> None:
    far = world(start={"altitude_m": 20.0, "spread_m": 0.0})
    score = score_of(far)
    score.on_sighting(0.0)
    assert score.first_sighting_t is None
    w = over_pad()
    score = score_of(w)
    w.advance(0.5)
    spent_before = w.battery.energy_j
    score.on_sighting(0.45)
    w.advance(1.0)
    score.on_sighting(0.95)
    assert score.first_sighting_t == 0.45
    descend(w, 0.3, 5.0)
    assert score.disarm_t is None
    w.vehicle.motors_off()
    w.advance(6.0)
    assert score.disarm_t == pytest.approx(5.0, abs=0.03)
    spent = w.battery.energy_j - spent_before
    assert score.energy_j == pytest.approx(spent, rel=0.01)


def test_motors_that_stop_in_the_air_end_no_landing() -> None:
    w = over_pad(altitude_m=5.0)
    score = score_of(w)
    w.vehicle.motors_off()
    w.advance(0.1)
    assert score.disarm_t is None


# ---- where it will touch -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("north_mps", "misses"), [(0.0, False), (0.2, False), (2.0, True), (-2.0, True)]
)
def test_whether_the_pad_will_be_missed_is_told_from_where_it_drifts(
    north_mps: float, misses: bool
) -> None:
    w = over_pad(altitude_m=0.5)
    w.vehicle.velocity = (north_mps, 0.0, 0.3)
    truth = feet_of(w).truth()
    assert truth.misses is misses
    assert truth.slip == pytest.approx(abs(north_mps))
    assert not truth.on_plate


@pytest.mark.parametrize(("beside", "slip_mps"), [(False, 1.0), (True, 0.0)])
def test_a_vehicle_on_the_ground_does_not_slide_across_a_driving_pad(
    beside: bool, slip_mps: float
) -> None:
    w = over_pad(pad={"speed_mps": 1.0})
    vehicle, pad = w.vehicle, w.pad.position
    vehicle.position = (pad[0], pad[1] + (1.0 if beside else 0.0), pad[2] - GEAR_M)
    vehicle.velocity = (0.0, 0.0, 0.0)
    vehicle.feet, vehicle.on_pad = (True,) * 4, not beside
    assert feet_of(w).truth().slip == pytest.approx(slip_mps)
