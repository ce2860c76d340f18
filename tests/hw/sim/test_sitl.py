"""The world around a real autopilot's vehicle: what SIM_STATE says becomes what the camera sees."""

import asyncio
import math
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links.memory import memory_pair
from hw.sim.options import SimOptions
from hw.sim.sitl import TRUTH_HZ, SitlPilot, SitlWorld, Truth
from hw.sim.stand_in.ground_station import GroundStation
from landerd.config.models import VehicleSection
from landerd.geometry import Vec3
from landerd.pad import Plate
from landerd.runtime.clock import run_virtual

ORIGIN = (-353632621, 1491652374, 584.0)  # 1e-7 degrees, m
UNIT_M = 0.011131884502145034  # 1e-7 degrees of latitude
STANDS_M = 0.1  # how high SITL's vehicle stands above its ground
BOOT_S = 60.0  # the autopilot has been up for so long at the loop's 0 s


class Sitl:
    """Reports a vehicle's state in the coarse steps of SITL's messages."""

    def __init__(self) -> None:
        link, _ = memory_pair()
        self.truth = Truth(link, 1, lambda boot_s: boot_s - BOOT_S)
        self._codec = MavlinkCodec(1, 1)
        north, east, altitude = ORIGIN
        self.say(mavlink.MAVLink_gps_global_origin_message(north, east, round(1e3 * altitude)))

    def say(self, message: Message) -> None:
        (received,) = self._codec.decode(self._codec.encode(message))
        self.truth.take(received)

    def at(self, t: float, position: Vec3, velocity: Vec3, yaw: float = 0.0) -> None:
        latitude, longitude, altitude = ORIGIN
        shrink = math.cos(math.radians(1e-7 * latitude))
        self.say(mavlink.MAVLink_system_time_message(0, round(1e3 * (t + BOOT_S))))
        self.say(
            mavlink.MAVLink_sim_state_message(
                *(1.0, 0.0, 0.0, 0.0),
                *(0.0, 0.0, yaw),
                *(0.0,) * 6,
                *(0.0, 0.0, round(altitude - position[2], 2), 0.0, 0.0),
                *velocity,
                lat_int=int(latitude + position[0] / UNIT_M),
                lon_int=int(longitude + position[1] / UNIT_M / shrink),
            )
        )


def _world(sitl: Sitl, speed_mps: float = 0.0) -> SitlWorld:
    options = SimOptions.model_validate({"pad": {"speed_mps": speed_mps, "position_m": [5, 0]}})
    plate = Plate(south_m=0.6, north_m=0.6, west_m=0.6, east_m=0.6)
    return SitlWorld(options, VehicleSection(), plate, 1, sitl.truth)


def test_a_steady_flight_is_smooth_though_positions_come_in_centimetres() -> None:
    sitl = Sitl()
    v = (0.7, -0.2, 0.1)
    for i in range(500):
        t = i / TRUTH_HZ
        sitl.at(t, (v[0] * t, v[1] * t, -10.0 + v[2] * t), v)
    for t in (4.0, 4.333, 4.9, 5.02):  # the last one is carried on
        assert sitl.truth.at(t).position == pytest.approx(
            (v[0] * t, v[1] * t, -10.0 + v[2] * t), abs=0.012
        )
    steps = [sitl.truth.at(4.0 + 0.01 * i).position[0] for i in range(80)]
    assert [b - a for a, b in pairwise(steps)] == pytest.approx([0.01 * v[0]] * 79, abs=2e-4)


def test_heading_is_interpolated_the_short_way_round() -> None:
    sitl = Sitl()
    sitl.at(1.0, (0.0, 0.0, -5.0), (0.0, 0.0, 0.0), yaw=math.pi - 0.01)
    sitl.at(1.1, (0.0, 0.0, -5.0), (0.0, 0.0, 0.0), yaw=-math.pi + 0.01)
    assert abs(sitl.truth.at(1.05).yaw) == pytest.approx(math.pi)


def test_the_camera_sees_the_vehicle_where_it_was_at_the_exposure() -> None:
    sitl = Sitl()
    world = _world(sitl)
    for i in range(200):
        sitl.at(i / TRUTH_HZ, (0.02 * i, 0.0, -5.0), (2.0, 0.0, 0.0))
    world.begin(1.0)
    world.advance(1.9)
    seen = world.snapshot(1.555).vehicle.position
    assert seen == pytest.approx((3.11, 0.0, -5.0 - 0.1), abs=0.012)


def _come_down(sitl: Sitl, world: SitlWorld, north_mps: float, east_m: float = 0.1) -> None:
    """Sink at 0.3 m/s from 0.6 m on to SITL's ground, and stand there."""
    lands_t = (0.6 - STANDS_M) / 0.3
    for i in range(400):
        t = i / TRUTH_HZ
        flown = min(t, lands_t)
        place = (5.0 + north_mps * flown, east_m, -0.6 + 0.3 * flown)
        sitl.at(t, place, (north_mps, 0.0, 0.3) if t < lands_t else (0.0, 0.0, 0.0))
        if i == 0:
            world.begin(0.0)
        world.advance(t)


def test_it_touches_down_on_sitls_ground_at_the_speed_it_had() -> None:
    sitl = Sitl()
    world = _world(sitl)
    _come_down(sitl, world, 0.0)
    touchdown = world.vehicle.touchdown
    assert touchdown is not None
    assert touchdown.t == pytest.approx(0.5 / 0.3, abs=0.15)
    assert touchdown.velocity == pytest.approx((0.0, 0.0, 0.3), abs=0.02)
    assert all(world.vehicle.feet)
    assert world.height == pytest.approx(0.0, abs=0.02)
    assert world.offset == pytest.approx((0.0, 0.1), abs=0.012)


@pytest.mark.parametrize(("east_m", "on_pad"), [(0.4, True), (0.55, False), (2.0, False)])
def test_it_stands_on_the_pad_only_with_all_feet_on_the_plate(east_m: float, on_pad: bool) -> None:
    sitl = Sitl()
    world = _world(sitl)
    _come_down(sitl, world, 0.0, east_m)
    assert all(world.vehicle.feet)
    assert world.vehicle.on_pad is on_pad


def test_contact_with_a_driving_pad_is_judged_relative_to_it() -> None:
    sitl = Sitl()
    world = _world(sitl, speed_mps=1.0)
    _come_down(sitl, world, 0.9)
    assert world.vehicle.touchdown is not None
    assert world.vehicle.touchdown.velocity == pytest.approx((-0.1, 0.0, 0.3), abs=0.02)


def test_its_pilot_switches_off_the_simulated_radio_and_what_stands_for_its_switches() -> None:
    async def sent() -> list[Message]:
        near, far = memory_pair()
        await far.open()
        station = GroundStation(near)
        serving = asyncio.create_task(station.serve())
        station.set_rc(11, 1900)
        await asyncio.sleep(0.1)
        await far.read()
        pilot = SitlPilot(station)
        pilot.lose_radio()
        await asyncio.sleep(2.0)
        pilot.restore_radio()
        await asyncio.sleep(1.0)
        serving.cancel()
        return MavlinkCodec(1, 1).decode(await far.read())

    messages = run_virtual(sent())
    changes = [m for m in messages if m.get_type() == "PARAM_SET"]
    assert [(m.param_id, m.param_value) for m in changes] == [
        ("SIM_RC_FAIL", 1),
        ("SIM_RC_FAIL", 0),
    ]
    restored = messages.index(changes[1])
    overrides = [i for i, m in enumerate(messages) if m.get_type() == "RC_CHANNELS_OVERRIDE"]
    assert overrides
    assert min(overrides) > restored
