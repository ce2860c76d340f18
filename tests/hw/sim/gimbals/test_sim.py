import asyncio
import math
import statistics
from collections.abc import Awaitable, Callable
from random import Random

import pytest

from hw.sim.gimbals.mount import SimMount
from hw.sim.gimbals.sim import GimbalFault, SimGimbal
from hw.sim.options import SimGimbalOptions
from hw.sim.physics.world import World
from landerd.messages import GimbalCommand, GimbalState, Reference
from landerd.ports import DeviceLost
from landerd.runtime.clock import run_virtual
from tests.hw.sim.worlds import world


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
        state = await gimbal.state()
        assert state.yaw < 0.4  # yaw is measured all the same
        assert state.yaw_measured

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


def test_faults_freeze_corrupt_silence_or_lose_the_gimbal() -> None:
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
