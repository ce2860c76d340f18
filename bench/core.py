"""CPU time of the core per picture (after vision) and per control step, in simulated flights.

It is measured twice: in flight, with vision in between, whose data push the core's out of the
caches; and again with the same messages alone, as the least of several runs, which other programs
on the machine do not disturb. Times are the process's CPU time. The last column is in units of a
fixed piece of plain Python that is measured in the same run, so that machines can be compared.
Exits with code 1 if even the mean of the least times is above the limit.
"""

import sys
import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import numpy as np

from landerd.config.files import Loaded, config_dir, config_files
from landerd.drivers import read_configuration
from landerd.geometry import matmul, rot_zyx
from landerd.lander import Lander
from landerd.messages import Input
from landerd.pad import load_pad
from landerd.runtime.clock import run_virtual
from landerd.simulation.flight import Simulation

# Limits of the mean times of a picture, with its prior, and of a control step.
MOST_US = {"Sightings": 300.0, "Tick": 100.0}
NAMES = {"Sightings": "picture", "Tick": "control step"}
SCENARIOS = ("stationary", "moving-5")
SEED = 1
TIMES = 5  # number of runs with the same messages

Call = Input | float  # a message, or the time for which a prior is requested


def calls(core: Lander, call: Call) -> Any:
    """Give the core a message, or request a prior from it; return the result."""
    return core.prior(call) if isinstance(call, float) else core.step(call)


def timed_us(core: Lander, call: Call) -> float:
    """Return the CPU time of a call, us."""
    start = time.process_time_ns()
    calls(core, call)
    return 1e-3 * (time.process_time_ns() - start)


def fly(loaded: Loaded) -> tuple[list[Call], list[float]]:
    """Fly one landing; return the calls of the core, and the CPU time of each, us."""
    asked: list[Call] = []
    us: list[float] = []

    def watched(method: Callable[[Lander, Any], Any]) -> Callable[[Lander, Any], Any]:
        def call(core: Lander, argument: Any) -> Any:
            start = time.process_time_ns()
            result = method(core, argument)
            us.append(1e-3 * (time.process_time_ns() - start))
            asked.append(argument)
            return result

        return call

    with (
        patch.object(Lander, "step", watched(Lander.step)),
        patch.object(Lander, "prior", watched(Lander.prior)),
    ):
        run_virtual(Simulation(loaded, SEED).run())
    return asked, us


def fly_again(loaded: Loaded, asked: list[Call]) -> list[float]:
    """Give new cores the same calls, several times; return the least CPU time of each, us."""
    least = [float("inf")] * len(asked)
    for _ in range(TIMES):
        core = Lander(loaded.config, load_pad(loaded.config.pad.layout))
        least = [min(us, timed_us(core, call)) for us, call in zip(least, asked, strict=True)]
    return least


def by_kind(asked: list[Call], us: list[float]) -> dict[str, list[float]]:
    """Return the CPU times, us, by kind of message; that of a picture includes its prior."""
    costs: dict[str, list[float]] = {}
    prior_us = 0.0
    for call, cost in zip(asked, us, strict=True):
        kind = type(call).__name__
        if isinstance(call, float):
            prior_us = cost
            continue
        if kind == "Sightings":
            cost, prior_us = cost + prior_us, 0.0  # noqa: PLW2901
        costs.setdefault(kind, []).append(cost)
    return costs


def unit_us() -> float:
    """Return the CPU time of a product of two 3x3 matrices, us, which the core mostly computes."""
    a = rot_zyx(0.1, 0.2, 0.3)
    times = []
    for _ in range(200):
        start = time.process_time_ns()
        for _ in range(100):
            matmul(a, a)
        times.append(1e-5 * (time.process_time_ns() - start))
    return float(np.percentile(times, 5.0))


def main() -> int:
    """Print the table; return the exit code."""
    unit = unit_us()
    print(f"unit: a product of two 3x3 matrices, {unit:.2f} us")
    print(
        f"{'us':26} {'calls':>6} {'in flight':>9} {'p95':>6} {'again':>6} {'p95':>6} {'asked':>6} "
        f"{'units':>6}"
    )
    slow = False
    for scenario in SCENARIOS:
        loaded = read_configuration(
            config_dir() / "default.yaml", overlays=[config_files("scenarios")[scenario]]
        )
        asked, us = fly(loaded)
        flown, again = by_kind(asked, us), by_kind(asked, fly_again(loaded, asked))
        for kind in sorted(flown, key=lambda kind: -sum(flown[kind])):
            most = MOST_US.get(kind)
            mean = float(np.mean(again[kind]))
            slow = slow or (most is not None and mean > most)
            print(
                f"{scenario + ', ' + NAMES.get(kind, kind):26} {len(flown[kind]):6} "
                f"{np.mean(flown[kind]):9.1f} {np.percentile(flown[kind], 95.0):6.1f} "
                f"{mean:6.1f} {np.percentile(again[kind], 95.0):6.1f} "
                f"{f'{most:6.0f}' if most else '':6} {mean / unit:6.0f}"
            )
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
