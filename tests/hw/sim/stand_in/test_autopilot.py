"""The stand-in answers as ArduCopter 4.5 was measured to."""

import asyncio
import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from landerd.messages import ClockSync
from tests.hw.flight import Flight, PlainAirframe, frame_of
from tests.hw.sim.stand_in.scenes import (
    ACCEPTED,
    DENIED,
    FAILED,
    GUIDED,
    LAND,
    LOITER,
    RTL,
    fly,
    grounded,
    guided,
)

ARM, TAKE_OFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF


def test_nothing_streams_until_asked_and_then_at_the_exact_rate() -> None:
    async def scene(f: Flight) -> None:
        await asyncio.sleep(9.0)
        kinds = {m.get_type() for _, m in f.client.heard}
        assert kinds == {"HEARTBEAT", "TIMESYNC"}
        f.client.stream(mavlink.MAVLINK_MSG_ID_ATTITUDE, 50.0)
        f.client.stream(mavlink.MAVLINK_MSG_ID_RC_CHANNELS, 20.0)
        await asyncio.sleep(10.0)
        assert len(f.client.of("ATTITUDE")) == pytest.approx(500, abs=2)
        assert len(f.client.of("RC_CHANNELS")) == pytest.approx(200, abs=2)
        boot_ms = [m.time_boot_ms for _, m in f.client.of("ATTITUDE")]
        assert {b - a for a, b in itertools.pairwise(boot_ms)} <= {19, 20, 21}

    fly(scene)


@pytest.mark.parametrize("is_lost", [False, True])
def test_answers_to_timesync_are_lost_where_they_are_to_be(is_lost: bool) -> None:
    async def scene(f: Flight) -> None:
        if is_lost:
            timesync = mavlink.MAVLINK_MSG_ID_TIMESYNC
            f.autopilot.tampering.begin(timesync, lambda message, send: None)
        await f.connect()
        await asyncio.sleep(2.0)
        assert any(isinstance(m, ClockSync) for m in f.messages) is not is_lost

    fly(scene)


def test_an_unknown_stream_is_denied() -> None:
    async def scene(f: Flight) -> None:
        assert await f.client.do(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 158.0, 1e5) == DENIED
        assert f.client.texts == ["No ap_message for mavlink id (158)"]

    fly(scene)


def test_acknowledgements_come_within_6_ms_and_a_new_mode_is_told_within_10_ms() -> None:
    async def scene(f: Flight) -> None:
        start = asyncio.get_running_loop().time()
        f.client.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(GUIDED))
        await asyncio.sleep(0.02)
        (ack_t, _), *_ = f.client.of("COMMAND_ACK")
        assert 0.001 <= ack_t - start <= 0.006
        told_t, heartbeat = f.client.of("HEARTBEAT")[-1]
        assert told_t - start <= 0.0101
        assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status) == (217, 4, 4)

    fly(scene)


def test_arming_is_told_by_text_at_once_and_by_the_next_heartbeat() -> None:
    async def scene(f: Flight) -> None:
        await asyncio.sleep(0.5)
        assert await f.client.do(ARM, 1.0) == ACCEPTED
        assert "Arming motors" in f.client.texts
        assert not f.client.of("HEARTBEAT")[-1][1].base_mode & 128
        await asyncio.sleep(1.0)
        assert f.client.of("HEARTBEAT")[-1][1].base_mode & 128

    fly(scene, grounded)


def test_the_speed_to_a_position_target_can_be_changed_until_the_mode_is() -> None:
    async def scene(f: Flight) -> None:
        change = mavlink.MAV_CMD_DO_CHANGE_SPEED
        assert await f.client.do(change, 1.0, 12.0, -1.0) != ACCEPTED  # not in LOITER
        await guided(f)
        assert await f.client.do(change, 1.0, -1.0, -1.0) != ACCEPTED
        assert await f.client.do(change, 1.0, 12.0, -1.0) == ACCEPTED
        f.client.fly(500.0, 0.0, -10.0, mask=3576)
        await asyncio.sleep(0.1)
        assert f.airframe.velocity[0] == pytest.approx(12.0)
        f.autopilot.copter.set_mode(LOITER)
        await guided(f)
        f.client.fly(500.0, 0.0, -10.0, mask=3576)
        await asyncio.sleep(0.1)
        assert f.airframe.velocity[0] == pytest.approx(5.0)

    fly(scene)


def test_take_off_needs_arming_and_is_refused_in_the_air() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        assert await f.client.do(TAKE_OFF, *(0.0,) * 6, 10.0) == FAILED  # disarmed
        assert await f.client.do(ARM, 1.0) == ACCEPTED
        f.client.fly(0.0, 0.0, -1.0)
        await asyncio.sleep(1.0)
        assert f.airframe.position[2] == 0.0  # velocity orders do not take off
        assert await f.client.do(TAKE_OFF, *(0.0,) * 6, 10.0) == ACCEPTED
        f.client.stream(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 20.0)
        await asyncio.sleep(12.0)
        assert f.airframe.position[2] == pytest.approx(-10.0, abs=0.15)
        states = [m.landed_state for _, m in f.client.of("EXTENDED_SYS_STATE")]
        assert states[0] == 3
        assert states[-1] == 2
        assert await f.client.do(TAKE_OFF, *(0.0,) * 6, 10.0) == FAILED  # flies already

    fly(scene, grounded)


def test_any_set_point_cancels_a_take_off() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        await f.client.do(ARM, 1.0)
        await f.client.do(TAKE_OFF, *(0.0,) * 6, 10.0)
        await asyncio.sleep(3.0)
        f.client.fly(0.0, 0.0, 0.0)
        await asyncio.sleep(0.1)
        height = -f.airframe.position[2]
        assert height > 0.5
        await asyncio.sleep(10.0)
        assert -f.airframe.position[2] == pytest.approx(height, abs=0.05)

    fly(scene, grounded)


def test_disarm_is_refused_until_the_land_detector_says_on_ground() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        assert await f.client.do(ARM, 0.0) == FAILED
        for _ in range(25):
            f.client.fly(0.0, 0.0, 0.5)
            await asyncio.sleep(0.1)
        assert f.airframe.position[2] == 0.0
        assert await f.client.do(ARM, 0.0) == FAILED  # touched down, not yet detected
        for _ in range(20):
            f.client.fly(0.0, 0.0, 0.5)
            await asyncio.sleep(0.1)
        assert await f.client.do(ARM, 0.0) == ACCEPTED
        assert not f.airframe.motors
        assert f.client.texts[-1] == "Disarming motors"

    fly(scene, lambda: Flight(PlainAirframe((0.0, 0.0, -1.0))))


def test_a_forced_disarm_stops_the_motors_in_the_air() -> None:
    async def scene(f: Flight) -> None:
        assert await f.client.do(ARM, 0.0, 21196.0) == ACCEPTED
        assert not f.airframe.motors

    fly(scene)


@pytest.mark.parametrize(("throttle_us", "disarms"), [(1000, True), (1500, False)])
def test_landed_in_guided_it_disarms_by_itself_only_with_the_throttle_low(
    throttle_us: int, disarms: bool
) -> None:
    async def scene(f: Flight) -> None:
        f.autopilot.pilot.set(3, throttle_us)
        await guided(f)
        await f.client.do(ARM, 1.0)
        await asyncio.sleep(9.5)
        assert f.airframe.motors
        await asyncio.sleep(30.0)
        assert f.airframe.motors is not disarms

    fly(scene, grounded)


def test_land_descends_at_half_a_metre_per_second_and_disarms() -> None:
    async def scene(f: Flight) -> None:
        f.client.stream(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 20.0)
        await f.client.mode(LAND)
        await asyncio.sleep(1.0)
        assert f.airframe.velocity == (0.0, 0.0, 0.5)
        assert f.client.of("EXTENDED_SYS_STATE")[-1][1].landed_state == 4
        await asyncio.sleep(12.0)  # 5 m, then the land detector's 2 s and half a second
        assert not f.airframe.motors

    fly(scene, lambda: Flight(PlainAirframe((0.0, 0.0, -5.0))))


def test_a_radio_is_not_lost_while_a_ground_station_overrides_any_channel() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        f.autopilot.pilot.lose()
        override = mavlink.MAVLink_rc_channels_override_message(1, 1, *(0xFFFF,) * 8, 0, 0, 1900)
        for _ in range(8):
            f.client.send(override)
            await asyncio.sleep(0.5)
        assert f.client.of("HEARTBEAT")[-1][1].custom_mode == GUIDED
        await asyncio.sleep(0.7)
        assert f.client.of("HEARTBEAT")[-1][1].custom_mode == RTL

    fly(scene)


def test_rtl_climbs_to_its_height_and_only_then_flies_home() -> None:
    async def scene(f: Flight) -> None:
        await f.client.mode(RTL)
        await asyncio.sleep(1.5)
        assert f.airframe.velocity == (0.0, 0.0, -2.5)
        await asyncio.sleep(4.0)
        assert f.airframe.velocity[0] == -5.0
        await asyncio.sleep(30.0)
        north, east, down = f.airframe.position
        assert math.hypot(north, east) < 0.1
        assert down == pytest.approx(-15.0, abs=0.1)

    fly(scene, lambda: Flight(PlainAirframe((30.0, 0.0, -5.0))))


def test_a_lost_radio_changes_the_mode_after_a_second() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        f.client.fly(1.0, 0.0, 0.0)
        f.autopilot.pilot.lose()
        await asyncio.sleep(0.9)
        assert f.client.of("HEARTBEAT")[-1][1].custom_mode == GUIDED
        await asyncio.sleep(0.2)
        heartbeat = f.client.of("HEARTBEAT")[-1][1]
        assert (heartbeat.custom_mode, heartbeat.system_status) == (6, 5)
        assert f.client.texts[-1] == "Radio Failsafe"
        f.autopilot.pilot.restore()
        await asyncio.sleep(2.0)
        assert f.client.of("HEARTBEAT")[-1][1].custom_mode == 6  # until ordered otherwise

    fly(scene)


def test_rc_override_counts_from_the_ground_station_only_and_expires() -> None:
    async def scene(f: Flight) -> None:
        f.client.stream(mavlink.MAVLINK_MSG_ID_RC_CHANNELS, 20.0)
        override = mavlink.MAVLink_rc_channels_override_message(1, 1, *(0xFFFF,) * 8, 0, 0, 1900)
        await f.driver.open()
        f.driver_link.write(override.pack(mavlink.MAVLink(None, 1, 191)))
        await asyncio.sleep(0.1)
        assert f.client.of("RC_CHANNELS")[-1][1].chan11_raw == 1000
        f.client.send(override)
        await asyncio.sleep(0.06)
        assert f.client.of("RC_CHANNELS")[-1][1].chan11_raw == 1900
        await asyncio.sleep(3.0)
        assert f.client.of("RC_CHANNELS")[-1][1].chan11_raw == 1000

    fly(scene)


def test_battery_energy_is_in_hectojoules() -> None:
    async def scene(f: Flight) -> None:
        f.client.stream(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, 2.0)
        await asyncio.sleep(30.0)
        energy = [m.energy_consumed for _, m in f.client.of("BATTERY_STATUS")]
        assert energy[-1] - energy[0] == pytest.approx(106, abs=3)  # measured: 129 to 235 in 30 s

    fly(scene)


def test_texts_of_one_link_are_routed_to_the_other() -> None:
    async def scene(f: Flight) -> None:
        await f.driver.open()
        text = mavlink.MAVLink_statustext_message(6, b"Pad in sight")
        f.driver_link.write(text.pack(mavlink.MAVLink(None, 1, 191)))
        await asyncio.sleep(0.01)
        ((_, heard),) = f.client.of("STATUSTEXT")
        assert (heard.text, heard.get_srcComponent()) == ("Pad in sight", 191)

    fly(scene)


@pytest.mark.parametrize(
    "command",
    [
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
    ],
)
def test_commands_without_numbers_are_refused(command: int) -> None:
    async def scene(f: Flight) -> None:
        assert await f.client.do(command, *(math.nan,) * 7) != ACCEPTED

    fly(scene)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(sorted(mavlink.mavlink_map)), st.binary(max_size=255)),
        max_size=6,
    )
)
def test_valid_frames_with_any_content_do_not_stop_it(contents: list[tuple[int, bytes]]) -> None:
    async def scene(f: Flight) -> None:
        for message_id, payload in contents:
            f.client.link.write(frame_of(message_id, payload, system=255, component=190))
            await asyncio.sleep(0.05)
        assert await f.client.mode(LOITER) == ACCEPTED

    fly(scene)
