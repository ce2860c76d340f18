"""Gimbals and servos behind the autopilot: what goes over its link, and what is made of answers."""

import asyncio
import math
import random
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.gimbals.mavlink_mount import MavlinkMountGimbal, MavlinkMountOptions
from hw.gimbals.mavlink_v2 import MavlinkGimbal, MavlinkOptions
from hw.gimbals.servo_mavlink import ServoMavlinkGimbal, ServoMavlinkOptions
from hw.links.memory import MemoryLink, memory_pair
from hw.sim.gimbals.mavlink import GimbalManager
from hw.sim.gimbals.mount import SimMount
from hw.sim.options import SimGimbalOptions
from landerd.geometry import rot_zxy, rotate
from landerd.messages import GimbalCommand, GimbalState, Reference
from landerd.ports import Gimbal
from landerd.runtime.clock import run_virtual
from tests.hw.gimbals.benches import Stand, on_stand

VEHICLE_YAW = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
EARTH_YAW = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME


class Wire:
    """The autopilot's end of the link."""

    def __init__(self, far: MemoryLink) -> None:
        self._far = far
        self._ours, self._theirs = MavlinkCodec(1, 1), MavlinkCodec(0, 0)
        self.heard: list[Message] = []

    async def listen(self) -> None:
        while True:
            self.heard += self._theirs.decode(await self._far.read())

    def say(self, message: Message) -> None:
        self._far.write(self._ours.encode(message))

    def of(self, message_id: int, command: int | None = None) -> list[Message]:
        return [
            m
            for m in self.heard
            if m.get_msgId() == message_id and command in (None, getattr(m, "command", None))
        ]


def behind_autopilot(
    make: Callable[[MavlinkAutopilot], Gimbal], scene: Callable[[Any, Wire], Awaitable[None]]
) -> None:
    async def main() -> None:
        near, far = memory_pair()
        autopilot = MavlinkAutopilot(near)
        gimbal = make(autopilot)
        wire = Wire(far)
        await autopilot.open()
        await far.open()

        async def receive() -> None:
            while True:
                await autopilot.receive()

        tasks = [asyncio.create_task(wire.listen()), asyncio.create_task(receive())]
        await gimbal.open()
        await asyncio.sleep(0.01)
        await scene(gimbal, wire)
        for task in tasks:
            task.cancel()

    run_virtual(main())


def attitude(
    q: list[float],
    flags: int = VEHICLE_YAW,
    delta_yaw: float = 0.0,
    *,
    boot_ms: int = 1000,
    device: int = 0,
) -> Message:
    return mavlink.MAVLink_gimbal_device_attitude_status_message(
        0, 0, boot_ms, flags, q, *(0.0, 0.0, 0.0), 0, delta_yaw, 0.0, device
    )


def turn(yaw_deg: float, pitch_deg: float) -> list[float]:
    """Quaternion of yaw, then pitch."""
    y, p = math.radians(yaw_deg) / 2.0, math.radians(pitch_deg) / 2.0
    return [
        math.cos(y) * math.cos(p),
        -math.sin(y) * math.sin(p),
        math.cos(y) * math.sin(p),
        math.sin(y) * math.cos(p),
    ]


# ---- gimbal protocol version 2 ----


def v2(**options: Any) -> Callable[[MavlinkAutopilot], MavlinkGimbal]:
    return lambda autopilot: MavlinkGimbal(MavlinkOptions.model_validate(options), autopilot)


def test_v2_asks_for_control_and_orders_angles_without_rates() -> None:
    async def scene(gimbal: MavlinkGimbal, wire: Wire) -> None:
        await report(gimbal, wire, attitude(turn(0.0, 0.0)))
        gimbal.command(GimbalCommand(0.25, -1.5))
        await asyncio.sleep(0.01)
        (claim,) = wire.of(
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
        )
        assert (claim.param1, claim.param2) == (1.0, 191.0)
        (order,) = wire.of(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_PITCHYAW)
        assert (order.pitch, order.yaw) == pytest.approx((-1.5, 0.25))
        assert math.isnan(order.pitch_rate)
        assert math.isnan(order.yaw_rate)
        assert order.flags == 4 | 8  # roll and pitch locked to the horizon, yaw not to north

    behind_autopilot(v2(), scene)


def test_orders_are_not_sent_faster_than_the_link_bears() -> None:
    async def scene(gimbal: MavlinkGimbal, wire: Wire) -> None:
        for _ in range(200):
            gimbal.command(GimbalCommand(0.0, -1.0))
            await asyncio.sleep(0.01)
        orders = wire.of(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_SET_PITCHYAW)
        assert len(orders) == pytest.approx(20, abs=2)

    behind_autopilot(v2(command_hz=10.0), scene)


async def report(gimbal: Gimbal, wire: Wire, message: Message) -> GimbalState:
    wire.say(message)
    return await asyncio.wait_for(gimbal.state(), 0.5)


@pytest.mark.parametrize(
    ("yaw", "pitch"), [(0.0, 0.0), (30.0, -45.0), (-80.0, -90.0), (10.0, -89.9)]
)
def test_v2_reads_the_quaternion_also_straight_down(yaw: float, pitch: float) -> None:
    async def scene(gimbal: MavlinkGimbal, wire: Wire) -> None:
        state = await report(gimbal, wire, attitude(turn(yaw, pitch)))
        assert math.degrees(state.yaw) == pytest.approx(yaw, abs=0.01)
        assert math.degrees(state.pitch) == pytest.approx(pitch, abs=0.01)
        assert state.roll == pytest.approx(0.0, abs=1e-3)
        assert state.reference is Reference.HORIZON
        assert state.pitch_measured

    behind_autopilot(v2(), scene)


def test_v2_turns_a_yaw_from_north_into_one_from_the_airframe_or_tells_that_it_cannot(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scene(gimbal: MavlinkGimbal, wire: Wire) -> None:
        message = attitude(turn(100.0, -20.0), EARTH_YAW, math.radians(70.0))
        assert math.degrees((await report(gimbal, wire, message)).yaw) == pytest.approx(30.0)
        for i, (q, flags) in enumerate(
            [(turn(100.0, -20.0), EARTH_YAW), ([math.nan] * 4, VEHICLE_YAW), ([0.0] * 4, 0)]
        ):
            await asyncio.sleep(0.02)
            wire.say(attitude(q, flags, math.nan, boot_ms=1020 + 20 * i))
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(gimbal.state(), 0.5)
        told = [
            record.message for record in caplog.records if "it cannot be used" in record.message
        ]
        assert len(told) == 2
        assert "without delta_yaw" in told[0]

    behind_autopilot(v2(), scene)


@pytest.mark.parametrize(("asked", "believed_deg"), [(0, 10.0), (1, 10.0), (2, -60.0)])
def test_v2_believes_one_of_two_gimbals(
    asked: int, believed_deg: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Once, orders went to the landing camera's gimbal, and the angles of the other were used."""

    async def scene(gimbal: MavlinkGimbal, wire: Wire) -> None:
        for i in range(10):
            wire.say(attitude(turn(0.0, 10.0), boot_ms=1000 + 20 * i, device=1))
            wire.say(attitude(turn(0.0, -60.0), boot_ms=1000 + 20 * i + i % 2, device=2))
            state = await asyncio.wait_for(gimbal.state(), 0.5)
            assert math.degrees(state.pitch) == pytest.approx(believed_deg)
            await asyncio.sleep(0.02)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(gimbal.state(), 0.5)

    behind_autopilot(v2(device_id=asked), scene)
    told = [
        record.message for record in caplog.records if "there are gimbals 1 and 2" in record.message
    ]
    assert len(told) == (asked == 0)


def test_v2_of_servos_says_that_nobody_measured() -> None:
    async def scene(gimbal: MavlinkGimbal, wire: Wire) -> None:
        said = await report(gimbal, wire, attitude(turn(0.0, -20.0)))
        assert (said.yaw_measured, said.pitch_measured) == (False, False)
        assert said.from_autopilot

    behind_autopilot(v2(feedback=False), scene)


def test_v2_goes_on_after_a_restart_of_the_autopilot() -> None:
    async def scene(stand: Stand) -> None:
        manager = GimbalManager(SimMount(stand.world, SimGimbalOptions(), random.Random(1)))
        stand.autopilot.attach(manager)
        await stand.watch(1.0)
        stand.autopilot.reboot()
        await stand.watch(2.0)
        assert len(await stand.watch(1.0)) == pytest.approx(50, abs=5)
        assert manager.claims == 2  # for it has forgotten who controls the gimbal

    on_stand("mavlink", scene)


# ---- the older messages ----


def old(**options: Any) -> Callable[[MavlinkAutopilot], MavlinkMountGimbal]:
    return lambda a: MavlinkMountGimbal(MavlinkMountOptions.model_validate(options), a)


def test_mount_orders_degrees_in_the_mode_of_targeting() -> None:
    async def scene(gimbal: MavlinkMountGimbal, wire: Wire) -> None:
        gimbal.command(GimbalCommand(math.radians(30.0), math.radians(-60.0)))
        await asyncio.sleep(0.01)
        (order,) = wire.of(mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAV_CMD_DO_MOUNT_CONTROL)
        assert (order.param1, order.param3, order.param7) == pytest.approx((-60.0, 30.0, 2.0))

    behind_autopilot(old(), scene)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (
            "mount_orientation",
            mavlink.MAVLink_mount_orientation_message(1000, 0.0, -60.0, 30.0, 120.0),
        ),
        ("mount_status", mavlink.MAVLink_mount_status_message(0, 0, -6000, 0, 3000)),
    ],
)
def test_mount_reads_either_report(kind: str, message: Message) -> None:
    async def scene(gimbal: MavlinkMountGimbal, wire: Wire) -> None:
        state = await report(gimbal, wire, message)
        assert math.degrees(state.pitch) == pytest.approx(-60.0)
        assert math.degrees(state.yaw) == pytest.approx(30.0)
        now = asyncio.get_running_loop().time()
        assert state.t == pytest.approx(now - 0.02, abs=0.01)

    behind_autopilot(old(report=kind), scene)


# ---- servos on the autopilot's outputs ----


def test_servo_pulses_go_out_when_they_change_and_once_a_second() -> None:
    options = {"pitch": {"channel": 9, "table": [[-90.0, 1000.0], [0.0, 2000.0]]}}

    async def scene(gimbal: ServoMavlinkGimbal, wire: Wire) -> None:
        for i in range(160):
            gimbal.command(GimbalCommand(0.0, math.radians(-45.0 if i < 80 else -90.0)))
            await asyncio.sleep(0.025)
        orders = wire.of(mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAV_CMD_DO_SET_SERVO)
        assert {o.param1 for o in orders} == {9.0}
        pulses = [o.param2 for o in orders]
        assert pulses[:2] == [1500.0] * 2
        # At 60 degrees a second, half of what the servo is said to do.
        on_the_way = pulses[2 : pulses.index(1000.0)]
        assert len(on_the_way) > 10
        assert on_the_way == sorted(on_the_way, reverse=True)
        assert pulses[len(on_the_way) + 2 :] == [1000.0] * 2

    behind_autopilot(
        lambda a: ServoMavlinkGimbal(ServoMavlinkOptions.model_validate(options), a), scene
    )


def test_the_mounts_angles_are_composed_as_ardupilot_does() -> None:
    # Straight down a roll of ArduPilot's is about the lens: it turns the picture only.
    driver = MavlinkMountGimbal(MavlinkMountOptions(), MavlinkAutopilot(memory_pair()[0]))
    report = mavlink.MAVLink_mount_orientation_message(0, 3.0, -90.0, 0.0)
    angles = driver._angles(report)
    assert angles is not None
    lens = rotate(rot_zxy(angles[0], angles[2], angles[1]), (1.0, 0.0, 0.0))
    assert lens == pytest.approx((0.0, 0.0, 1.0), abs=1e-9)


@pytest.mark.parametrize("impossible", [math.inf, -math.inf, math.nan])
def test_an_angle_that_cannot_be_loses_neither_the_link_nor_what_comes_after(
    impossible: float,
) -> None:
    """Once, an infinite angle was taken for a lost autopilot, and the last velocity flew on."""

    async def scene(gimbal: MavlinkMountGimbal, wire: Wire) -> None:
        for boot_ms, pitch in ((1000, impossible), (1040, -90.0)):
            wire.say(mavlink.MAVLink_mount_orientation_message(boot_ms, 0.0, pitch, 0.0))
            await asyncio.sleep(0.04)
        state = await asyncio.wait_for(gimbal.state(), 1.0)
        assert state.pitch == pytest.approx(-math.pi / 2)

    behind_autopilot(old(), scene)
