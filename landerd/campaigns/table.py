"""What came of a campaign: one row a scenario, as numbers and as text."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from landerd.campaigns.plan import Needed, Row
from landerd.campaigns.pool import Run


def make_row(row: Row, runs: Sequence[Run]) -> dict[str, Any]:
    """Return the figures of all runs of one scenario.

    Times and energy are those of the landings, touch-down figures those of every touch-down, on
    the pad or not; a figure of which there is none is None.
    """
    results = [run.result for run in runs if run.result is not None]
    landings = [r for r in results if r["landed"]]
    breaches: dict[str, list[int]] = {}
    for r in results:
        for rule in r["rules_broken"]:
            breaches.setdefault(_rule(rule), []).append(r["seed"])
    errors = _values(results, "touchdown_error_m")
    vertical = _values(results, "touchdown_vertical_mps")
    yaw = _values(results, "yaw_error_deg")
    nis = _mean(_values(results, "nis_ratio"))
    figures: dict[str, Any] = {
        "scenario": row.name,
        "runs": len(runs),
        "landed": len(landings),
        "time_s_mean": _mean(_values(landings, "time_s")),
        "time_to_touchdown_s_mean": _mean(_values(landings, "time_to_touchdown_s")),
        "energy_hj_mean": _mean(_values(landings, "energy_hj")),
        "touchdown_error_m_median": percentile(errors, 50.0),
        "touchdown_error_m_p95": percentile(errors, 95.0),
        "touchdown_vertical_mps_p95": percentile(vertical, 95.0),
        "touchdown_vertical_mps_max": max(vertical, default=None),
        "yaw_error_deg_p95": percentile(yaw, 95.0),
        "yaw_error_deg_max": max(yaw, default=None),
        "pad_velocity_error_mps_p95": percentile(_values(results, "pad_velocity_error_mps"), 95.0),
        "nis_ratio_mean": nis,
        "nis_deviation": None if nis is None else abs(nis - 1.0),
        "refused_percent_mean": _mean(_values(results, "refused_percent")),
        "aborts": sum(r["aborts"] for r in results),
        "rules_broken": sum(len(seeds) for seeds in breaches.values()),
        "breaches": breaches,
        "exceptions": len(runs) - len(results),
        "errors": {str(run.seed): run.error for run in runs if run.error is not None},
        "failed_seeds": sorted(run.seed for run in runs if has_failed(run)),
    }
    figures["missed"] = _missed(figures, row.needed)
    return figures


def has_failed(run: Run) -> bool:
    """Tell whether a run did not land, broke a rule or raised an error."""
    return run.result is None or not run.result["landed"] or bool(run.result["rules_broken"])


def percentile(values: Sequence[float], percent: float) -> float | None:
    """Return a percentile, interpolated between the two values next to it; None of no values."""
    if not values:
        return None
    ordered = sorted(values)
    at = (len(ordered) - 1) * percent / 100.0
    below = math.floor(at)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (at - below) * (ordered[above] - ordered[below])


def as_text(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table, and below it what is to be said of single rows."""
    cells = [[head for head, _ in _COLUMNS]]
    cells += [[text(row) for _, text in _COLUMNS] for row in rows]
    widths = [max(len(line[i]) for line in cells) for i in range(len(_COLUMNS))]
    lines = [
        "  ".join(
            cell.rjust(width) if i else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in cells
    ]
    return "\n".join([*lines, *(note for row in rows for note in _notes(row))])


def _notes(row: dict[str, Any]) -> list[str]:
    name = row["scenario"]
    notes = [f"{name}: {missed}" for missed in row["missed"]]
    if row["failed_seeds"]:
        seeds = ", ".join(str(seed) for seed in row["failed_seeds"])
        notes.append(f"{name}: failed with seeds {seeds}")
    for rule, seeds in row["breaches"].items():
        notes.append(f"{name}: rule {rule} (seeds {', '.join(map(str, seeds))})")
    notes += [f"{name}: seed {seed}: {error}" for seed, error in row["errors"].items()]
    return notes


def _number(key: str, digits: int) -> Callable[[dict[str, Any]], str]:
    def text(row: dict[str, Any]) -> str:
        value = row[key]
        return "-" if value is None else f"{value:.{digits}f}"

    return text


_COLUMNS: list[tuple[str, Callable[[dict[str, Any]], str]]] = [
    ("scenario", lambda row: str(row["scenario"])),
    ("landed", lambda row: f"{row['landed']}/{row['runs']}"),
    ("time s", _number("time_s_mean", 1)),
    ("energy hJ", _number("energy_hj_mean", 1)),
    ("error m", _number("touchdown_error_m_median", 3)),
    ("p95", _number("touchdown_error_m_p95", 3)),
    ("down m/s p95", _number("touchdown_vertical_mps_p95", 2)),
    ("yaw deg p95", _number("yaw_error_deg_p95", 1)),
    ("velocity m/s p95", _number("pad_velocity_error_mps_p95", 2)),
    ("NIS", _number("nis_ratio_mean", 2)),
    ("refused %", _number("refused_percent_mean", 1)),
    ("aborts", _number("aborts", 0)),
    ("rules", _number("rules_broken", 0)),
    ("exceptions", _number("exceptions", 0)),
]


def _missed(figures: dict[str, Any], needed: Needed) -> list[str]:
    """Say what of the needed was not reached."""
    missed = []
    percent = 100.0 * (figures["runs"] - len(figures["failed_seeds"])) / figures["runs"]
    if percent < needed.landed_percent:
        missed.append(f"{percent:.0f} % landed by the rules, needed {needed.landed_percent:.0f} %")
    if figures["rules_broken"] or figures["exceptions"]:
        missed.append("rules broken or exceptions, needed none")
    for key, limit in needed:
        value = figures.get(key)
        if key != "landed_percent" and limit is not None and (value is None or value > limit):
            found = "unknown" if value is None else f"{value:.3g}"
            missed.append(f"{key} {found}, needed at most {limit:g}")
    return missed


def _rule(text: str) -> str:
    """Return a broken rule without its time."""
    return text.partition(" (at ")[0]


def _values(results: Sequence[dict[str, Any]], key: str) -> list[float]:
    return [abs(r[key]) for r in results if r[key] is not None]


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
