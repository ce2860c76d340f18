"""Results of flights with simulated faults."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from landerd.campaigns.failures import HARD_MPS, is_feasible
from landerd.campaigns.pool import Run

SHORT_S = 3.0  # a flight whose faults last no longer is expected to land
# Excused findings after which a vehicle no longer lands, or stands.
ENDED = ("6: said to have landed", "tipped over")
COLUMNS = ("APPROACH", "CLOSE_APPROACH", "YAW_CORRECTION", "DESCENT", "LANDED", "NOT_LANDING")


def failures(run: Run) -> list[str]:
    """Return in words the failures that landerd could have avoided."""
    result = run.result
    if result is None:
        return ["exception"]
    excused = set(result["excused"])
    broken = [
        each for each in (*result["rules_broken"], *result["findings"]) if each not in excused
    ]
    found = [each.partition(" (at ")[0] for each in broken]
    worst = result["worst_contact"]
    if worst["down_mps"] > HARD_MPS:
        found.append(f"contact above {HARD_MPS:g} m/s")
    if result["outcome"] == "landed" and not result["landed"] and not _was_ended(run):
        found.append("told to have landed, and has not")
    if is_short(run) and is_feasible(run) and not result["landed"]:
        found.append("not landed, though the faults were soon over")
    return found


def is_short(run: Run) -> bool:
    """Tell whether all faults happened, were short, and left a landing possible.

    If the pad drove out of the camera's reach meanwhile, it was not (hw.sim.judge.reach).
    """
    flown = (run.result or {}).get("faults_flown", [])
    were_short = all(
        each["began"] is not None
        and each["lands"]
        and each["lasts_s"] is not None
        and each["lasts_s"] <= SHORT_S
        for each in flown
    )
    return bool(flown) and were_short and not (_was_ended(run) or _lost_reach(run))


def _lost_reach(run: Run) -> bool:
    return (run.result or {}).get("pad_out_of_reach_s") is not None


def _was_ended(run: Run) -> bool:
    return any(each.startswith(ENDED) for each in (run.result or {}).get("excused", ()))


def summary(runs: Sequence[Run]) -> dict[str, Any]:
    """Return the counts by fault and phase, and every failure with its seeds."""
    kinds: dict[str, list[int]] = {}
    by_fault: dict[str, Counter[str]] = {}
    coverage: dict[str, Counter[str]] = {}
    for run in runs:
        found = failures(run)
        for kind in found:
            kinds.setdefault(kind, []).append(run.seed)
        for each in (run.result or {}).get("faults_flown", []):
            counts = by_fault.setdefault(each["fault"], Counter())
            counts["drawn"] += 1
            if each["began"] is None:
                continue
            counts["flown"] += 1
            counts["landed"] += bool(run.result and run.result["landed"])
            counts["failed"] += bool(found)
            coverage.setdefault(each["fault"], Counter())[each["phase"]] += 1
    short = [run for run in runs if is_short(run) and is_feasible(run)]
    return {
        "flights": len(runs),
        "failed_seeds": [run.seed for run in runs if failures(run)],
        "failures": kinds,
        "excused": _counted(e for run in runs for e in (run.result or {}).get("excused", [])),
        "by_fault": {name: dict(counts) for name, counts in sorted(by_fault.items())},
        "coverage": {name: dict(counts) for name, counts in sorted(coverage.items())},
        "short": len(short),
        "short_landed": sum(bool(run.result and run.result["landed"]) for run in short),
        "out_of_reach": sum(map(_lost_reach, runs)),
    }


def _counted(breaks: Iterable[str]) -> dict[str, int]:
    return dict(Counter(each.partition(" (at ")[0] for each in breaks))


def as_lines(found: dict[str, Any]) -> list[str]:
    """Return a summary in words: the table fault x phase, and what failed."""
    width = max((len(name) for name in found["by_fault"]), default=5)
    heads = [column.lower().replace("_", " ") for column in COLUMNS]
    lines = [f"{'fault'.ljust(width)}  flown  landed  failed  begun in: {', '.join(heads)}"]
    for name, counts in found["by_fault"].items():
        begun = found["coverage"].get(name, {})
        cells = " ".join(f"{begun.get(column, 0):4}" for column in COLUMNS)
        figures = f"{counts.get('flown', 0):5}  {counts.get('landed', 0):6}"
        lines.append(f"{name.ljust(width)}  {figures}  {counts.get('failed', 0):6}  {cells}")
    failed = len(found["failed_seeds"])
    lines.append(f"{found['flights']} flights, {failed} failed")
    short = f"{found['short_landed']} of {found['short']}"
    lines.append(f"{short} landed whose faults ended within {SHORT_S:g} s")
    if found["out_of_reach"]:
        lines.append(f"not counted there: {found['out_of_reach']} whose pad drove out of reach")
    for kind, seeds in sorted(found["failures"].items(), key=lambda item: -len(item[1])):
        lines.append(f"  {kind}: {len(seeds)}, seeds {', '.join(map(str, seeds[:15]))}")
    for kind, count in found["excused"].items():
        lines.append(f"  nobody could have kept: {kind}: {count}")
    return lines
