"""Simulated faults in campaigns: those of a seed, and the smallest that make a flight fail."""

import shlex
from collections.abc import Callable, Sequence
from typing import Any

from hw.sim.fault_options import FaultOptions
from hw.sim.faults.draw import as_setting, draw_faults
from landerd.campaigns.fault_table import failures
from landerd.campaigns.plan import Row
from landerd.campaigns.pool import Run
from landerd.campaigns.shrink import shrunk

PILOT = "sim.pilot=obeys"
# Number of failed flights whose faults are reduced, and largest number of simulated flights that
# this takes for each.
SHRUNK_SEEDS, SHRUNK_FLIGHTS = 3, 12
# Faults are not reduced below this duration, s, and this severity.
_LEAST_S, _LEAST_SEVERITY = 0.2, 0.05


def faults_of(row: Row, seed: int) -> list[FaultOptions]:
    """Return the faults that a seed draws for a row with faults."""
    return draw_faults(seed, low=row.faults == "low")


def drawn_settings(row: Row, seed: int) -> tuple[str, ...]:
    """Return the settings for the faults that a seed draws; none for a row without faults."""
    return settings_of(faults_of(row, seed)) if row.faults else ()


def settings_of(faults: Sequence[FaultOptions]) -> tuple[str, ...]:
    """Return the settings (KEY=VALUE) for a flight with these faults."""
    return (PILOT, as_setting(list(faults)))


def command(row: Row, seed: int, faults: Sequence[FaultOptions], overrides: Sequence[str]) -> str:
    """Return the command line that repeats a flight with faults.

    Args:
        row: of the campaign.
        seed: of the flight.
        faults: of the flight.
        overrides: KEY=VALUE, of the campaign's command line.
    """
    settings = (*row.settings, *overrides, *settings_of(faults))
    sets = " ".join(f"--set {shlex.quote(each)}" for each in settings)
    return f"landerd sim {row.scenario} --seed {seed} {sets}"


def shrink(
    row: Row, run: Run, fly: Callable[[Sequence[FaultOptions]], Run], overrides: Sequence[str]
) -> dict[str, Any]:
    """Reduce the faults of a failed flight to the smallest that still make it fail likewise.

    Args:
        row: of the campaign.
        run: the failed flight.
        fly: repeats the flight with other faults.
        overrides: KEY=VALUE, of the campaign's command line.

    Returns:
        Row and seed of the flight, its failures, and the command that flies the smallest faults.
    """
    kinds = set(failures(run))

    def fails(faults: Sequence[FaultOptions]) -> bool:
        return bool(kinds & set(failures(fly(faults))))

    least = shrunk(faults_of(row, run.seed), fails, _lesser, SHRUNK_FLIGHTS)
    return {
        "scenario": row.name,
        "seed": run.seed,
        "failures": sorted(kinds),
        "again": command(row, run.seed, least, overrides),
    }


def _lesser(fault: FaultOptions) -> list[FaultOptions]:
    """Return lesser variants of a fault: half as long, and half as severe."""
    lesser = []
    if fault.lasts_s and fault.lasts_s > 2.0 * _LEAST_S:
        lesser.append(fault.model_copy(update={"for_s": round(0.5 * fault.lasts_s, 2)}))
    if fault.severity > 2.0 * _LEAST_SEVERITY:
        lesser.append(fault.model_copy(update={"severity": round(0.5 * fault.severity, 2)}))
    return lesser
