import asyncio
import math
import statistics
from collections.abc import Awaitable, Callable
from itertools import pairwise
from random import Random

import pytest

from hw.sim.options import SimGimbalOptions
from hw.sim.physics.gimbal import GimbalFault, SimGimbal, SimMount
from hw.sim.physics.world import World
from landerd.messages import GimbalCommand, GimbalState, Reference
from landerd.ports import DeviceLost
from landerd.runtime.clock import run_virtual
from tests.hw.sim.worlds import world


def turn(w: World, until_s: float, yaw: Callable[[float], float]) -> list[tuple[float, float]]:
    """Move the yaw set-point; return set-point and angle every 10 ms."""
    pairs = []
    while w.t < until_s - 1e-9:
        w.gimbal.aim(yaw(w.t), -0.4)
        w.advance(w.t + 0.01)
        pairs.append((yaw(w.t), w.gimbal.yaw.angle))
    return pairs


def test_lags_behind_a_moving_target_by_its_lag() -> None:
    target, angle = turn(world(), 1.5, lambda t: 0.4 * t)[-1]
    assert (target - angle) / 0.4 == pytest.approx(0.08, abs=0.025)


def test_reaches_a_target_within_half_a_second() -> None:
    pairs = turn(world(), 1.0, lambda t: 0.2)
    assert all(angle == pytest.approx(0.2, abs=0.01) for _, angle in pairs[50:])


def test_turns_no_faster_than_its_motor() -> None:
    angles = [a for _, a in turn(world(gimbal={"rate_limit_deg_s": 60.0}), 1.0, lambda t: 1.5)]
    fastest = max(b - a for a, b in pairwise(angles)) / 0.01
    assert math.degrees(fastest) == pytest.approx(60.0, abs=1.0)


def test_stops_at_its_limits() -> None:
    w = world()
    w.gimbal.aim(math.radians(120.0), math.radians(-200.0))
    w.advance(10.0)
    assert math.degrees(w.gimbal.yaw.angle) == pytest.approx(90.0, abs=1.0)
    assert w.gimbal.yaw.angle <= math.pi / 2.0
    assert w.gimbal.pitch.angle >= -math.pi


def run_device(
    scenario: Callable[[World, SimGimbal], Awaitable[None]],
    options: SimGimbalOptions | None = None,
) -> None:
    async def main() -> None:
        w = world()
        chosen = options or SimGimbalOptions()
        gimbal = SimGimbal(SimMount(w, chosen, Random(5)), chosen)
        await gimbal.open()
        await scenario(w, gimbal)
        await gimbal.close()

    run_virtual(main())


def test_reports_biased_angles_fifty_times_a_second() -> None:
    async def scenario(w: World, gimbal: SimGimbal) -> None:
        reports = [await gimbal.state() for _ in range(100)]
        assert reports[-1].t - reports[0].t == pytest.approx(99 * 0.02)
        assert all(r.reference is Reference.BODY for r in reports)
        errors = [math.degrees(r.pitch - w.gimbal.pitch.angle) for r in reports]
        assert abs(statistics.mean(errors)) == pytest.approx(0.5, abs=0.03)
        assert statistics.pstdev(errors) == pytest.approx(0.05, abs=0.02)

    run_device(scenario)


def test_takes_commands_and_drops_what_is_no_number() -> None:
    async def scenario(w: World, gimbal: SimGimbal) -> None:
        gimbal.command(GimbalCommand(0.3, -1.0))
        gimbal.command(GimbalCommand(math.nan, -1.0))
        gimbal.command(GimbalCommand(0.0, math.inf))
        await asyncio.sleep(2.0)
        last = await gimbal.state()
        assert last.yaw == pytest.approx(0.3, abs=0.02)
        assert last.pitch == pytest.approx(-1.0, abs=0.03)

    run_device(scenario)


def test_without_an_encoder_it_reports_what_was_commanded() -> None:
    async def scenario(w: World, gimbal: SimGimbal) -> None:
        gimbal.command(GimbalCommand(0.0, -1.5))
        state = await gimbal.state()
        assert state.pitch == pytest.approx(-1.5, abs=1e-9)
        assert not state.pitch_measured
        assert w.gimbal.pitch.angle > -1.0
        gimbal.command(GimbalCommand(0.5, -1.5))
        assert (await gimbal.state()).yaw < 0.4  # yaw is measured all the same

    run_device(scenario, SimGimbalOptions(pitch_feedback=False, bias_deg=0.0, noise_deg=0.0))


def test_pitch_may_stand_further_beside_than_yaw() -> None:
    async def scenario(w: World, gimbal: SimGimbal) -> None:
        state = await gimbal.state()
        assert state.pitch_measured
        yaw_off = math.degrees(state.yaw - w.gimbal.yaw.angle)
        pitch_off = math.degrees(state.pitch - w.gimbal.pitch.angle)
        assert abs(yaw_off) == pytest.approx(0.5, abs=1e-6)
        assert abs(pitch_off) == pytest.approx(3.0, abs=1e-6)

    run_device(scenario, SimGimbalOptions(pitch_bias_deg=3.0, noise_deg=0.0))


def test_faults() -> None:
    async def scenario(w: World, gimbal: SimGimbal) -> None:
        before = await gimbal.state()
        gimbal.fault = GimbalFault.FROZEN
        gimbal.command(GimbalCommand(0.5, -1.0))
        await asyncio.sleep(1.0)
        frozen: GimbalState = await gimbal.state()
        assert (frozen.yaw, frozen.pitch) == (before.yaw, before.pitch)
        assert frozen.t >= before.t + 1.0

        gimbal.fault = GimbalFault.NAN
        assert math.isnan((await gimbal.state()).yaw)

        gimbal.fault = GimbalFault.SILENT
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(gimbal.state(), 1.0)

        gimbal.fault = GimbalFault.LOST
        with pytest.raises(DeviceLost):
            await gimbal.state()
        with pytest.raises(DeviceLost):
            await gimbal.open()
        gimbal.fault = None
        await gimbal.open()
        assert (await gimbal.state()).yaw == pytest.approx(0.5, abs=0.03)

    run_device(scenario)
