"""The fake ground station brings the vehicle on its way and then leaves it to landerd."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from hw.autopilots.arducopter import Mode
from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links.memory import memory_pair
from hw.sim.stand_in.ground_station import GroundStation
from landerd.geometry import Vec3
from landerd.messages import Setpoint, Severity, StatusText
from landerd.runtime.clock import run_virtual
from tests.hw.flight import PlainAirframe, plain_autopilot


class Scene:
    """The stand-in, the ground station and landerd's driver, on their links."""

    def __init__(
        self,
        airframe: PlainAirframe,
        *,
        flying: bool,
        destination: Vec3 | None,
        speed_mps: float | None = None,
    ) -> None:
        self.airframe = airframe
        self.ground_link, far = memory_pair()
        link, driver_far = memory_pair()
        self.autopilot = plain_autopilot(airframe, [far, driver_far], flying=flying)
        self.station = GroundStation(self.ground_link, destination=destination, speed_mps=speed_mps)
        self.driver = MavlinkAutopilot(link)
        self.sent: list[Message] = []
        codec = MavlinkCodec(1, 1)
        self.ground_link.tap = lambda t, data: self.sent.extend(codec.decode(data))

    def play(self, script: Callable[["Scene"], Awaitable[None]]) -> None:
        async def main() -> None:
            await self.driver.open()
            tasks = [
                asyncio.create_task(self.autopilot.run()),
                asyncio.create_task(self.station.run()),
            ]
            await script(self)
            for task in tasks:
                assert not task.done()
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

        run_virtual(main())

    @property
    def targets(self) -> list[Message]:
        return [m for m in self.sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]


def test_it_flies_the_vehicle_to_the_destination_with_one_target() -> None:
    async def script(s: Scene) -> None:
        await asyncio.sleep(30.0)
        assert s.airframe.position == pytest.approx((20.0, 10.0, -10.0), abs=0.1)
        assert len(s.targets) == 1
        heartbeats = [m for m in s.sent if m.get_type() == "HEARTBEAT"]
        assert len(heartbeats) == pytest.approx(30, abs=1)
        assert heartbeats[0].get_srcSystem() == 255

    Scene(PlainAirframe(), flying=True, destination=(20.0, 10.0, -10.0)).play(script)


def test_it_follows_a_fast_pad_at_the_pads_speed() -> None:
    async def script(s: Scene) -> None:
        await asyncio.sleep(5.0)
        assert s.airframe.velocity[0] == pytest.approx(15.0)
        assert len(s.targets) == 1

    Scene(PlainAirframe(), flying=True, destination=(5e3, 0.0, -10.0), speed_mps=15.0).play(script)


def test_it_lets_landerd_take_over() -> None:
    async def script(s: Scene) -> None:
        await asyncio.sleep(5.0)
        assert s.airframe.velocity[0] > 1.0
        for _ in range(100):
            s.driver.fly(Setpoint((0.0, -0.5, 0.0), 0.0))
            await asyncio.sleep(0.05)
            assert s.airframe.velocity == pytest.approx((0.0, -0.5, 0.0))

    Scene(PlainAirframe(), flying=True, destination=(200.0, 0.0, -10.0)).play(script)


def test_it_takes_off_and_is_in_the_air_then() -> None:
    async def script(s: Scene) -> None:
        await s.station.set_mode(Mode.GUIDED)
        await s.station.take_off(8.0)
        assert s.airframe.position[2] == pytest.approx(-8.0, abs=0.2)
        s.station.send_to((15.0, 0.0, -8.0))
        await asyncio.sleep(20.0)
        assert s.airframe.position == pytest.approx((15.0, 0.0, -8.0), abs=0.1)

    ground: Vec3 = (0.0, 0.0, 0.0)
    Scene(PlainAirframe(ground), flying=False, destination=None).play(script)


def test_it_shows_what_landerd_and_the_autopilot_tell_the_pilot() -> None:
    async def script(s: Scene) -> None:
        await asyncio.sleep(1.0)
        s.driver.tell(StatusText(Severity.NOTICE, "Pad in sight"))
        await asyncio.sleep(1.0)
        s.autopilot.pilot.lose()
        await asyncio.sleep(2.0)
        told = [(text.component, text.text) for text in s.station.texts]
        assert told == [(191, "Pad in sight"), (1, "Radio Failsafe")]

    Scene(PlainAirframe(), flying=True, destination=None).play(script)
