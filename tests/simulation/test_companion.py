"""The simulated computer stands still as long as it is told to, and no longer."""

import asyncio
import itertools
from random import Random

from hw.sim.options import CompanionOptions
from landerd.runtime.clock import run_virtual
from landerd.simulation.companion import Companion

PERIOD_S = 0.025


def test_two_stalls_never_merge_into_one() -> None:
    companion = Companion(CompanionOptions(stall_s=0.1, stall_every_s=0.2), Random(1))
    turns: list[float] = []

    async def control() -> None:
        while True:
            turns.append(asyncio.get_running_loop().time())
            await asyncio.sleep(PERIOD_S)

    async def main() -> None:
        tasks = [
            asyncio.create_task(control(), context=companion.context()),
            asyncio.create_task(companion.stall()),
        ]
        await asyncio.sleep(60.0)
        for task in tasks:
            task.cancel()

    run_virtual(main())
    gaps = [after - before for before, after in itertools.pairwise(turns)]
    stalls = [gap for gap in gaps if gap > 2.0 * PERIOD_S]
    assert len(stalls) > 100
    assert max(stalls) <= 0.1 + PERIOD_S + 1e-6
