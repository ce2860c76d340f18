"""Position and velocity targets are flown as ArduCopter 4.5 was measured to."""

import asyncio
import math

import pytest

from tests.hw.flight import Flight, PlainAirframe
from tests.hw.sim.stand_in.scenes import LAND, LOITER, fly, guided


@pytest.mark.parametrize("mask", [1479, 1991, 3527])
@pytest.mark.parametrize("frame", [1, 7])
def test_velocity_orders_fly_in_local_frames(mask: int, frame: int) -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        f.client.fly(1.0, 2.0, 0.5, mask=mask, frame=frame)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity == pytest.approx((1.0, 2.0, 0.5))

    fly(scene)


@pytest.mark.parametrize("frame", [8, 9])
def test_velocity_orders_in_body_frames_turn_with_the_heading(frame: int) -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        f.client.fly(1.0, 0.0, 0.5, frame=frame, yaw_rate=0.0)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity == pytest.approx((0.0, 1.0, 0.5), abs=1e-6)

    fly(scene, lambda: Flight(PlainAirframe(yaw=math.pi / 2)))


def test_set_points_in_frame_body_frd_are_ignored() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        f.client.fly(1.0, 0.0, 0.0)
        f.client.fly(-2.0, 0.0, 0.0, frame=12)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity == pytest.approx((1.0, 0.0, 0.0))

    fly(scene)


@pytest.mark.parametrize(
    ("north", "mask", "frame"),
    [
        (math.nan, 1479, 1),
        (math.inf, 1479, 1),
        (1.0, 4095, 1),  # everything ignored
        (1.0, 1479, 3),  # no such frame
        (1.0, 0x200 | 0x407, 1),  # acceleration as a force
    ],
)
def test_a_malformed_order_stops_the_vehicle(north: float, mask: int, frame: int) -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        f.client.fly(1.0, 0.0, 0.0)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity[0] == 1.0
        f.client.fly(north, 0.0, 0.0, mask=mask, frame=frame)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity == (0.0, 0.0, 0.0)

    fly(scene)


def test_a_velocity_order_is_held_for_3_s_and_then_dropped() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        f.client.fly(1.0, 0.0, 0.0, yaw_rate=0.3)
        await asyncio.sleep(2.98)
        assert f.airframe.velocity[0] == 1.0
        await asyncio.sleep(0.05)
        assert f.airframe.velocity[0] == 0.0
        assert f.airframe.yaw_rate == 0.0

    fly(scene)


@pytest.mark.parametrize("mode", [LOITER, LAND])
def test_orders_are_ignored_outside_guided(mode: int) -> None:
    async def scene(f: Flight) -> None:
        await f.client.mode(mode)
        f.client.fly(1.0, 1.0, -1.0)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity[:2] == (0.0, 0.0)
        assert f.airframe.velocity[2] >= 0.0
        # and are not remembered until GUIDED comes back
        await guided(f)
        await asyncio.sleep(0.02)
        assert f.airframe.velocity == (0.0, 0.0, 0.0)

    fly(scene)


def test_without_a_yaw_rate_the_nose_turns_into_the_course() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        for _ in range(5):
            f.client.fly(0.0, -1.0, 0.0, mask=3527)
            await asyncio.sleep(1.0)
        assert math.degrees(f.airframe.yaw) == pytest.approx(-90.0, abs=10.0)  # measured: -97
        f.client.fly(0.0, 1.0, 0.0, mask=1479, yaw_rate=0.0)
        before = f.airframe.yaw
        await asyncio.sleep(1.0)
        assert f.airframe.yaw == pytest.approx(before, abs=0.02)

    fly(scene)


def test_a_position_target_is_reached_at_no_more_than_5_mps() -> None:
    async def scene(f: Flight) -> None:
        await guided(f)
        f.client.fly(30.0, -40.0, -12.0, mask=3576)
        fastest = 0.0
        for _ in range(300):
            await asyncio.sleep(0.1)
            fastest = max(fastest, math.hypot(*f.airframe.velocity[:2]))
        assert fastest == pytest.approx(5.0)
        assert f.airframe.position == pytest.approx((30.0, -40.0, -12.0), abs=0.05)

    fly(scene)
