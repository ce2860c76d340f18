"""Sweeps as a table: a line for each effect and value, marking the first value that fails."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from landerd.analysis.page import Table
from landerd.campaigns.failures import GRAVE, failure, is_feasible
from landerd.campaigns.plan import Campaign, Sweep
from landerd.campaigns.pool import Run
from landerd.campaigns.table import has_failed_to_land, make_row, notes

FIRST, FURTHER, BEYOND = "first to fail", "fails", "beyond the vehicle"
Nominal = Callable[[str], Any]  # value of a key when it is not swept; None: not known


class _Line(NamedTuple):
    effect: str
    value: Any
    cells: list[str]
    fails: bool
    is_beyond: bool  # no vehicle could have landed in one of the scenarios
    said: list[str]


class Effects(NamedTuple):
    """The table, and a line on each failure in it."""

    table: Table
    said: list[str]


def effects_of(
    campaign: Campaign, runs: Mapping[str, Sequence[Run]], nominal: Nominal
) -> Effects | None:
    """Return the results of a campaign's sweeps; None: none was flown.

    A value fails if any of its flights in any scenario did not land, broke a rule or raised an
    error; if the vehicle could not have landed at all, only failures that are grave even then
    count. Of numbers the first to fail is the one nearest to the nominal value, on either side.

    Args:
        campaign: with the sweeps.
        runs: by the name of their row.
        nominal: of a key.
    """
    scenarios = list(dict.fromkeys(s for sweep in campaign.sweeps for s in sweep.scenarios))
    lines: list[_Line] = []
    marks: list[str] = []
    for sweep in campaign.sweeps:
        found = _lines(sweep, scenarios, _effect(sweep, campaign), runs)
        lines += found
        marks += _marks(found, nominal(sweep.key))
    if not lines:
        return None
    heads = ("landed", "time s", "p95 m", "rules")
    head = ["effect", "value", *(f"{s}: {h}" for s in scenarios for h in heads), ""]
    rows = [
        [line.effect, _shown(line.value), *line.cells, mark]
        for line, mark in zip(lines, marks, strict=True)
    ]
    strong = frozenset(i for i, mark in enumerate(marks) if mark == FIRST)
    said = [note for line in lines for note in line.said]
    return Effects(Table(head, rows, strong), said)


def _effect(sweep: Sweep, campaign: Campaign) -> str:
    """Return an effect's name, with the settings that not all sweeps have."""
    own = [s for s in sweep.settings if any(s not in other.settings for other in campaign.sweeps)]
    name = sweep.key.removeprefix("sim.")
    return f"{name} ({', '.join(s.removeprefix('sim.') for s in own)})" if own else name


def _lines(
    sweep: Sweep, scenarios: Sequence[str], effect: str, runs: Mapping[str, Sequence[Run]]
) -> list[_Line]:
    lines = []
    rows = {(row.scenario, row.settings[-1]): row for row in sweep.rows()}
    for value in sweep.values:
        cells, said = list[str](), list[str]()
        setting = f"{sweep.key}={json.dumps(value)}"
        of_value = {s: runs.get(rows[s, setting].name, ()) for s in sweep.scenarios}
        for scenario in scenarios:
            found = of_value.get(scenario, ())
            if not found:
                cells += [""] * 4
                continue
            row = make_row(rows[scenario, setting], found)
            label = f"{effect} {_shown(value)}, {scenario}"
            said += [*notes({**row, "label": label, "missed": []}), *_ends(label, found)]
            time_s, error = row["time_s_mean"], row["touchdown_error_m_p95"]
            cells += [
                f"{row['landed']}/{row['runs']}",
                "-" if time_s is None else f"{time_s:.1f}",
                "-" if error is None else f"{error:.3f}",
                str(row["rules_broken"]),
            ]
        flown = [run for found in of_value.values() for run in found]
        if flown:
            is_beyond = not all(map(is_feasible, flown))
            lines.append(_Line(effect, value, cells, any(map(_fails, flown)), is_beyond, said))
    return lines


def _fails(run: Run) -> bool:
    return has_failed_to_land(run) if is_feasible(run) else failure(run) in GRAVE


def _ends(label: str, runs: Sequence[Run]) -> Iterator[str]:
    """Yield how flights without a landing ended, and why they could not land, if so."""
    seeds: dict[str, list[str]] = {}
    for run in runs:
        if run.result is not None and not run.result["landed"]:
            beyond = run.result.get("infeasible")
            end = f"{run.result['outcome']} ({beyond})" if beyond else run.result["outcome"]
            seeds.setdefault(end, []).append(str(run.seed))
    for end, of in seeds.items():
        yield f"{label}: {end}: seeds {', '.join(of)}"


def _marks(lines: Sequence[_Line], nominal: Any) -> list[str]:
    """Return the marks of the last column."""
    failing = [line for line in lines if line.fails]
    first: list[_Line] = []
    if _is_number(nominal) and all(_is_number(line.value) for line in lines):
        for side in (-1.0, 1.0):
            off = [line for line in failing if side * (line.value - nominal) > 0.0]
            first += sorted(off, key=lambda line: abs(line.value - nominal))[:1]
        first += [line for line in failing if line.value == nominal]
    else:  # words and lists have no order
        first = failing
    return [
        FIRST if line in first else FURTHER if line.fails else BEYOND if line.is_beyond else ""
        for line in lines
    ]


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _shown(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
