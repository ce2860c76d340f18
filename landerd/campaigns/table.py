"""The results of a campaign: one row per scenario, as numbers and as text."""

import math
from collections.abc import Callable, Sequence
from statistics import stdev
from typing import Any

from landerd.analysis.intervals import in_percent, mean_interval, percentile, wilson, with_interval
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
    nis = _spread("nis_ratio", _values(results, "nis_ratio"))
    nis_mean = nis["nis_ratio_mean"]
    figures: dict[str, Any] = {
        "scenario": row.name,
        "runs": len(runs),
        "label": row.label or row.name,
        "landed": len(landings),
        "landed_95": wilson(len(landings), len(runs)),
        **_spread("time_s", _values(landings, "time_s")),
        **_spread("time_to_touchdown_s", _values(landings, "time_to_touchdown_s")),
        **_spread("energy_hj", _values(landings, "energy_hj")),
        "thesis": row.thesis.model_dump(),
        **_spread("touchdown_error_m", errors),
        "touchdown_error_m_median": percentile(errors, 50.0),
        "touchdown_error_m_p95": percentile(errors, 95.0),
        "touchdown_vertical_mps_p95": percentile(vertical, 95.0),
        "touchdown_vertical_mps_max": max(vertical, default=None),
        "yaw_error_deg_p95": percentile(yaw, 95.0),
        "yaw_error_deg_max": max(yaw, default=None),
        "hold_error_m_p95": percentile(_values(results, "hold_error_m_p95"), 95.0),
        **_spread("off_centre_px_p95", _values(results, "off_centre_px_p95")),
        "pad_velocity_error_mps_p95": percentile(_values(results, "pad_velocity_error_mps"), 95.0),
        **nis,
        "nis_deviation": None if nis_mean is None else abs(nis_mean - 1.0),
        **_spread("refused_percent", _values(results, "refused_percent")),
        "aborts": sum(r["aborts"] for r in results),
        "rules_broken": sum(len(seeds) for seeds in breaches.values()),
        "breaches": breaches,
        "exceptions": len(runs) - len(results),
        "errors": {str(run.seed): run.error for run in runs if run.error is not None},
        "failed_seeds": sorted(run.seed for run in runs if has_failed_to_land(run)),
    }
    figures["missed"] = _missed(figures, row.needed)
    return figures


def has_failed_to_land(run: Run) -> bool:
    """Tell whether a run did not land, broke a rule or raised an error."""
    result = run.result
    return result is None or not result.get("landed", True) or bool(result.get("rules_broken"))


def best_rows(rows: Sequence[dict[str, Any]], count: int) -> list[dict[str, Any]]:
    """Return the rows that the thesis has, and the count best: all landed, then quickest."""

    def order(row: dict[str, Any]) -> tuple[float, float]:
        return -row["landed"] / row["runs"], row["time_s_mean"] or math.inf

    ordered = sorted(rows, key=order)
    return [r for i, r in enumerate(ordered) if i < count or r["thesis"]["time_s"] is not None]


def as_text(rows: Sequence[dict[str, Any]], width: int) -> str:
    """Return the table, and below it notes on single rows.

    Args:
        rows: of `make_row`.
        width: characters of a line; columns for which there is no room come in a further table.
    """
    table = cells(rows)
    widths = [max(len(line[i]) for line in table) for i in range(len(table[0]))]
    lines: list[str] = []
    for columns in _that_fit(widths, width):
        lines += ["", *(_line(line, widths, columns) for line in table)]
    return "\n".join([*lines[1:], *(note for row in rows for note in notes(row))])


def cells(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Return the table's cells, its heads first.

    Args:
        rows: of `make_row`.
    """
    shown = [column for column in _COLUMNS if column[0] not in _AT_TIMES or _has(rows, column)]
    return [[head for head, _ in shown], *([text(row) for _, text in shown] for row in rows)]


def _has(
    rows: Sequence[dict[str, Any]], column: tuple[str, Callable[[dict[str, Any]], str]]
) -> bool:
    return any(column[1](row) != "-" for row in rows)


def right_aligned(cells: Sequence[Sequence[str]], *, indent: int) -> list[str]:
    """Return a table's lines, the first column to the left and all others to the right."""
    columns = range(len(cells[0]))
    widths = [max(len(line[i]) for line in cells) for i in columns]
    return [" " * indent + _line(line, widths, columns).rstrip() for line in cells]


def _that_fit(widths: Sequence[int], width: int) -> list[list[int]]:
    """Return the columns of each table; each has the first one, and at least one other."""
    tables = [[0]]
    for i in range(1, len(widths)):
        table = tables[-1]
        if len(table) > 1 and sum(2 + widths[j] for j in (*table, i)) - 2 > width:
            table = [0]
            tables.append(table)
        table.append(i)
    return tables


def _line(cells: Sequence[str], widths: Sequence[int], columns: Sequence[int]) -> str:
    return "  ".join(cells[i].rjust(widths[i]) if i else cells[i].ljust(widths[i]) for i in columns)


def notes(row: dict[str, Any]) -> list[str]:
    """Return notes on a row: the requirements it missed, and which seeds failed and how."""
    name = row["label"]
    said = [f"{name}: {missed}" for missed in row["missed"]]
    if row["failed_seeds"]:
        seeds = ", ".join(str(seed) for seed in row["failed_seeds"])
        said.append(f"{name}: failed with seeds {seeds}")
    for rule, seeds in row["breaches"].items():
        said.append(f"{name}: rule {rule} (seeds {', '.join(map(str, seeds))})")
    said += [f"{name}: seed {seed}: {error}" for seed, error in row["errors"].items()]
    return said


def _number(key: str, digits: int) -> Callable[[dict[str, Any]], str]:
    def text(row: dict[str, Any]) -> str:
        value = row[key]
        return "-" if value is None else f"{value:.{digits}f}"

    return text


def _with_interval(key: str, digits: int) -> Callable[[dict[str, Any]], str]:
    return lambda row: with_interval(row[f"{key}_mean"], row[f"{key}_mean_95"], digits)


def _published(key: str) -> Callable[[dict[str, Any]], str]:
    def text(row: dict[str, Any]) -> str:
        value = row["thesis"][key]
        return "-" if value is None else f"{value:g}"

    return text


# Columns that are shown only where there is something in them.
_AT_TIMES = ("thesis s", "thesis hJ", "hold m p95")
_COLUMNS: list[tuple[str, Callable[[dict[str, Any]], str]]] = [
    ("scenario", lambda row: str(row["label"])),
    ("landed", lambda row: f"{row['landed']}/{row['runs']}"),
    ("95 %", lambda row: in_percent(row["landed_95"])),
    ("time s", _with_interval("time_s", 1)),
    ("thesis s", _published("time_s")),
    ("energy hJ", _with_interval("energy_hj", 1)),
    ("thesis hJ", _published("energy_hj")),
    ("error m", _number("touchdown_error_m_median", 3)),
    ("p95", _number("touchdown_error_m_p95", 3)),
    ("down m/s p95", _number("touchdown_vertical_mps_p95", 2)),
    ("yaw deg p95", _number("yaw_error_deg_p95", 1)),
    ("hold m p95", _number("hold_error_m_p95", 3)),
    ("off px", _with_interval("off_centre_px_p95", 0)),
    ("vel m/s p95", _number("pad_velocity_error_mps_p95", 2)),
    ("NIS", _with_interval("nis_ratio", 2)),
    ("refused %", _with_interval("refused_percent", 1)),
    ("aborts", _number("aborts", 0)),
    ("rules", _number("rules_broken", 0)),
    ("exceptions", _number("exceptions", 0)),
]


def _missed(figures: dict[str, Any], needed: Needed) -> list[str]:
    """Return in words which requirements were not met."""
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
    return [abs(value) for r in results if (value := r.get(key)) is not None]


def _spread(key: str, values: Sequence[float]) -> dict[str, Any]:
    """Return mean, its 95 % interval, and standard deviation."""
    return {
        f"{key}_mean": _mean(values),
        f"{key}_mean_95": mean_interval(values),
        f"{key}_sd": stdev(values) if len(values) > 1 else None,
    }


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
