"""Step responses of an ArduCopter in SITL beside those of the stand-in.

Run as `python -m tests.simulation.sitl_steps tcp:127.0.0.1:5760`; the vehicle takes off by itself.
"""

import asyncio
import sys

from bench.step_response import MEASURED, TIMES_S, answer
from hw.autopilots.mavlink import MavlinkAutopilot
from hw.sim.sitl import SitlWorld, State
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.messages import Setpoint
from landerd.runtime.clock import run_slaved
from landerd.simulation.sitl import Script, SitlFlight

_HEIGHT_M = 30.0
_SETTLES_S = 5.0
_PERIOD_S = 0.05
_LIMIT_S = 300.0


class StepFlight(SitlFlight):
    """Flies one step after the other; `values` has velocity over the step at each of TIMES_S."""

    def __init__(self, url: str) -> None:
        loaded = read_configuration(config_dir() / "default.yaml")
        super().__init__(loaded, 1, url, take_off_m=_HEIGHT_M)
        self.values: dict[str, list[float]] = {}

    async def fly(self, world: SitlWorld, script: Script | None) -> None:
        """Fly the steps in place of a landing."""
        await self.while_reading(self._steps(), _LIMIT_S, "the steps were not flown")

    async def _steps(self) -> None:
        loop = asyncio.get_running_loop()
        driver = MavlinkAutopilot(self.link.side())
        for name, (axis, start, order, _) in MEASURED.items():
            await self._stream(driver, axis, start, loop.time() + _SETTLES_S)
            ordered_t, step = loop.time(), abs(order - start)
            values = self.values[name] = []
            for t in TIMES_S:  # each seen a little later: then the truth is known
                await self._stream(driver, axis, order, ordered_t + t + 2.0 * _PERIOD_S)
                values.append(_component(axis, self.truth.at(ordered_t + t)) / step)

    async def _stream(
        self, driver: MavlinkAutopilot, axis: str, speed: float, until_t: float
    ) -> None:
        """Order a speed (m/s or rad/s) on an axis until a time, s."""
        forward, down, turn = (speed if axis == a else 0.0 for a in ("forward", "down", "yaw"))
        loop = asyncio.get_running_loop()
        driver.fly(Setpoint((forward, 0.0, down), turn))
        while (left := until_t - loop.time()) > 0.0:
            await asyncio.sleep(min(_PERIOD_S, left))
            driver.fly(Setpoint((forward, 0.0, down), turn))


def _component(axis: str, state: State) -> float:
    if axis == "yaw":
        return state.rates[2]
    return state.velocity[0 if axis == "forward" else 2]


def compare(url: str) -> dict[str, float]:
    """Print both, and return the largest difference of each step as a share of the step."""
    flight = StepFlight(url)
    run_slaved(flight.run())
    differences = {}
    print(f"{flight.version}, {flight.rate:.2f} times real time; velocity over the step")
    for name, (axis, start, order, _) in MEASURED.items():
        ours, theirs = answer(axis, start, order), flight.values[name]
        differences[name] = max(abs(a - b) for a, b in zip(ours, theirs, strict=True))
        print(f"{name}: largest difference {100.0 * differences[name]:.1f} % of the step")
        print("  t s     ", *(f"{t:7.1f}" for t in TIMES_S))
        print("  SITL    ", *(f"{v:7.3f}" for v in theirs))
        print("  stand-in", *(f"{v:7.3f}" for v in ours))
    return differences


if __name__ == "__main__":
    compare(sys.argv[1])
