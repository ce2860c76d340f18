"""landerd's orders, as the stand-in and the vehicle receive them."""

import asyncio
import functools
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from landerd.messages import PressDown, Setpoint, Severity, StatusText
from landerd.runtime.clock import run_virtual
from tests.hw.autopilots.scenes import GUIDED, fly, sent
from tests.hw.flight import Flight, PlainAirframe


def test_a_set_point_says_velocity_and_yaw_rate_in_local_ned() -> None:
    async def scene(f: Flight) -> None:
        await f.client.mode(GUIDED)
        messages = sent(f)
        f.driver.fly(Setpoint((1.0, -2.0, 0.5), 0.25))
        (m,) = (m for m in messages if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED")
        assert (m.get_srcSystem(), m.get_srcComponent()) == (1, 191)
        assert (m.target_system, m.target_component) == (1, 1)
        assert (m.type_mask, m.coordinate_frame) == (1479, 1)
        assert (m.vx, m.vy, m.vz, m.yaw_rate) == (1.0, -2.0, 0.5, 0.25)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity == pytest.approx((1.0, -2.0, 0.5))
        assert f.airframe.yaw_rate == pytest.approx(0.25)

    fly(scene)


def test_pressing_down_is_a_level_attitude_of_this_heading_without_thrust() -> None:
    async def scene(f: Flight) -> None:
        await f.client.mode(GUIDED)
        messages = sent(f)
        f.driver.press_down(PressDown(-1.0))
        (m,) = (m for m in messages if m.get_type() == "SET_ATTITUDE_TARGET")
        assert (m.get_srcSystem(), m.get_srcComponent()) == (1, 191)
        assert (m.target_system, m.target_component) == (1, 1)
        assert (m.type_mask, m.thrust) == (7, 0.0)
        assert m.q == pytest.approx((math.cos(0.5), 0.0, 0.0, -math.sin(0.5)))
        await asyncio.sleep(0.02)
        assert f.airframe.velocity == (0.0, 0.0, 1.5)

    fly(scene)


def test_pressing_down_without_a_heading_is_refused_and_counted() -> None:
    async def scene(f: Flight) -> None:
        messages = sent(f)
        f.driver.press_down(PressDown(math.nan))
        assert messages == []
        assert sum(f.driver.counters.values()) == 1

    fly(scene)


def test_in_body_ned_the_vehicle_flies_the_same_way() -> None:
    async def scene(f: Flight) -> None:
        await f.client.mode(GUIDED)
        messages = sent(f)
        f.driver.fly(Setpoint((1.5, -2.0, 0.5), 0.0))
        assert messages[-1].coordinate_frame == 8
        assert (messages[-1].vx, messages[-1].vy) != pytest.approx((1.5, -2.0), abs=0.1)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity == pytest.approx((1.5, -2.0, 0.5), abs=1e-3)

    fly(scene, lambda: Flight(PlainAirframe(yaw=0.7), setpoint_frame="body_ned"))


def test_while_yawing_local_ned_keeps_its_course_and_body_ned_drifts() -> None:
    """Therefore local_ned is the default: a body set-point is turned by a later heading."""
    sideways: dict[str, float] = {}
    for frame in ("local_ned", "body_ned"):

        async def scene(f: Flight, frame: str = frame) -> None:
            await f.client.mode(GUIDED)
            f.driver_link.faults.delay_s = f.autopilot_link.faults.delay_s = 0.02
            await asyncio.sleep(0.5)
            for _ in range(200):  # 5 s at 2 m/s north, turning at 30 degrees a second
                f.driver.fly(Setpoint((2.0, 0.0, 0.0), math.radians(30.0)))
                await asyncio.sleep(0.025)
            sideways[frame] = f.airframe.position[1]

        fly(scene, functools.partial(Flight, setpoint_frame=frame))
    assert abs(sideways["local_ned"]) < 0.01
    assert abs(sideways["body_ned"]) > 0.05


def test_in_body_ned_nothing_is_sent_while_the_heading_is_unknown() -> None:
    async def main() -> None:
        async with Flight(setpoint_frame="body_ned") as f:
            await f.driver.open()
            messages = sent(f)
            f.driver.fly(Setpoint((1.0, 0.0, 0.0), 0.0))
            assert messages == []
            assert sum(f.driver.counters.values()) == 1

    run_virtual(main())


@pytest.mark.parametrize(
    "setpoint",
    [
        Setpoint((math.nan, 0.0, 0.0), 0.0),
        Setpoint((0.0, 0.0, math.inf), 0.0),
        Setpoint((0.0, 0.0, 0.0), math.nan),
        Setpoint((1e300, 0.0, 0.0), 0.0),
    ],
)
def test_a_set_point_that_is_not_finite_is_refused_and_counted(setpoint: Setpoint) -> None:
    async def scene(f: Flight) -> None:
        messages = sent(f)
        f.driver.fly(setpoint)
        assert messages == []
        assert sum(f.driver.counters.values()) == 1

    fly(scene)


def test_the_heartbeat_is_that_of_an_onboard_computer() -> None:
    async def scene(f: Flight) -> None:
        messages = sent(f)
        f.driver.heartbeat()
        (m,) = messages
        assert (m.get_srcSystem(), m.get_srcComponent()) == (1, 191)
        assert (m.type, m.autopilot) == (18, 8)

    fly(scene)


def test_the_pilot_reads_at_most_50_characters() -> None:
    async def scene(f: Flight) -> None:
        f.driver.tell(StatusText(Severity.WARNING, "Pad lost: holding, then climbing " + "é" * 40))
        await asyncio.sleep(0.01)
        heard = f.client.of("STATUSTEXT")[-1][1]
        assert heard.text == "Pad lost: holding, then climbing " + "?" * 17
        assert heard.severity == 4

    fly(scene)


def test_a_flood_of_texts_is_held_back_but_never_a_critical_one() -> None:
    async def scene(f: Flight) -> None:
        for i in range(100):
            f.driver.tell(StatusText(Severity.NOTICE, f"descent: {i}"))
            await asyncio.sleep(0.025)
        f.driver.tell(StatusText(Severity.CRITICAL, "pilot, take over"))
        await asyncio.sleep(0.05)
        assert 8 <= len(f.client.texts) <= 14
        assert f.client.texts[-1] == "pilot, take over"
        await asyncio.sleep(5.0)
        f.driver.tell(StatusText(Severity.NOTICE, "later"))
        await asyncio.sleep(0.05)
        assert f.client.texts[-1] == "later"

    fly(scene)


def test_figures_are_sent_by_name_for_plots() -> None:
    async def scene(f: Flight) -> None:
        f.driver.plot({"pad_dist": 2.5, "phase": 3.0})
        await asyncio.sleep(0.05)
        heard = [(m.name, m.value) for _, m in f.client.of("NAMED_VALUE_FLOAT")]
        assert heard == [("pad_dist", 2.5), ("phase", 3.0)]

    fly(scene)


def test_the_thesis_type_mask_selects_the_same_fields_as_ours() -> None:
    """The thesis's 1991 has the force bit, too, which has no meaning without acceleration."""
    assert mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET == 1479 ^ 1991
    flown: list[tuple[float, ...]] = []
    for mask in (1479, 1991):

        async def scene(f: Flight, mask: int = mask) -> None:
            await f.client.mode(GUIDED)
            f.client.fly(1.0, -2.0, 0.5, mask=mask, yaw_rate=0.3)
            await asyncio.sleep(0.02)
            flown.append((*f.airframe.velocity, f.airframe.yaw_rate))

        fly(scene)
    assert flown[0] == flown[1] == pytest.approx((1.0, -2.0, 0.5, 0.3))


def test_disarming_is_never_forced() -> None:
    async def scene(f: Flight) -> None:
        messages = sent(f)
        f.driver.disarm()
        (m,) = (m for m in messages if m.get_type() == "COMMAND_LONG")
        assert (m.command, m.param1, m.param2) == (400, 0.0, 0.0)
        await asyncio.sleep(0.1)
        assert f.airframe.motors  # refused in the air

    fly(scene)
