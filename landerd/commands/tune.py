"""`landerd tune`: finds gains, by a search in the simulator or from recorded flights."""

import argparse
import contextlib
import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from landerd.campaigns.compare import Pair
from landerd.campaigns.journal import Journal, JournalError
from landerd.campaigns.plan import Campaign
from landerd.campaigns.pool import Run, Task
from landerd.campaigns.search import Place, SearchError, Tried, check_cma_es, cma_es, grid
from landerd.campaigns.search_page import page_of
from landerd.campaigns.tuning import (
    FRESH_FROM,
    Cost,
    Tuning,
    Values,
    check,
    cost_of,
    load_tuning,
    overlay,
    settings_of,
)
from landerd.commands.flying import SimulatedLanding, add_flying, executor, fly_all
from landerd.commands.keeping import journal_of
from landerd.commands.shared import (
    InputError,
    add_config,
    add_json,
    check_not_read,
    check_output,
    check_stand_in_flies,
    config_path,
    file_name,
    print_json,
    refusing,
    settings_of_file,
    tell,
    whole_number,
    write_text,
)
from landerd.commands.tune_from import tune_from
from landerd.config.files import ConfigError, Loaded, config_files, default_config
from landerd.config.parameters import value_of
from landerd.drivers import read_configuration

LONGEST_S = 90.0  # a simulated flight that is not over after this time has failed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    names = ", ".join(config_files("tunings"))
    parser.add_argument("name", nargs="?", metavar="NAME", help=f"{names}, or a FILE.yaml")
    parser.add_argument(
        "--from",
        dest="flights",
        type=file_name,
        nargs="+",
        metavar="FLIGHT.mcap",
        help="no search: fit the vehicle's response to the orders in these logs, and propose gains",
    )
    parser.add_argument(
        "-o", dest="out", type=file_name, metavar="FILE.yaml", help="write the gains"
    )
    parser.add_argument(
        "--report",
        type=file_name,
        metavar="FILE.html",
        help="write a page with a picture of the search",
    )
    parser.add_argument(
        "--search",
        choices=("cma-es", "grid"),
        default="cma-es",
        help="method of the search (cma-es)",
    )
    parser.add_argument(
        "--sets",
        type=whole_number(4),
        metavar="N",
        help="number of sets of values to try; without: as NAME says",
    )
    add_flying(parser)
    add_json(parser)
    add_config(parser)


def run(args: argparse.Namespace) -> int:
    """Search gains and write them.

    Returns:
        0, or 1 if no better gains were found, or they are not better on fresh seeds; with --from as
        `tune_from`.

    Raises:
        InputError: an argument, the configuration or a file cannot be used.
    """
    check_output(args.out, ".yaml", "-o")
    for read in (args.config, args.name and Path(args.name)):
        check_not_read(args.out, read)
    check_output(args.report, ".html", "--report")
    if (args.name is None) == (args.flights is None):
        raise InputError("expected NAME, or --from FLIGHT.mcap")
    if args.flights is not None:
        if args.report is not None:
            raise InputError("--report: expected a search, --from makes none")
        return tune_from(args)
    args.config = None if args.config is None else config_path(args)
    with refusing(ConfigError, JournalError, SearchError):
        tuning = load_tuning(args.name)
        # In a campaign --set replaces the rows' settings; here the values tried replace --set.
        changed: dict[str, Any] = {"settings": (*tuning.settings, *args.set)}
        if args.sets is not None:
            changed["sets"] = args.sets
        tuning = tuning.model_copy(update=changed)
        if args.search == "cma-es":
            check_cma_es(len(tuning.parameters), tuning.sets)
        start = _start(tuning, args)
        journal = journal_of(args, _fingerprint(tuning, args), {})
    with journal or contextlib.nullcontext():
        return _search(args, _Flights(tuning, args, journal), start)


def _start(tuning: Tuning, args: argparse.Namespace) -> dict[str, float]:
    """Return the configuration's values of the parameters, by key.

    The configuration is also read with both ends of every range, so that values that it does not
    allow are refused before the search.

    Raises:
        ConfigError: the configuration cannot be used, or a key is no number in it.
        InputError: the simulated autopilot cannot fly it.
    """
    values = {}
    for key, (least, most) in tuning.parameters.items():
        for end in (least, most):
            _load(tuning, args, settings_of({key: end}))
        loaded = _load(tuning, args)
        check_stand_in_flies(loaded)
        try:
            values[key] = value_of(loaded.config, key)
        except (AttributeError, TypeError, ValueError):
            raise ConfigError([f"{key}: expected a number of the configuration"]) from None
    return values


def _load(tuning: Tuning, args: argparse.Namespace, settings: Sequence[str] = ()) -> Loaded:
    """Return the configuration with the tuning's settings and these. Raises ConfigError."""
    path, overrides = args.config or default_config(), (*tuning.settings, *settings)
    own = [each for each in overrides if each not in args.set]
    with settings_of_file(args.name, own):
        return read_configuration(path, overrides=overrides, seed=1)


def _fingerprint(tuning: Tuning, args: argparse.Namespace) -> str:
    """Return a hash of the tuning and the configuration; it identifies the runs of --keep."""
    config = _load(tuning, args).config.model_dump_json()
    return hashlib.sha256(f"{tuning.model_dump_json()} {config}".encode()).hexdigest()


class _Flights:
    """Flies sets of values in the simulator; a run flown once is reused.

    Attributes:
        tuning: the parameters, their ranges, scenarios and objective.
    """

    def __init__(self, tuning: Tuning, args: argparse.Namespace, journal: Journal | None) -> None:
        self.tuning = tuning
        self._args, self._journal = args, journal
        self._runs: dict[Task, Run] = dict(journal.runs) if journal else {}

    def costs(self, places: Sequence[Place], seeds: Sequence[int]) -> list[Cost]:
        """Return the cost of each place, from the runs with all these seeds.

        Args:
            places: sets of values, each parameter as a number from 0 to 1 within its range.
            seeds: of the simulated flights.
        """
        sets = [self.tuning.at(place) for place in places]
        return [cost_of(runs, self.tuning.objective) for runs in self.fly(sets, seeds)]

    def fly(self, sets: Sequence[Values], seeds: Iterable[int]) -> list[list[Run]]:
        """Return the runs of each set of values, ordered by scenario and then by seed."""
        by_set = [self.tuning.rows(values) for values in sets]
        # Several sets may have the same row, as values are rounded.
        rows = {row.name: row for rows in by_set for row in rows}
        campaign = Campaign(rows=tuple(rows.values()), longest_s=LONGEST_S)
        landing = SimulatedLanding(campaign, self._args.config, ())
        tasks = [(name, seed) for seed in seeds for name in rows]
        flown: list[Run] = []
        waiting = [task for task in tasks if task not in self._runs]
        fly_all(landing, waiting, executor(self._args), self._journal, flown)
        self._runs |= {(run.scenario, run.seed): run for run in flown}
        return [
            [self._runs[row.name, seed] for row in rows_of_set for seed in seeds]
            for rows_of_set in by_set
        ]


def _search(args: argparse.Namespace, flights: _Flights, start: Values) -> int:
    """Search the best values, check them on fresh seeds, and report; return the exit code."""
    tuning = flights.tuning
    seeds = range(1, tuning.seeds + 1)
    place = tuple(tuning.place(start))
    (start_runs,) = flights.fly([start], seeds)
    start_cost = cost_of(start_runs, tuning.objective)
    tell(f"as it is: {_in_words(start_cost)}")
    generations: list[list[Tried]] = []
    if args.search == "grid":
        generations.append(list(grid(len(place), tuning.steps, seeds, flights.costs)))
    else:
        for generation in cma_es(place, tuning.sets, seeds, flights.costs):
            generations.append(generation)
            best = _best(generations)
            count = sum(map(len, generations))
            tell(f"{count} sets: {_in_words(best.cost)} {tuning.at(best.place)}")
    best = _best(generations)
    found: dict[str, Any] = {
        "tuning": args.name,
        "search": args.search,
        "sets": sum(map(len, generations)),
        "start": {"values": dict(start), "cost": start_cost._asdict()},
        "winner": {"values": tuning.at(best.place), "cost": best.cost._asdict()},
        "fresh": None,
    }
    if best.cost < start_cost:
        fresh = range(FRESH_FROM, FRESH_FROM + tuning.fresh)
        a, b = flights.fly([start, tuning.at(best.place)], fresh)
        pairs = [Pair(x, y) for x, y in zip(a, b, strict=True)]
        found["fresh"] = check(pairs, tuning.objective)
    return _tell_and_write(args, tuning, generations, found)


def _best(generations: Sequence[Sequence[Tried]]) -> Tried:
    """Return the set of the lowest cost, of those flown with all seeds."""
    return min((t for tried in generations for t in tried if t.whole), key=lambda t: t.cost)


def _tell_and_write(
    args: argparse.Namespace,
    tuning: Tuning,
    generations: Sequence[Sequence[Tried]],
    found: dict[str, Any],
) -> int:
    """Print the result, write the files asked for, and return the exit code.

    Args:
        args: of the command line.
        tuning: the parameters, their ranges, scenarios and objective.
        generations: all sets that were tried.
        found: the result, as `--json` prints it.
    """
    fresh = found["fresh"]
    values = found["winner"]["values"]
    lines = [
        f"landerd tune {args.name}: {found['sets']} sets of values by {found['search']}, "
        f"{', '.join(tuning.scenarios)}",
        f"as it was {_in_words(Cost(**found['start']['cost']))}, "
        f"found {_in_words(Cost(**found['winner']['cost']))}",
    ]
    if fresh is None:
        lines.append("nothing better than the configuration as it is was found")
    else:
        verdict = "holds" if fresh["holds"] else f"DOES NOT HOLD: {'; '.join(fresh['why_not'])}"
        lines.append(f"on {tuning.fresh} fresh seeds of each it {verdict}")
    if fresh is not None and fresh["change_95"] is not None:
        low, high = fresh["change_95"]
        lines.append(
            f"cost there {fresh['cost_a']:.3f}, then {fresh['cost_b']:.3f}; change "
            f"{low:+.3f} to {high:+.3f} (95 %)"
        )
    if args.json:
        print_json(_finite(found))
    else:
        print("\n".join([*lines, *(f"  {setting}" for setting in settings_of(values) if fresh)]))
    if fresh is not None and args.out is not None:
        write_text(args.out, overlay(values, lines))
    if args.report is not None:
        sets = {"as it was": found["start"]["values"], "found": values}
        title = f"landerd tune {args.name}"
        write_text(args.report, page_of(title, lines, tuning, generations, sets))
    return 0 if fresh is not None and fresh["holds"] else 1


def _finite(found: dict[str, Any]) -> dict[str, Any]:
    """Return the result for JSON: a mean that is infinite, as nothing landed, becomes None."""
    for which in ("start", "winner"):
        cost = found[which]["cost"]
        cost["mean"] = cost["mean"] if cost["mean"] < float("inf") else None
    return found


def _in_words(cost: Cost) -> str:
    return f"cost {cost.mean:.3f}, {100.0 * cost.failed:.0f} % failed"
