"""The simulated computer that runs landerd: how long its searches take, how it stalls."""

import asyncio
import time
from contextvars import Context, copy_context
from random import Random

from hw.sim.options import CompanionOptions
from landerd.runtime.clock import STALLS, VirtualLoop

VISION_LATENCY_S = 0.025  # searching a frame on a Raspberry Pi 4, modelled
# Least time between two stalls, s, so that they do not join to one longer than configured.
RUNS_S = 0.1


class Companion:
    """The simulated companion computer's timing."""

    def __init__(self, options: CompanionOptions, rng: Random) -> None:
        self._options = options
        self._rng = rng

    @property
    def vision_latency_s(self) -> float:
        """How long the search of a picture takes, s."""
        return VISION_LATENCY_S * self._options.vision_factor

    def context(self) -> Context:
        """Return the context for tasks that run on this computer."""
        context = copy_context()
        context.run(STALLS.set, True)
        return context

    async def stall(self) -> None:
        """Stall now and then, until cancelled: garbage collection, an SD card, other processes."""
        options = self._options
        while options.stall_s > 0.0:
            runs_s = RUNS_S + self._rng.expovariate(1.0 / options.stall_every_s)
            await asyncio.sleep(options.stall_s + runs_s)
            stand_still(options.stall_s)


def stand_still(duration_s: float) -> None:
    """Hold up all tasks that run in the computer's context."""
    loop = asyncio.get_running_loop()
    if isinstance(loop, VirtualLoop):
        loop.stall(duration_s)
    else:
        time.sleep(duration_s)
