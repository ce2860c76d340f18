"""`landerd sim --autopilot --takeoff` over a real socket, with no SITL at hand.

The stand-in, on a clock of its own and on the ground, says where it truly is as SITL does.
"""

import asyncio
import math
import random
import socket
import threading
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message
from hw.links import open_link
from hw.sim.options import SimOptions
from hw.sim.physics.world import World
from hw.sim.stand_in.autopilot import SimAutopilot
from hw.sim.stand_in.copter import CopterParameters
from landerd.config.files import config_dir
from landerd.config.models import VehicleSection
from landerd.drivers import read_configuration
from landerd.messages import Phase
from landerd.pad import Plate
from landerd.ports import ByteLink
from landerd.runtime.clock import run_slaved
from landerd.simulation.flight import Simulation
from landerd.simulation.sitl import SitlFlight
from tests.hw.sim.worlds import ekf_in
from tests.quick_clock import run_quickly
from tests.simulated import MODELLED

pytestmark = pytest.mark.long

LATITUDE, LONGITUDE, ALTITUDE_M = -353632621, 1491652374, 584.0
UNIT_M = 0.011131884502145034
GEAR_M = VehicleSection().gear_height_m
# Of its clock to the wall's. At 3 a busy computer, which stand-in and landerd share here, kept
# neither to it: landerd's data were stale before it ordered anything.
RATE = 1.5


class SitlLike(SimAutopilot):
    """The stand-in with SITL's messages."""

    def __init__(self, world: World, link: ByteLink) -> None:
        quick = CopterParameters(land_speed_mps=1.5)
        super().__init__(world, [link], ekf=ekf_in(world), rng=random.Random(1), parameters=quick)
        self._true = world.vehicle
        self._streams[mavlink.MAVLINK_MSG_ID_SYSTEM_TIME] = self._system_time
        self._streams[mavlink.MAVLINK_MSG_ID_SIM_STATE] = self._sim_state

    def _system_time(self, t: float) -> Message:
        return mavlink.MAVLink_system_time_message(0, self._boot_ms(t))

    def _sim_state(self, t: float) -> Message:
        v = self._true
        north, east, down = v.position
        shrink = math.cos(math.radians(1e-7 * LATITUDE))
        return mavlink.MAVLink_sim_state_message(
            *(1.0, 0.0, 0.0, 0.0),
            *(v.roll, v.pitch, v.yaw),
            *(0.0, 0.0, 0.0),
            *v.rates,
            *(0.0, 0.0, round(ALTITUDE_M - down - GEAR_M + 0.1, 2), 0.0, 0.0),
            *v.velocity,
            lat_int=int(LATITUDE + north / UNIT_M),
            lon_int=int(LONGITUDE + east / UNIT_M / shrink),
        )

    def _on_command(self, channel: "object", m: Message, t: float) -> int:
        if m.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            origin = (LATITUDE, LONGITUDE, round(1e3 * ALTITUDE_M))
            self._send_all(mavlink.MAVLink_gps_global_origin_message(*origin))
            return int(mavlink.MAV_RESULT_ACCEPTED)
        return super()._on_command(channel, m, t)  # type: ignore[arg-type]


@pytest.fixture
def url() -> Iterator[str]:
    """Run the stand-in on a loop of its own, on the ground; yield where it is to be called."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port: int = s.getsockname()[1]
    far = SimOptions.model_validate({"pad": {"position_m": [500, 500]}})
    world = World(far, VehicleSection(), Plate(south_m=0.6, north_m=0.6, west_m=0.6, east_m=0.6), 1)
    world.vehicle.start((31.0, 12.0, -GEAR_M), (0.0, 0.0), 0.0, (0.0, 0.0))
    world.vehicle.motors_off()
    listening, ended = threading.Event(), threading.Event()

    async def serve() -> None:
        link = open_link(f"tcpin:127.0.0.1:{port}")
        running = asyncio.create_task(SitlLike(world, link).run())
        while not ended.is_set():
            await asyncio.sleep(0.1)
            listening.set()
            assert not running.done()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        await link.close()

    thread = threading.Thread(target=lambda: run_quickly(serve(), rate=RATE))
    thread.start()
    listening.wait()
    yield f"tcp:127.0.0.1:{port}"
    ended.set()
    thread.join()


def near_the_pad(url: str, *overrides: str) -> SitlFlight:
    loaded = read_configuration(
        config_dir() / "default.yaml",
        overrides=[
            MODELLED,
            "sim.start.position_m=[-4.0, 0.0]",
            "sim.start.spread_m=0.0",
            "sim.start.heading_spread_deg=0.0",
            *overrides,
        ],
    )
    return SitlFlight(loaded, 1, url, take_off_m=3.0)


def test_faults_happen_to_what_passes_between_it_and_landerd_and_by_its_pilot(url: str) -> None:
    missing = "{fault: rc-missing, at: {phase: APPROACH}, for_s: 1.7}"
    loiter = "{fault: mode-loiter, at: {phase: APPROACH, after_s: 0.9}}"
    flight = near_the_pad(url, f"sim.faults=[{missing}, {loiter}]")
    speeds: list[float] = []

    async def script(simulation: Simulation) -> None:
        simulation.rules.on_order.append(lambda order: speeds.append(math.hypot(*order.velocity)))
        while simulation.faults.happened[1].began is None:
            await asyncio.sleep(0.05)
        while simulation.rules.guided:
            await asyncio.sleep(0.05)
        simulation.over = True

    run_slaved(flight.run(script))
    assert max(speeds) > 0.2
    assert speeds[-1] == 0.0  # RC went stale


def test_it_takes_off_comes_to_the_start_and_begins_to_land(url: str) -> None:
    flight = near_the_pad(url)
    begun: list[float] = []
    ended: list[float] = []

    async def script(simulation: Simulation) -> None:
        begun.append(math.dist(simulation.world.offset, (-4.0, 0.0)))
        while simulation.daemon.lander.phase is Phase.NOT_LANDING:
            await asyncio.sleep(0.05)
        simulation.over = True
        ended.append(asyncio.get_running_loop().time())

    run_slaved(flight.run(script))
    assert begun[0] < 0.6
    assert flight.simulation.score.first_sighting_t is not None
    assert not flight.truth.armed  # it was put down again,
    assert all(
        t < ended[0] + 0.2 for t in flight.simulation.rules.broken.values()
    )  # not by landerd
