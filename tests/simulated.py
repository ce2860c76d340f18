"""Short simulated flights for tests: the whole daemon, real bytes, virtual time."""

from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path

from landerd.config.files import Loaded, config_dir
from landerd.drivers import read_configuration
from landerd.runtime.clock import run_virtual
from landerd.simulation.flight import Simulation

SEEN = "sim.sight=pictures"  # drawn and searched
MODELLED = "sim.sight=modelled"  # takes a third of the time
ABOVE = (  # close over the pad, so that a landing takes seconds
    MODELLED,
    "sim.start.position_m=[-0.8, 0.4]",  # the ground station sends nobody who is so near
    "sim.start.altitude_m=3.0",
    "sim.start.spread_m=0.0",
    "sim.camera.fps=15.0",  # half of what there is to search
    "aim.idle_pitch_deg=-70.0",
)
AS_FOUND = "sim.camera.fps=30.0"  # where a seed or a height was found by flights of all pictures
Script = Callable[[Simulation], Awaitable[None]]


def fly(
    script: Script | None = None,
    *,
    longest_s: float = 30.0,
    overrides: Sequence[str] = ABOVE,
    seed: int = 1,
    log: Path | None = None,
) -> Simulation:
    """Fly the stationary scenario with overrides to its end and return it; log: recorded there."""
    simulation = Simulation(configured(overrides), seed, log=log)
    run_virtual(simulation.run(longest_s=longest_s, script=script))
    if simulation.recorder is not None:
        simulation.recorder.close()
    return simulation


def configured(overrides: Sequence[str]) -> Loaded:
    """Return the configuration of the stationary scenario with overrides."""
    return read_configuration(
        config_dir() / "default.yaml",
        overlays=[config_dir() / "scenarios" / "stationary.yaml"],
        overrides=overrides,
    )
