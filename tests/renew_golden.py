"""Flies the golden flights again and writes their logs (`make golden`).

A golden log is a short flight of the simulator as the core saw it: its messages and its commands,
nothing else. `tests/test_golden.py` replays them; after an intended change of what the core does
they are renewed, and the difference is looked at before it is committed.
"""

import asyncio
import tempfile
from collections.abc import Sequence
from pathlib import Path

from landerd.commands.replay import config_of
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.flightlog.contents import Head
from landerd.flightlog.disk import SyncedFile
from landerd.flightlog.reader import read_log
from landerd.flightlog.replay import replay
from landerd.flightlog.writer import LogWriter
from landerd.runtime.clock import run_virtual
from landerd.simulation.flight import Simulation
from tests.simulated import ABOVE, AS_FOUND, SEEN, Script

FOLDER = Path(__file__).parent / "golden"
LOW = (
    *(*ABOVE, SEEN, AS_FOUND, "sim.start.altitude_m=1.0"),
    *("log.images=none", "log.keep_free_mb=0.0"),
)


async def close_gate(simulation: Simulation) -> None:
    """The pilot takes over in the descent and gives it back."""
    pilot, channel = simulation.autopilot.pilot, simulation.config.rc.gate_channel
    await asyncio.sleep(2.5)
    pilot.set(channel, 1100)
    await asyncio.sleep(0.6)
    pilot.set(channel, 1900)


async def cut_link(simulation: Simulation) -> None:
    """The cable to the autopilot comes loose for a second."""
    await asyncio.sleep(2.5)
    simulation.link.cut()
    await asyncio.sleep(1.0)
    simulation.link.mend()


FLIGHTS: dict[str, tuple[Sequence[str], Script | None, float]] = {
    "landing": (LOW, None, 30.0),
    "moving-pad": ((*LOW, "sim.pad.speed_mps=0.4", "sim.wind.speed_mps=3.0"), None, 6.0),
    "gate-closed": (LOW, close_gate, 5.0),
    "link-cut": (LOW, cut_link, 6.0),
}


def fly(name: str, path: Path) -> None:
    """Fly one of them and write its log."""
    overrides, script, longest_s = FLIGHTS[name]
    loaded = read_configuration(
        config_dir() / "default.yaml",
        overlays=[config_dir() / "scenarios" / "stationary.yaml"],
        overrides=overrides,
    )
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "whole.mcap"
        simulation = Simulation(loaded, 1, log=whole)
        run_virtual(simulation.run(longest_s=longest_s, script=script))
        assert simulation.recorder is not None
        simulation.recorder.close()
        log = read_log(whole)
    path.unlink(missing_ok=True)
    file = SyncedFile(path)
    config, _ = config_of(log, [])
    writer = LogWriter(file, Head(config, log.layout, log.camera))
    for step in log.steps:
        writer.step(step.number, step.now, step.message, step.commands)
    writer.finish()
    file.close()


def holds(path: Path) -> bool:
    """Tell whether today's core still commands what the log says."""
    if not path.exists():
        return False
    log = read_log(path)
    config, unknown = config_of(log, [])
    return not unknown and not log.notes and replay(log, config).comparison.identical


def main() -> None:
    """Renew those that do not hold any more; the others would only make the repository grow."""
    for name in FLIGHTS:
        path = FOLDER / f"{name}.mcap"
        if holds(path):
            print(f"{path.name}: identical, kept")
            continue
        fly(name, path)
        log = read_log(path)
        print(f"{path.name}: {log.steps[-1].now:.1f} s, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
