"""Vehicles and pads other than the reference's, each option against its formula."""

import itertools
import math
from random import Random

import pytest

from hw.sim.gimbals.mount import Play
from hw.sim.options import PadOptions, ResponseOptions
from hw.sim.physics.battery import Battery
from hw.sim.physics.ground_effect import GroundEffect
from hw.sim.physics.pad_motion import PadMotion
from hw.sim.physics.response import STEP_S, HorizontalResponse, VerticalResponse
from landerd.pad import Plate
from tests.hw.sim.worlds import world


def forward(options: ResponseOptions, seconds: float = 4.0) -> list[float]:
    response, speeds = HorizontalResponse(options), []
    for _ in range(round(seconds / STEP_S)):
        response.step(3.0, 0.0)
        speeds.append(response.vn)
    return speeds


def test_the_delay_comes_before_everything_else() -> None:
    plain, late = forward(ResponseOptions()), forward(ResponseOptions(delay_s=0.1))
    steps = round(0.1 / STEP_S)
    assert late[:steps] == [0.0] * steps
    assert late[steps:] == plain[:-steps]


def test_acceleration_and_jerk_are_bounded_as_asked() -> None:
    speeds = forward(ResponseOptions(acceleration_mps2=1.0, jerk_mps3=2.0))
    accelerations = [(b - a) / STEP_S for a, b in itertools.pairwise(speeds)]
    assert max(accelerations) == pytest.approx(1.0, rel=0.15)  # the lag overshoots a little
    down = VerticalResponse(ResponseOptions(vertical_acceleration_mps2=2.0))
    reached = []
    for _ in range(400):
        down.step(1.5)
        reached.append(down.a)
    assert max(reached) > 1.3


def test_a_softer_tuning_answers_later() -> None:
    def time_to_half(bandwidth: float) -> float:
        return next(
            i for i, v in enumerate(forward(ResponseOptions(bandwidth=bandwidth))) if v > 1.5
        )

    assert time_to_half(0.6) > time_to_half(1.0) > time_to_half(1.5)


def test_power_goes_with_mass_to_the_seven_sixths() -> None:
    light, heavy = Battery(1.0), Battery(8.0)
    for battery in (light, heavy):
        battery.step(True, 1.0, 0.0)
    assert heavy.power_w / light.power_w == pytest.approx(8.0 ** (7.0 / 6.0))


def test_a_lean_limit_is_the_vehicles_own() -> None:
    w = world(airframe={"angle_max_deg": 20.0})
    w.vehicle.order((15.0, 0.0, 0.0), 0.0)
    w.advance(6.0)
    assert math.degrees(abs(w.vehicle.pitch)) == pytest.approx(20.0, abs=1.0)


def test_ground_effect_fades_with_the_height_and_is_taken_back() -> None:
    pad = PadMotion(PadOptions(), Plate(north_m=1, south_m=1, east_m=1, west_m=1), Random(1)).at(
        0.0
    )
    down = pad.position[2]

    def push(height_m: float) -> float:
        return GroundEffect(0.1).step((0.0, 0.0, down - 0.2 - height_m), pad)

    assert push(0.0) == pytest.approx(0.981, rel=0.01)
    assert push(0.25) == pytest.approx(0.981 / 4.0, rel=0.01)
    effect = GroundEffect(0.1)
    for _ in range(round(3.0 / STEP_S)):
        left = effect.step((0.0, 0.0, down - 0.2), pad)
    assert left < 0.06


def test_a_braking_pad_comes_to_a_stand_where_its_deceleration_says() -> None:
    plate = Plate(north_m=1, south_m=1, east_m=1, west_m=1)
    options = PadOptions(
        speed_mps=4.0, course_deg=0.0, brake_mps2=2.0, brake_after_s=5.0, position_m=(0.0, 0.0)
    )
    motion = PadMotion(options, plate, Random(1))
    assert motion.at(5.0).position[0] == pytest.approx(20.0)
    assert motion.at(6.0).velocity[0] == pytest.approx(2.0)
    assert motion.at(7.0).position[0] == pytest.approx(24.0)
    assert motion.at(9.0).position[0] == pytest.approx(24.0)
    assert motion.at(9.0).velocity[:2] == (0.0, 0.0)


def test_backlash_lets_one_side_stay_until_the_play_is_used_up() -> None:
    play = Play(0.02, 0.0)
    assert play.follow(0.005) == 0.0
    assert play.follow(0.05) == pytest.approx(0.04)
    assert play.follow(0.045) == pytest.approx(0.04)
    assert play.follow(0.0) == pytest.approx(0.01)


def test_the_vehicle_is_built_where_the_options_say() -> None:
    from hw.sim.options import BuildOptions
    from hw.sim.physics.world import BuiltAirframe, as_built

    believed = BuiltAirframe((0.1, 0.0, 0.04), 0.2, (0.44, 0.26))
    built = as_built(
        believed, BuildOptions(camera_offset_error_m=(0.02, -0.01, 0.0), gear_height_error_m=0.01)
    )
    assert built.camera_offset_m == pytest.approx((0.12, -0.01, 0.04))
    assert built.gear_height_m == pytest.approx(0.21)
