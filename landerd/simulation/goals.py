"""Parts of a landing, flown alone, as the thesis tuned its controllers (3.5.1, 3.5.3)."""

import asyncio
import math
from collections.abc import Callable
from typing import Any, Literal

from landerd.config.files import Loaded
from landerd.devices import sim_options
from landerd.runtime.clock import run_virtual
from landerd.simulation.flight import LONGEST_S, Simulation
from landerd.simulation.path import path_of
from landerd.simulation.result import result_of

APPROACH_M = 1.6  # an approach succeeds by staying within this horizontal distance of the pad
APPROACH_HELD_S = 3.0  # for this long
APPROACH_LIMIT_S = 45.0  # within this time after the first sighting
TURN_S = 10.0  # time for which a turn is watched
TURN_DEG = 5.0  # a turn succeeds if it ends within this of the pad's heading
WATCH_S = 0.1

Part = Literal["approach", "turn"]


class _Approach:
    """Watches for a vehicle that stays near the pad."""

    reached_t: float | None = None
    overshoot = 0.0  # farthest from the pad after the first time near it, m
    limit_s = APPROACH_LIMIT_S

    def __init__(self) -> None:
        self._near_since: float | None = None
        self._was_near = False

    def look(self, simulation: Simulation, now: float) -> bool:
        """Return whether the flight may end."""
        distance = math.hypot(*simulation.world.offset)
        if distance > APPROACH_M:
            self._near_since = None
            if self._was_near:
                self.overshoot = max(self.overshoot, distance)
            return False
        self._was_near = True
        if self._near_since is None:
            self._near_since = now
        if now - self._near_since >= APPROACH_HELD_S:
            self.reached_t = now
        return self.reached_t is not None


class _Turn:
    """Watches for a vehicle that has turned to the pad's heading, and stays so."""

    reached_t: float | None = None
    overshoot = 0.0  # farthest beyond the pad's heading, deg
    limit_s = TURN_S

    def __init__(self) -> None:
        self._began_at = math.nan

    def look(self, simulation: Simulation, now: float) -> bool:
        """Return whether the flight may end."""
        error = math.degrees(simulation.world.heading_error)
        if math.isnan(self._began_at):
            self._began_at = error
        if error * self._began_at < 0.0 and abs(error) < 90.0:
            self.overshoot = max(self.overshoot, abs(error))
        if abs(error) > TURN_DEG:
            self.reached_t = None
        elif self.reached_t is None:
            self.reached_t = now
        return False


_PARTS: dict[Part, Callable[[], _Approach | _Turn]] = {"approach": _Approach, "turn": _Turn}


def simulate_part(
    loaded: Loaded,
    part: Part,
    scenario: str,
    seed: int,
    *,
    longest_s: float = LONGEST_S,
    with_path: bool = False,
) -> dict[str, Any]:
    """Fly a part of a landing; return what `landerd sim --json` prints, as far as it has a meaning.

    `landed` says whether the goal was reached, `time_s` how soon after the first sighting within
    18 m (an approach: the time that it had to be held is in it, as in the thesis), `energy_hj` what
    was used until the flight was over. Judged from truth; the thesis judged by its own estimate.

    Raises:
        CalibrationError: the camera's calibration cannot be used.
        PadError: the pad's layout cannot be used.
    """
    watch = _PARTS[part]()
    energies: list[float] = []

    async def look_on(simulation: Simulation) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(WATCH_S)
            first = simulation.score.first_sighting_t
            if first is None:
                continue
            simulation.world.advance(loop.time())
            energies.append(simulation.world.battery.energy_j)
            if watch.look(simulation, loop.time()) or loop.time() - first > watch.limit_s:
                simulation.over = True
                return

    simulation = Simulation(loaded, seed)
    run_virtual(simulation.run(longest_s=longest_s, script=look_on))
    result = result_of(simulation.flown(), scenario, seed)
    first, reached_t = simulation.score.first_sighting_t, watch.reached_t
    reached = first is not None and reached_t is not None
    return {
        **result,
        **({"path": path_of(simulation.recording, first)} if with_path else {}),
        "landed": reached,
        "outcome": "reached" if reached else f"{part} not reached",
        "time_s": reached_t - first if first is not None and reached_t is not None else None,
        "energy_hj": (energies[-1] - energies[0]) / 100.0 if reached else None,
        "yaw_error_deg": math.degrees(simulation.world.heading_error) if part == "turn" else None,
        "overshoot": watch.overshoot,
        "sight": sim_options(loaded).sight,
        "world": simulation.drawn,
        "infeasible": None,
    }
