"""Sweeps as a table: one line for each effect and value, and which value is the first to fail."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from landerd.analysis.page import Table
from landerd.campaigns.plan import Campaign, Sweep
from landerd.campaigns.pool import Run
from landerd.campaigns.table import has_failed, make_row, notes

FIRST, FURTHER = "first to fail", "fails"
Nominal = Callable[[str], Any]  # what a key is where nothing is swept; None: not known


class _Line(NamedTuple):
    effect: str
    value: Any
    cells: list[str]
    fails: bool
    said: list[str]


class Effects(NamedTuple):
    """The table, and what failed in it, a line each."""

    table: Table
    said: list[str]


def effects_of(
    campaign: Campaign, runs: Mapping[str, Sequence[Run]], nominal: Nominal
) -> Effects | None:
    """Return what came of a campaign's sweeps; None: none was flown.

    A value fails if any of its flights in any scenario did not land, broke a rule or raised an
    error. Of numbers the first to fail is the one nearest to the nominal value, on either side.

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
        cells, said, fails = list[str](), list[str](), False
        setting = f"{sweep.key}={json.dumps(value)}"
        of_value = {s: runs.get(rows[s, setting].name, ()) for s in sweep.scenarios}
        for scenario in scenarios:
            found = of_value.get(scenario, ())
            if not found:
                cells += [""] * 4
                continue
            row = make_row(rows[scenario, setting], found)
            fails = fails or any(has_failed(run) for run in found)
            said += notes({**row, "label": f"{effect} {_shown(value)}, {scenario}", "missed": []})
            time_s, error = row["time_s_mean"], row["touchdown_error_m_p95"]
            cells += [
                f"{row['landed']}/{row['runs']}",
                "-" if time_s is None else f"{time_s:.1f}",
                "-" if error is None else f"{error:.3f}",
                str(row["rules_broken"]),
            ]
        if any(of_value.values()):
            lines.append(_Line(effect, value, cells, fails, said))
    return lines


def _marks(lines: Sequence[_Line], nominal: Any) -> list[str]:
    """Return what stands in the last column."""
    failing = [line for line in lines if line.fails]
    first: list[_Line] = []
    if _is_number(nominal) and all(_is_number(line.value) for line in lines):
        for side in (-1.0, 1.0):
            off = [line for line in failing if side * (line.value - nominal) > 0.0]
            first += sorted(off, key=lambda line: abs(line.value - nominal))[:1]
        first += [line for line in failing if line.value == nominal]
    else:  # words and lists have no order
        first = failing
    return [FIRST if line in first else FURTHER if line.fails else "" for line in lines]


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _shown(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
