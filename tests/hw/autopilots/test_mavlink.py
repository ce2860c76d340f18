"""landerd's driver against the stand-in: real bytes over in-memory links, in virtual time."""

import asyncio
import logging
import math
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links.memory import memory_pair
from landerd.config.models import Config
from landerd.config.parameters import ParameterSet
from landerd.messages import (
    Attitude,
    AutopilotMessage,
    AutopilotRestarted,
    Battery,
    ClockSync,
    Heartbeat,
    Landed,
    LandedState,
    LocalPosition,
    RcChannels,
    Setpoint,
)
from landerd.ports import DeviceLost
from landerd.runtime.clock import run_virtual
from tests.fuzz.budget import examples
from tests.hw.autopilots.scenes import GUIDED, fly
from tests.hw.flight import Flight, frame_of

# Ids of the messages that landerd does something with.
HANDLED = [0, 20, 21, 23, 30, 32, 65, 75, 76, 77, 111, 147, 245, 253]


def received(*messages: Message, system: int = 1, component: int = 1) -> list[AutopilotMessage]:
    """What the driver makes of these messages, sent by this source and arriving at time 1 s."""
    return received_bytes(
        lambda codec: b"".join(codec.encode(m) for m in messages), system, component
    )[0]


def received_bytes(
    make: Callable[[MavlinkCodec], bytes], system: int = 1, component: int = 1
) -> tuple[list[AutopilotMessage], MavlinkAutopilot]:
    got: list[AutopilotMessage] = []
    here, there = memory_pair()
    driver = MavlinkAutopilot(here, parameters=ParameterSet(Config()))

    async def receive() -> None:
        while True:
            got.append(await driver.receive())

    async def main() -> None:
        await driver.open()
        await there.open()
        await asyncio.sleep(1.0)
        task = asyncio.create_task(receive())
        there.write(make(MavlinkCodec(system, component)))
        await asyncio.sleep(0.01)
        task.cancel()

    run_virtual(main())
    return got, driver


def attitude(boot_ms: int = 500, roll: float = 0.1) -> Message:
    return mavlink.MAVLink_attitude_message(boot_ms, roll, -0.2, 0.3, 0.01, 0.02, 0.03)


def heartbeat(
    base_mode: int = 217, mode: int = GUIDED, vehicle: int = 2, autopilot: int = 3
) -> Message:
    return mavlink.MAVLink_heartbeat_message(vehicle, autopilot, base_mode, mode, 4, 3)


# ---- telemetry ----


def test_it_asks_for_its_streams_and_gets_them_at_the_rates_it_needs() -> None:
    async def scene(f: Flight) -> None:
        f.messages.clear()
        await asyncio.sleep(10.0)
        rates = {
            kind: len(f.got(kind)) / 10.0
            for kind in (Attitude, LocalPosition, RcChannels, LandedState, Battery, Heartbeat)
        }
        assert rates == pytest.approx(
            {
                Attitude: 50,
                LocalPosition: 50,
                RcChannels: 20,
                LandedState: 5,
                Battery: 2,
                Heartbeat: 4,
            },
            rel=0.11,
        )
        assert not f.driver.counters

    fly(scene)


def test_it_reports_what_the_vehicle_does() -> None:
    async def scene(f: Flight) -> None:
        f.autopilot.pilot.set(11, 1900)
        await f.client.mode(GUIDED)
        f.client.fly(1.0, -2.0, 0.25, yaw_rate=0.2)
        await asyncio.sleep(1.0)
        position = f.got(LocalPosition)[-1]
        assert position.position == pytest.approx(f.airframe.position, abs=0.05)
        assert position.velocity == pytest.approx((1.0, -2.0, 0.25))
        assert f.got(Attitude)[-1].yaw == pytest.approx(f.airframe.yaw, abs=0.01)
        assert f.got(Attitude)[-1].rates == pytest.approx((0.0, 0.0, 0.2))
        assert f.got(RcChannels)[-1].channels_us[10] == 1900
        assert f.got(RcChannels)[-1].channels_us[16:] == (0, 0)
        assert f.got(LandedState)[-1].state is Landed.IN_AIR
        assert f.got(Battery)[-1].voltage_v == pytest.approx(12.6)
        assert f.got(Battery)[-1].energy_consumed_j == pytest.approx(
            f.airframe.battery.energy_j, abs=300.0
        )
        assert f.got(Heartbeat)[-1] == Heartbeat(f.got(Heartbeat)[-1].t, True, True, "GUIDED")

    fly(scene)


def test_messages_are_placed_at_their_time_of_measurement_in_spite_of_the_links_delay() -> None:
    async def scene(f: Flight) -> None:
        await f.client.mode(GUIDED)
        far = f.autopilot_link
        far.faults.delay_s = f.driver_link.faults.delay_s = 0.08
        await asyncio.sleep(12.0)  # the window of the quickest exchange
        f.client.fly(1.0, 0.0, 0.0)
        await asyncio.sleep(0.2)
        f.messages.clear()
        await asyncio.sleep(2.0)
        loop = asyncio.get_running_loop()
        north, now = f.airframe.position[0], loop.time()
        for m in f.got(LocalPosition):
            moved = north - (now - m.t) * 1.0  # where it was at m.t
            # 1 ms of clock; the rest is the airframe's own, which moves in ticks of 10 ms.
            assert m.position[0] == pytest.approx(moved, abs=0.007)

    fly(scene)


def test_times_never_run_backwards_nor_into_the_future() -> None:
    async def scene(f: Flight) -> None:
        arrivals: list[tuple[float, float]] = []
        loop = asyncio.get_running_loop()
        for delay in (0.0, 0.2, 0.01, 0.0, 0.1):
            f.autopilot_link.faults.delay_s = delay
            for _ in range(100):
                seen = len(f.messages)
                await asyncio.sleep(0.02)
                arrivals += [(loop.time(), m.t) for m in f.messages[seen:]]
        assert all(t <= now for now, t in arrivals)
        for kind in (Attitude, LocalPosition, RcChannels):
            times = [m.t for m in f.got(kind)]
            assert len(times) > 100
            assert all(a < b for a, b in pairwise(times))

    fly(scene)


def test_an_overtaken_message_is_dropped() -> None:
    got, driver = received_bytes(
        lambda codec: codec.encode(attitude(520)) + codec.encode(attitude(500, roll=0.5))
    )
    assert [m.roll for m in got if isinstance(m, Attitude)] == pytest.approx([0.1])
    assert driver.counters["out of order"] == 1


@pytest.mark.parametrize("wrong_ms", [0, 2**32 - 1, 400_000])
def test_one_stamp_that_does_not_fit_is_no_restart(wrong_ms: int) -> None:
    """Once it was, later messages seemed far ahead, and the pilot's switch had to be moved."""
    got, driver = received_bytes(
        lambda codec: b"".join(
            codec.encode(attitude(ms)) for ms in (90_000, 90_020, wrong_ms, 90_040, 90_060)
        )
    )
    assert not any(isinstance(m, AutopilotRestarted) for m in got)
    assert driver.counters["a boot time that does not fit"] == 1


def test_two_stamps_that_fit_each_other_are_a_restart() -> None:
    got, _ = received_bytes(
        lambda codec: b"".join(codec.encode(attitude(ms)) for ms in (90_000, 90_020, 300, 320))
    )
    assert len([m for m in got if isinstance(m, AutopilotRestarted)]) == 1


def streamed(
    make: Callable[[float], Message], boot_s: Callable[[float], float], seconds: float
) -> list[tuple[float, AutopilotMessage]]:
    """What the driver makes of a message sent 50 times a second, and when.

    Args:
        make: the message for a loop time, s.
        boot_s: what the autopilot answers to TIMESYNC at a loop time, s.
        seconds: for so long.
    """
    got: list[tuple[float, AutopilotMessage]] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        ours, there = memory_pair()
        driver, codec = MavlinkAutopilot(ours), MavlinkCodec(1, 1)

        async def receive() -> None:
            while True:
                message = await driver.receive()
                got.append((loop.time(), message))

        async def answer() -> None:
            while True:
                for m in codec.decode(await there.read()):
                    if m.get_type() == "TIMESYNC" and m.tc1 == 0:
                        boot_ns = round(boot_s(loop.time()) * 1e9)
                        sent = mavlink.MAVLink_timesync_message(boot_ns, m.ts1)
                        there.write(codec.encode(sent))

        await driver.open()
        await there.open()
        tasks = [asyncio.create_task(work()) for work in (receive, answer)]
        for _ in range(round(50 * seconds)):
            await asyncio.sleep(0.02)
            there.write(codec.encode(make(loop.time())))
        for task in tasks:
            task.cancel()

    run_virtual(main())
    return got


@pytest.mark.parametrize("up_s", [100.0, 2.0**32 / 1e3 + 100.0, 3.0 * 2.0**32 / 1e3 + 5.0])
def test_the_clock_is_known_however_long_the_autopilot_was_up(up_s: float) -> None:
    """Time stamps have 32 bits and wrap after 49.7 days; answers to TIMESYNC do not."""

    def boot_s(t: float) -> float:
        return up_s + t

    got = streamed(lambda t: attitude(round(boot_s(t) * 1e3) & 0xFFFFFFFF), boot_s, 8.0)
    assert sum(isinstance(m, ClockSync) for _, m in got) >= 5
    assert sum(isinstance(m, Attitude) for _, m in got) >= 395
    assert not any(isinstance(m, AutopilotRestarted) for _, m in got)


def test_a_clock_that_is_set_back_does_not_keep_the_pilots_switch_away() -> None:
    """By answers to TIMESYNC that jump ahead, what comes now seems older than what came before."""
    set_back_t, low_t = 3.5, 3.75  # known by 3.66 s

    def switch(t: float) -> Message:
        pulse_us = 1100 if t > low_t else 1900
        return mavlink.MAVLink_rc_channels_message(round(t * 1e3), 18, *[pulse_us] * 18, 255)

    got = streamed(switch, lambda t: t + 0.4 * (t > set_back_t), 8.0)
    channels = [(t, m) for t, m in got if isinstance(m, RcChannels)]
    assert min(t - m.t for t, m in channels) >= 0.0
    assert max(t - m.t for t, m in channels) > 0.3  # it was set back
    assert all(a.t <= b.t for (_, a), (_, b) in pairwise(channels))
    assert min(t for t, m in channels if m.channels_us[10] == 1100) == pytest.approx(
        low_t, abs=0.03
    )
    assert len(channels) >= 399


def test_a_restart_of_the_autopilot_is_told_and_its_streams_come_back() -> None:
    async def scene(f: Flight) -> None:
        assert not f.got(AutopilotRestarted)
        f.autopilot.reboot()
        await asyncio.sleep(3.5)
        assert len(f.got(AutopilotRestarted)) == 1
        f.messages.clear()
        await asyncio.sleep(1.0)
        assert len(f.got(Attitude)) >= 49
        now = asyncio.get_running_loop().time()
        assert f.got(Attitude)[-1].t == pytest.approx(now, abs=0.03)

    fly(scene)


def test_streams_that_stop_are_asked_for_again() -> None:
    async def scene(f: Flight) -> None:
        f.autopilot._channels[1].streams.pop(mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
        await asyncio.sleep(2.1)
        f.messages.clear()
        await asyncio.sleep(1.0)
        assert len(f.got(RcChannels)) >= 19

    fly(scene)


def test_a_first_request_that_is_lost_is_repeated_before_a_pilot_acts() -> None:
    """RC heard only after a second is a switch that was never seen low."""

    async def main() -> None:
        async with Flight() as f:
            codec = MavlinkCodec(255, 190)
            asked: list[float] = []

            def lose_the_first(now: float, data: bytes) -> None:
                requests = [m for m in codec.decode(data) if m.get_type() == "COMMAND_LONG"]
                rc = any(m.param1 == mavlink.MAVLINK_MSG_ID_RC_CHANNELS for m in requests)
                f.driver_link.faults.drop = 1.0 if rc and not asked else 0.0
                asked.extend([now] * rc)

            f.driver_link.tap = lose_the_first
            await f.connect()
            assert f.got(RcChannels)[0].t - asked[0] < 0.5

    run_virtual(main())


def test_a_stream_that_comes_too_slowly_is_asked_for_again_and_said_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scene(f: Flight) -> None:
        streams = f.autopilot._channels[1].streams
        streams[mavlink.MAVLINK_MSG_ID_ATTITUDE] = (0.1, 0.0)
        await asyncio.sleep(2.1)
        f.messages.clear()
        await asyncio.sleep(1.0)
        assert len(f.got(Attitude)) >= 49

    with caplog.at_level(logging.WARNING):
        fly(scene)
    assert caplog.text.count("ATTITUDE comes at") == 1


def test_after_a_restart_everything_is_asked_again_with_the_first_message() -> None:
    """Only heartbeats come then; the answer to TIMESYNC shows at once that the clock went back."""

    async def scene(f: Flight) -> None:
        f.autopilot.reboot()
        start = asyncio.get_running_loop().time()
        while not f.got(AutopilotRestarted):
            await asyncio.sleep(0.005)
        told = f.got(AutopilotRestarted)[0].t
        (first,) = [m.t for m in f.got(Heartbeat) if start < m.t <= told][:1]
        assert told - first < 0.05
        f.messages.clear()
        await asyncio.sleep(0.2)
        assert {type(m) for m in f.messages} >= {Attitude, LocalPosition, RcChannels}

    fly(scene)


def test_a_command_that_the_autopilot_refuses_is_told_once_in_plain_words(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scene(f: Flight) -> None:
        for _ in range(5):
            f.driver.disarm()  # in the air
            await asyncio.sleep(0.5)
        assert f.client.texts.count("landerd: autopilot refuses to disarm: failed") == 1
        assert f.driver.counters["command refused"] == 5

    with caplog.at_level(logging.WARNING):
        fly(scene)
    assert caplog.text.count("autopilot refuses to disarm: failed") == 1


def test_acknowledgements_for_others_are_not_ours() -> None:
    _, driver = received_bytes(
        lambda codec: codec.encode(mavlink.MAVLink_command_ack_message(400, 4, 0, 0, 255, 190))
    )
    assert not driver.counters


# ---- what is not taken ----


@pytest.mark.parametrize(
    ("system", "component"),
    [(2, 1), (1, 154), (1, 191), (255, 190)],  # another vehicle, a gimbal, us, a ground station
)
def test_other_senders_are_ignored_and_counted(system: int, component: int) -> None:
    got, driver = received_bytes(
        lambda codec: codec.encode(heartbeat()) + codec.encode(attitude()), system, component
    )
    assert got == []
    assert driver.counters == {"foreign": 2}


@pytest.mark.parametrize(
    "bad",
    [
        mavlink.MAVLink_attitude_message(500, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0),
        mavlink.MAVLink_attitude_message(500, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0),
        mavlink.MAVLink_attitude_message(500, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0),
        mavlink.MAVLink_attitude_message(500, 0.0, 0.0, 0.0, 0.0, math.nan, 0.0),
        mavlink.MAVLink_local_position_ned_message(500, 1.0, math.nan, 0.0, 0.0, 0.0, 0.0),
        mavlink.MAVLink_local_position_ned_message(500, 1.0, 0.0, -1e9, 0.0, 0.0, 0.0),
        mavlink.MAVLink_local_position_ned_message(500, 1.0, 0.0, 0.0, 0.0, 0.0, -math.inf),
        mavlink.MAVLink_local_position_ned_message(500, 1.0, 0.0, 0.0, 500.0, 0.0, 0.0),
        mavlink.MAVLink_extended_sys_state_message(0, 9),
        heartbeat(autopilot=12),  # PX4
        heartbeat(vehicle=1),  # ArduPlane: its mode 4 is another one
    ],
)
def test_damaged_or_foreign_values_are_dropped_and_counted(bad: Message) -> None:
    got, driver = received_bytes(lambda codec: codec.encode(bad))
    assert got == []
    assert sum(driver.counters.values()) == 1


def test_each_kind_of_fault_is_logged_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    bad = [
        mavlink.MAVLink_attitude_message(i, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0) for i in range(100)
    ]
    with caplog.at_level(logging.WARNING):
        _, driver = received_bytes(lambda codec: b"".join(codec.encode(m) for m in bad))
    assert driver.counters["bad attitude"] == 100
    assert len(caplog.records) == 1


def test_rc_channels_without_a_sound_pulse_read_0() -> None:
    # Eight channels of the receiver, and one that is overridden over MAVLink.
    raw = [1500, 0, 65535, 1100, 40000, 200, 2000, 1900, 0, 0, 1234, *[0] * 7]
    (rc,) = received(mavlink.MAVLink_rc_channels_message(500, 8, *raw, 255))
    assert isinstance(rc, RcChannels)
    assert rc.channels_us == (1500, 0, 0, 1100, 0, 0, 2000, 1900, 0, 0, 1234, *[0] * 7)


@pytest.mark.parametrize(
    ("base_mode", "mode", "expected"),
    [
        (81, 0, (False, False, "STABILIZE")),
        (89, 4, (False, True, "GUIDED")),
        (217, 4, (True, True, "GUIDED")),
        (209, 9, (True, False, "LAND")),
        (217, 5, (True, False, "LOITER")),
        (217, 99, (True, False, "MODE 99")),
        (216, 4, (True, False, "unknown")),  # without the custom-mode flag it says nothing
    ],
)
def test_heartbeats_report_mode_and_arming(
    base_mode: int, mode: int, expected: tuple[bool, bool, str]
) -> None:
    (beat,) = received(heartbeat(base_mode, mode))
    assert isinstance(beat, Heartbeat)
    assert (beat.armed, beat.guided, beat.mode) == expected


def test_a_battery_without_measurement_is_reported_as_unknown() -> None:
    (battery,) = received(
        mavlink.MAVLink_battery_status_message(0, 0, 0, 0x7FFF, [0xFFFF] * 10, -1, -1, -1, -1)
    )
    assert battery == Battery(1.0, None, None)


# ---- the link ----


def test_a_cut_link_is_lost_and_carries_on_after_it_is_opened_again() -> None:
    async def scene(f: Flight) -> None:
        f.driver_link.cut()
        f.driver.fly(Setpoint((1.0, 0.0, 0.0), 0.0))  # dropped silently
        with pytest.raises(DeviceLost):
            await f.driver.receive()
        await asyncio.sleep(5.0)
        f.driver_link.mend()
        await f.connect()
        f.messages.clear()
        await asyncio.sleep(1.0)
        assert len(f.got(Attitude)) >= 49
        assert not f.got(AutopilotRestarted)

    fly(scene)


def test_with_bytes_damaged_and_writes_lost_only_sound_values_come_through() -> None:
    async def scene(f: Flight) -> None:
        f.autopilot_link.faults.corrupt = 0.01
        f.autopilot_link.faults.drop = 0.3
        f.messages.clear()
        await asyncio.sleep(10.0)
        assert 100 < len(f.got(LocalPosition)) < 350
        assert {m.position for m in f.got(LocalPosition)} == {(0.0, 0.0, -10.0)}
        assert f.driver.counters["garbled bytes"] > 1000
        assert f.driver.counters["messages lost"] > 300
        f.autopilot_link.faults.corrupt = f.autopilot_link.faults.drop = 0.0
        await asyncio.sleep(2.0)  # the time allowed to be back
        f.messages.clear()
        await asyncio.sleep(1.0)
        assert len(f.got(Attitude)) >= 49
        assert len(f.got(RcChannels)) >= 19

    fly(scene)


@examples(150)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(HANDLED) | st.sampled_from(sorted(mavlink.mavlink_map)),
            st.binary(max_size=255),
            st.sampled_from([(1, 1), (255, 190)]),
        ),
        max_size=6,
    )
)
def test_sound_frames_with_any_content_never_raise(
    contents: list[tuple[int, bytes, tuple[int, int]]],
) -> None:
    """From the autopilot and from a ground station, with parameters and commands for landerd."""
    to_us = {20: b"\xff\xff\x01\xbf", 21: b"\x01\xbf", 23: b"\x00\x00\x80?\x01\xbf"}
    received_bytes(
        lambda codec: b"".join(
            frame_of(kind, to_us.get(kind, b"") + body, system=system, component=component)
            for kind, body, (system, component) in contents
        )
    )
