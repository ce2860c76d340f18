"""The computer that landerd runs on, as simulated: how long it searches, how it stalls."""

import asyncio
import time
from contextvars import Context, copy_context
from random import Random

from hw.sim.options import CompanionOptions
from landerd.runtime.clock import STALLS, VirtualLoop

VISION_LATENCY_S = 0.025  # searching a frame on a Raspberry Pi 4, modelled
# It runs for so long between two stalls, or they would be one longer than the options say, s.
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
        """Return the context of what runs on this computer."""
        context = copy_context()
        context.run(STALLS.set, True)
        return context

    async def stall(self) -> None:
        """Stand still now and then, for ever: a garbage collection, an SD card, other work."""
        options = self._options
        while options.stall_s > 0.0:
            runs_s = RUNS_S + self._rng.expovariate(1.0 / options.stall_every_s)
            await asyncio.sleep(options.stall_s + runs_s)
            stand_still(options.stall_s)


def stand_still(duration_s: float) -> None:
    """Hold up all that runs in the computer's context."""
    loop = asyncio.get_running_loop()
    if isinstance(loop, VirtualLoop):
        loop.stall(duration_s)
    else:
        time.sleep(duration_s)
