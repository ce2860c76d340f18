import math

import pytest

from hw.sim.judge.truth import Feet
from landerd.config.models import VehicleSection
from tests.hw.sim.worlds import PLATE, over_pad

GEAR_M = VehicleSection().gear_height_m


@pytest.mark.parametrize(
    ("north_m", "height_m"),
    # Down a slope of 10 degrees to the north: 0.2 m over the landing point is more further down.
    [(0.0, 0.2), (0.5, 0.2 + 0.5 * math.tan(math.radians(10.0))), (5.0, 0.38), (20.0, 0.38)],
)
def test_its_height_is_over_the_plate_as_far_as_there_is_one(
    north_m: float, height_m: float
) -> None:
    w = over_pad(pad={"tilt_deg": 10.0})
    vehicle, (north, east, down) = w.vehicle, w.pad.position
    vehicle.yaw = vehicle.pitch = vehicle.roll = 0.0
    vehicle.position = (north + north_m, east, down - 0.2 - GEAR_M)
    truth = Feet(w, VehicleSection(), PLATE).truth()
    assert truth.height == pytest.approx(height_m, abs=0.01)


def test_the_lowest_foot_of_a_leaning_vehicle_is_below_the_feets_centre() -> None:
    w = over_pad()
    vehicle, (north, east, down) = w.vehicle, w.pad.position
    vehicle.position = (north, east, down - 1.0)
    vehicle.yaw = vehicle.roll = 0.0
    for pitch_deg in (0.0, 20.0):
        vehicle.pitch = math.radians(pitch_deg)
        lean_m = 0.5 * VehicleSection().footprint_m[0] * math.sin(vehicle.pitch)
        truth = Feet(w, VehicleSection(), PLATE).truth()
        assert truth.lean_m == pytest.approx(lean_m, abs=1e-6)
        assert truth.tilt == pytest.approx(math.radians(pitch_deg), abs=1e-6)
