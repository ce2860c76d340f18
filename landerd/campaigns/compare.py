"""Two campaigns against each other, flight by flight: the same row and seed are a pair.

A pair meets the same day (start, errors, wind), so that their difference tells more than two means.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, NamedTuple

from landerd.analysis.intervals import mcnemar, mean_interval, paired_difference, wilson
from landerd.campaigns.fault_table import failures
from landerd.campaigns.pool import Run, Task
from landerd.campaigns.table import has_failed_to_land, right_aligned

ALL = "all rows"
SIGNIFICANT = 0.05


class Figure(NamedTuple):
    """A figure of a result of which less is better; its magnitude counts."""

    key: str
    unit: str
    digits: int


FIGURES = (
    Figure("time_s", "s", 2),
    Figure("energy_hj", "hJ", 2),
    Figure("touchdown_error_m", "m", 3),
    Figure("touchdown_vertical_mps", "m/s", 3),
    Figure("touchdown_horizontal_mps", "m/s", 3),
    Figure("yaw_error_deg", "deg", 2),
)


@dataclass(frozen=True)
class Pair:
    """The same landing flown twice."""

    a: Run
    b: Run


def pairs(a: Mapping[Task, Run], b: Mapping[Task, Run]) -> dict[str, list[Pair]]:
    """Return the pairs of each row that both have, in the first one's order."""
    found: dict[str, list[Pair]] = {}
    for task, run in a.items():
        if task in b:
            found.setdefault(task[0], []).append(Pair(run, b[task]))
    return found


def compare(a: Mapping[Task, Run], b: Mapping[Task, Run]) -> list[dict[str, Any]]:
    """Return the changes of each row from a to b, and of all rows together if there are several."""
    of = pairs(a, b)
    rows = [compare_row(name, row) for name, row in of.items()]
    if len(of) > 1:
        rows.append(compare_row(ALL, [pair for row in of.values() for pair in row]))
    return rows


def compare_row(name: str, row: Sequence[Pair]) -> dict[str, Any]:
    """Return the changes in one row's pairs: of the share that succeeded, and of each figure.

    A success has landed and broken no rule. Figures are those of pairs in which both have one.
    """
    return {
        "scenario": name,
        "pairs": len(row),
        "succeeded": _rates(row),
        "figures": {f.key: found for f in FIGURES if (found := _means(row, f.key)) is not None},
    }


def has_failed(run: Run) -> bool:
    """Tell whether a run failed, by the standards of its own row."""
    if run.result is not None and run.result.get("faults_flown"):
        return bool(failures(run))
    return has_failed_to_land(run)


def _rates(row: Sequence[Pair]) -> dict[str, Any]:
    only_a = [p.a.seed for p in row if not has_failed(p.a) and has_failed(p.b)]
    only_b = [p.a.seed for p in row if has_failed(p.a) and not has_failed(p.b)]
    both = sum(not has_failed(p.a) and not has_failed(p.b) for p in row)
    p_value = mcnemar(len(only_a), len(only_b))
    a, b = both + len(only_a), both + len(only_b)
    return {
        "a": a,
        "a_95": wilson(a, len(row)),
        "b": b,
        "b_95": wilson(b, len(row)),
        "change": (b - a) / len(row),
        "change_95": paired_difference(len(only_a), len(only_b), len(row)),
        "only_a_seeds": only_a,
        "only_b_seeds": only_b,
        "mcnemar_p": p_value,
        "verdict": _verdict(a - b, sure=p_value < SIGNIFICANT),
    }


def _means(row: Sequence[Pair], key: str) -> dict[str, Any] | None:
    known = [(x, y) for p in row if (x := _value(p.a, key)) is not None
             and (y := _value(p.b, key)) is not None]  # fmt: skip
    if not known:
        return None
    differences = [y - x for x, y in known]
    interval = mean_interval(differences)
    change = fmean(differences)
    sure = interval is not None and not interval[0] <= 0.0 <= interval[1]
    return {
        "pairs": len(known),
        "a_mean": fmean(x for x, _ in known),
        "b_mean": fmean(y for _, y in known),
        "change": change,
        "change_95": interval,
        "verdict": _verdict(change, sure=sure),
    }


def _value(run: Run, key: str) -> float | None:
    value = None if run.result is None else run.result.get(key)
    return None if value is None else abs(float(value))


def _verdict(change: float, *, sure: bool) -> str:
    """Return a verdict in words on a change of a figure of which less is better."""
    if change == 0.0 or not sure:
        return "same"
    return "better" if change < 0.0 else "worse"


# ---- as text -------------------------------------------------------------------------------------


def as_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table for each row, with "better" or "worse" in the last column."""
    lines: list[str] = []
    for row in rows:
        cells = [["", "A", "B", "change", "95 %", ""], _rate_cells(row)]
        units = {f.key: f for f in FIGURES}
        cells += [_mean_cells(units[key], found) for key, found in row["figures"].items()]
        lines += [f"{row['scenario']} ({row['pairs']} pairs)", *right_aligned(cells, indent=2)]
        lines += _seed_lines(row["succeeded"])
    return "\n".join([*lines, _caution(rows)])


def _rate_cells(row: Mapping[str, Any]) -> list[str]:
    rates, n = row["succeeded"], row["pairs"]
    low, high = (100.0 * share for share in rates["change_95"])
    return [
        "succeeded",
        _share(rates["a"], n, rates["a_95"]),
        _share(rates["b"], n, rates["b_95"]),
        f"{100.0 * rates['change']:+.1f} %",
        f"{low:+.1f} to {high:+.1f}, p {rates['mcnemar_p']:.2g}",
        rates["verdict"],
    ]


def _share(count: int, n: int, interval: tuple[float, float]) -> str:
    return f"{count}/{n} ({100 * interval[0]:.0f} to {100 * interval[1]:.0f} %)"


def _mean_cells(figure: Figure, found: Mapping[str, Any]) -> list[str]:
    digits, interval = figure.digits, found["change_95"]
    return [
        f"{figure.key.rpartition('_')[0].replace('_', ' ')} {figure.unit}",
        f"{found['a_mean']:.{digits}f}",
        f"{found['b_mean']:.{digits}f}",
        f"{found['change']:+.{digits}f}",
        "-" if interval is None else f"{interval[0]:+.{digits}f} to {interval[1]:+.{digits}f}",
        found["verdict"],
    ]


def _seed_lines(rates: Mapping[str, Any]) -> list[str]:
    return [
        f"  only {name} succeeds with seeds {', '.join(map(str, seeds[:15]))}"
        for name, seeds in (("A", rates["only_a_seeds"]), ("B", rates["only_b_seeds"]))
        if seeds
    ]


def _caution(rows: Sequence[Mapping[str, Any]]) -> str:
    tests = sum(1 + len(row["figures"]) for row in rows)
    by_chance = tests * SIGNIFICANT
    return f"{tests} comparisons: about {by_chance:.0f} would be better or worse by chance alone"
