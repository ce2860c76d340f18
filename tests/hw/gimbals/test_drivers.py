"""What every gimbal driver must do for the daemon, each against the model of its device."""

import asyncio
import math
from itertools import pairwise

import pytest

from landerd.messages import GimbalCommand
from landerd.ports import DeviceLost
from tests.hw.gimbals.benches import DRIVERS, MOVING, ON_BYTES, Stand, on_stand

FORWARD_DOWN = GimbalCommand(yaw=math.radians(20.0), pitch=math.radians(-70.0))
each_driver = pytest.mark.parametrize("driver", DRIVERS)
each_moving = pytest.mark.parametrize("driver", MOVING)
on_bytes = pytest.mark.parametrize("driver", ON_BYTES)


@each_moving
def test_takes_the_angles_it_is_given_and_says_so(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        last = (await stand.watch(2.5, FORWARD_DOWN))[-1]
        gimbal = stand.world.gimbal
        assert math.degrees(gimbal.yaw.angle) == pytest.approx(20.0, abs=0.7)
        assert math.degrees(gimbal.pitch.angle) == pytest.approx(-70.0, abs=0.7)
        assert last.yaw == pytest.approx(gimbal.yaw.angle, abs=math.radians(0.7))
        assert last.pitch == pytest.approx(gimbal.pitch.angle, abs=math.radians(0.7))

    on_stand(driver, scene)


@each_driver
def test_reports_at_the_rate_and_against_the_reference_it_states(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        await stand.watch(1.0)
        traits = stand.driver.traits
        states = await stand.watch(1.0)
        assert len(states) == pytest.approx(1.0 * traits.rate_hz, rel=0.1)
        assert all(a.t < b.t for a, b in pairwise(states))
        assert {s.reference for s in states} == {traits.reference}
        assert all(s.pitch_measured for s in states)
        assert stand.world.gimbal.reference is traits.reference
        now = asyncio.get_running_loop().time()
        assert 0.0 <= now - states[-1].t < 0.1

    on_stand(driver, scene)


@each_moving
def test_stays_within_the_limits_it_states(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        traits = stand.driver.traits
        for yaw, pitch in ((3.0, 3.0), (-3.0, -3.0)):
            last = (await stand.watch(2.5, GimbalCommand(yaw, pitch)))[-1]
            slack = math.radians(5.0)  # the axes swing
            assert traits.yaw_limits[0] - slack <= last.yaw <= traits.yaw_limits[1] + slack
            assert traits.pitch_limits[0] - slack <= last.pitch <= traits.pitch_limits[1] + slack

    on_stand(driver, scene)


@each_driver
def test_drops_orders_that_are_no_numbers_and_those_of_a_closed_device(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        before = (await stand.watch(1.0))[-1]
        for bad in (math.nan, math.inf):
            stand.driver.command(GimbalCommand(bad, -1.0))
            stand.driver.command(GimbalCommand(0.0, bad))
        after = (await stand.watch(1.0))[-1]
        assert (after.yaw, after.pitch) == pytest.approx((before.yaw, before.pitch), abs=0.02)
        await stand.driver.close()
        stand.driver.command(FORWARD_DOWN)
        await stand.driver.close()

    on_stand(driver, scene)


@each_moving
def test_follows_a_moving_target_with_little_lag(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        await stand.watch(3.0, GimbalCommand(0.0, math.radians(-40.0)))
        loop = asyncio.get_running_loop()
        speed, start = math.radians(15.0), loop.time()

        async def order() -> None:
            while True:
                yaw = speed * (loop.time() - start)
                stand.driver.command(GimbalCommand(yaw, math.radians(-40.0)))
                await asyncio.sleep(0.025)

        ordering = asyncio.create_task(order())
        states = await stand.watch(3.0)
        ordering.cancel()
        now = loop.time()
        stand.world.advance(now)
        behind = speed * (now - start) - stand.world.gimbal.yaw.angle
        assert 0.0 < behind / speed < 0.35
        # What is reported belongs to the time it is stamped with, so that pictures are placed well.
        true_rate = stand.world.gimbal.yaw.rate
        true_then = stand.world.gimbal.yaw.angle - true_rate * (now - states[-1].t)
        assert states[-1].yaw == pytest.approx(true_then, abs=math.radians(0.7))

    on_stand(driver, scene)


@on_bytes
def test_silence_is_a_lost_device_and_opening_it_again_mends_it(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        await stand.watch(1.0, FORWARD_DOWN)
        stand.model.silent = True
        start = asyncio.get_running_loop().time()
        with pytest.raises(DeviceLost, match="no answer"):
            await stand.driver.state()
        assert 0.9 < asyncio.get_running_loop().time() - start < 1.2
        stand.model.silent = False
        await stand.driver.close()
        await stand.driver.open()
        assert len(await stand.watch(1.0)) > 10

    on_stand(driver, scene)


@on_bytes
def test_garbage_moves_nothing_and_is_no_report(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        await stand.watch(2.5, FORWARD_DOWN)
        stand.model.garbage = True
        assert len(await stand.watch(0.8, FORWARD_DOWN)) <= 1  # one was under way
        stand.model.garbage = False
        states = await stand.watch(2.0, FORWARD_DOWN)
        assert all(math.degrees(s.pitch) == pytest.approx(-70.0, abs=2.0) for s in states[-20:])

    on_stand(driver, scene)


@on_bytes
def test_a_gimbal_that_restarts_is_set_up_again(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        await stand.watch(2.0, FORWARD_DOWN)
        stand.model.reset()
        opened_again = 0
        for _ in range(10):  # as the daemon does
            try:
                await stand.watch(1.5, FORWARD_DOWN)
                break
            except DeviceLost:
                opened_again += 1
                await stand.driver.close()
                await stand.driver.open()
        assert 1 <= opened_again <= 4
        await stand.watch(2.5, GimbalCommand(0.3, -0.5))
        assert stand.world.gimbal.yaw.angle == pytest.approx(0.3, abs=0.02)
        assert stand.world.gimbal.pitch.angle == pytest.approx(-0.5, abs=0.02)

    on_stand(driver, scene)


@pytest.mark.parametrize("driver", ["simplebgc", "siyi", "storm32"])
def test_over_a_terminal_or_a_socket_in_real_time(driver: str) -> None:
    async def scene(stand: Stand) -> None:
        command = GimbalCommand(0.1, -0.5)
        for _ in range(20):
            reached = [
                s
                for s in await stand.watch(0.3, command)
                if abs(s.yaw - 0.1) < 0.02 and abs(s.pitch + 0.5) < 0.02
            ]
            if reached:
                return
        pytest.fail("did not get there")

    on_stand(driver, scene, realtime=True)
