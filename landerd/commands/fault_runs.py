"""What `landerd campaign` knows of faults: which a seed has, and the least that still fails."""

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
SHRUNK_SEEDS, SHRUNK_FLIGHTS = 3, 12  # so many failing seeds, with so many flights each
_LEAST_S, _LEAST_SEVERITY = 0.2, 0.05


def settings_of(seed: int, faults: Sequence[FaultOptions] | None = None) -> tuple[str, ...]:
    """Return what `--set` takes for a seed's flight with its own faults, or with these."""
    drawn = draw_faults(seed) if faults is None else list(faults)
    return (PILOT, as_setting(drawn))


def command(row: Row, seed: int, faults: Sequence[FaultOptions], overrides: Sequence[str]) -> str:
    """Return the command line that flies a flight again."""
    settings = (*row.settings, *overrides, *settings_of(seed, faults))
    sets = " ".join(f"--set {shlex.quote(each)}" for each in settings)
    return f"landerd sim {row.scenario} --seed {seed} {sets}"


def shrink(
    row: Row, run: Run, fly: Callable[[Sequence[FaultOptions]], Run], overrides: Sequence[str]
) -> dict[str, Any]:
    """Return the least that still fails as a flight did, and the command that flies it.

    Args:
        row: of the flight.
        run: that failed.
        fly: flies it again with other faults.
        overrides: of the campaign.
    """
    kinds = set(failures(run))

    def fails(faults: Sequence[FaultOptions]) -> bool:
        return bool(kinds & set(failures(fly(faults))))

    least = shrunk(draw_faults(run.seed), fails, _lesser, SHRUNK_FLIGHTS)
    return {
        "scenario": row.name,
        "seed": run.seed,
        "failures": sorted(kinds),
        "again": command(row, run.seed, least, overrides),
    }


def _lesser(fault: FaultOptions) -> list[FaultOptions]:
    lesser = []
    if fault.lasts_s and fault.lasts_s > 2.0 * _LEAST_S:
        lesser.append(fault.model_copy(update={"for_s": round(0.5 * fault.lasts_s, 2)}))
    if fault.severity > 2.0 * _LEAST_SEVERITY:
        lesser.append(fault.model_copy(update={"severity": round(0.5 * fault.severity, 2)}))
    return lesser
