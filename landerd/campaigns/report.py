"""Makes the report of stored campaigns: tables beside the thesis's, figures, the worst flights."""

import importlib.util
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from landerd.analysis.page import Block, Heading, Lines, Table, Text
from landerd.campaigns.effects import Nominal, effects_of
from landerd.campaigns.failures import CLASSES, GRAVE, as_lines, failure, is_feasible
from landerd.campaigns.fault_table import as_lines as fault_lines
from landerd.campaigns.fault_table import failures
from landerd.campaigns.figures import figures
from landerd.campaigns.journal import Kept
from landerd.campaigns.plan import Campaign, Row
from landerd.campaigns.pool import Run
from landerd.campaigns.poses import bin_cells, remarks
from landerd.campaigns.rows import make_rows, runs_of
from landerd.campaigns.table import best_rows, cells, notes

WORST = 5
Again = Callable[[Row, int], str]  # the command line that flies a row's seed again


def blocks_of(kept: Kept, again: Again, nominal: Nominal) -> list[Block]:
    """Return the report's blocks on all campaigns of a file.

    Args:
        kept: the file, with a plan.
        again: returns the command line that repeats a flight.
        nominal: returns the value of a key when it is not swept.
    """
    blocks: list[Block] = []
    for name, campaign in kept.plan.campaigns.items():
        runs = runs_of(campaign, kept.runs.values())
        if runs:
            blocks += [Heading(campaign.title or name, 2), Text(_flown(kept, runs.values()))]
            blocks += _tables(campaign, runs, nominal)
            blocks += _figures(campaign, runs)
            blocks += _worst(campaign, runs, again)
    return blocks


def _flown(kept: Kept, runs: Iterable[Sequence[Run]]) -> str:
    """Return a text: how many were flown, when, by which landerd, and with which changes."""
    count = sum(len(flown) for flown in runs)
    versions = list(dict.fromkeys(s.version for s in kept.sittings))
    dates = list(dict.fromkeys(s.began.partition(" ")[0] for s in kept.sittings))
    text = f"{count} runs"
    if versions:
        text += f", {' and '.join(dates)}, landerd {' and '.join(versions)}"
    else:
        text += ", of a date and a landerd that the file does not tell"
    changes = " ".join(kept.plan.command)
    return f"{text}; with {changes}." if changes else f"{text}."


def _tables(campaign: Campaign, runs: Mapping[str, Sequence[Run]], nominal: Nominal) -> list[Block]:
    swept = {row.name for sweep in campaign.sweeps for row in sweep.rows()}
    rows = make_rows(campaign, [run for flown in runs.values() for run in flown])
    flights = [row for row in rows if "bins" not in row and row["scenario"] not in swept]
    blocks: list[Block] = []
    if flights:
        shown = flights if campaign.best is None else best_rows(flights, campaign.best)
        head, *lines = cells(shown)
        blocks.append(Table(head, lines))
    said = [note for row in flights for note in notes(row)]
    effects = effects_of(campaign, runs, nominal)
    if effects is not None:
        blocks.append(effects.table)
        said += effects.said
    for row in rows:
        blocks += _of_row(row)
    return [*blocks, Lines(said)] if said else blocks


def _of_row(row: Mapping[str, Any]) -> list[Block]:
    """Return further blocks on one row."""
    blocks: list[Block] = []
    if "bins" in row:
        head, *lines = bin_cells(row)
        title = f"{row['label']}: {row['marker']}, {row['pictures']} pictures"
        blocks += [Heading(title, 3), Table(head, lines), Lines(remarks(row))]
    if "days" in row:
        blocks.append(Lines(as_lines(row["days"])))
    if "faults" in row:
        blocks.append(Lines(fault_lines(row["faults"]), is_table=True))
    return blocks


def _figures(campaign: Campaign, runs: Mapping[str, Sequence[Run]]) -> list[Block]:
    if importlib.util.find_spec("matplotlib") is None:
        return []
    return list(figures(campaign, runs))


def _worst(campaign: Campaign, runs: Mapping[str, Sequence[Run]], again: Again) -> list[Block]:
    """Return the flights that failed, the gravest first, or those that ended farthest off."""
    of = [
        (run, campaign.row(name))
        for name, flown in runs.items()
        for run in flown
        if campaign.row(name).goal == "landing"
    ]
    worst = sorted(of, key=lambda each: _badness(*each), reverse=True)[:WORST]
    if not worst:
        return []
    lines = []
    for run, row in worst:
        lines += [f"# {_what(run, row)}", again(row, run.seed)]
    told = "With `--log flight.mcap` it is recorded; `landerd report flight.mcap` shows it."
    return [Heading("The worst flights, and how to fly them again", 3), Lines(lines), Text(told)]


def _badness(run: Run, row: Row) -> tuple[float, float, float]:
    result = run.result or {}
    failed = _kinds(run, row)
    return (
        len(CLASSES) - min(map(_gravity, failed)) if failed else 0.0,
        abs(result.get("touchdown_error_m") or 0.0),
        result.get("time_s") or 0.0,
    )


def _gravity(kind: str) -> int:
    return CLASSES.index(kind) if kind in CLASSES else 1


def _kinds(run: Run, row: Row) -> list[str]:
    if row.faults:
        return failures(run)
    kind = failure(run)
    if kind is None or not (is_feasible(run) or kind in GRAVE):
        return []
    return [kind]


def _what(run: Run, row: Row) -> str:
    """Return the outcome of a flight in words."""
    result = run.result
    if result is None:
        return f"{row.label or row.scenario}: {run.error}"
    parts = [row.label or row.scenario, *_kinds(run, row), result["outcome"]]
    if result["touchdown_error_m"] is not None:
        parts.append(f"{result['touchdown_error_m']:.3f} m off")
    if result["time_s"] is not None:
        parts.append(f"{result['time_s']:.1f} s")
    return ", ".join([*parts, *result["rules_broken"]])
