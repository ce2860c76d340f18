"""The link fails in flight: nothing is flown on stale data, and with good data it flies on."""

import asyncio
import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from landerd.messages import Phase
from landerd.simulation.flight import Simulation
from tests.simulated import MODELLED, fly

pytestmark = pytest.mark.long

BAD_S, BACK_S = 3.2, 2.0


def cut(simulation: Simulation) -> None:
    simulation.link.cut()


def corrupt(simulation: Simulation) -> None:
    for end in (simulation.link, simulation.autopilot_end):
        end.faults.corrupt = 0.05


def drop(simulation: Simulation) -> None:
    for end in (simulation.link, simulation.autopilot_end):
        end.faults.drop = 0.3


def mend(simulation: Simulation) -> None:
    simulation.link.mend()
    for end in (simulation.link, simulation.autopilot_end):
        end.faults.corrupt = end.faults.drop = 0.0


@pytest.mark.parametrize("fault", [cut, corrupt, drop])
def test_it_flies_again_within_two_seconds_of_good_data(
    fault: Callable[[Simulation], None],
) -> None:
    flown: list[tuple[float, Any]] = []
    seen: dict[str, float] = {}

    async def script(simulation: Simulation) -> None:
        codec, judge = mavlink.MAVLink(None), simulation.rules.from_landerd

        def tap(t: float, data: bytes) -> None:
            for m in codec.parse_buffer(bytearray(data)) or []:
                if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                    flown.append((t, m))
            judge(t, data)

        simulation.link.tap = tap
        while simulation.daemon.lander.phase is Phase.NOT_LANDING:
            await asyncio.sleep(0.05)
        await asyncio.sleep(1.0)
        fault(simulation)
        await asyncio.sleep(BAD_S)
        mend(simulation)
        seen["mended"] = asyncio.get_running_loop().time()

    start = ("sim.start.position_m=[-14, 3]", "sim.start.altitude_m=8")
    overrides = [MODELLED, "sim.camera.fps=15", *start]
    simulation = fly(script, longest_s=8.2, overrides=overrides)
    back = seen["mended"] + BACK_S
    after = [m for t, m in flown if back < t < back + 0.5]
    assert len(after) >= 10
    assert any(math.hypot(m.vx, m.vy, m.vz) > 0.05 for m in after)
    # Orders that do not get through are the link's fault, all other rules hold.
    links = ("3: set-points less often than 20 Hz", "1b: silent without stop orders first")
    assert set(simulation.rules.broken) <= {*links}
