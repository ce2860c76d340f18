import math

import pytest

from hw.sim.judge.score import Score
from landerd.config.models import VehicleSection
from tests.hw.sim.worlds import PLATE, over_pad

GEAR_M, FOOTPRINT_M = VehicleSection().gear_height_m, VehicleSection().footprint_m


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
    world = over_pad()
    score = Score(world, VehicleSection(), PLATE)
    vehicle, pad = world.vehicle, world.pad.position
    vehicle.yaw, vehicle.pitch, vehicle.roll = 0.0, 0.0, math.asin(lifted_m / FOOTPRINT_M[1])
    up = GEAR_M * math.cos(vehicle.roll) + 0.5 * lifted_m
    vehicle.position = (pad[0], pad[1] + east_m, pad[2] - up)
    vehicle.feet = (lifted_m == 0.0, True, lifted_m == 0.0, True)
    assert not score.landed  # the motors still turn
    vehicle.motors_off()
    assert score.landed is landed


def test_over_the_plate_without_a_foot_on_it_is_not_landed() -> None:
    world = over_pad()
    world.vehicle.motors_off()
    assert not Score(world, VehicleSection(), PLATE).landed
