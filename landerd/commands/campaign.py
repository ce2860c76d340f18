"""`landerd campaign`: many simulated landings, and a table of what came of them."""

import argparse
import contextlib
import gc
import hashlib
import logging
import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

from hw.sim.fault_options import FaultOptions
from landerd.camera_model import CalibrationError, load_camera
from landerd.campaigns.failures import as_lines, summary
from landerd.campaigns.fault_table import as_lines as fault_lines
from landerd.campaigns.fault_table import failures
from landerd.campaigns.fault_table import summary as fault_summary
from landerd.campaigns.journal import Journal, JournalError
from landerd.campaigns.plan import Campaign, Row, load_campaign
from landerd.campaigns.pool import Run, Task, error_line, run_all
from landerd.campaigns.table import as_text, has_failed, make_row
from landerd.commands.fault_runs import SHRUNK_SEEDS, settings_of, shrink
from landerd.commands.shared import (
    add_config,
    add_json,
    check_faults,
    check_stand_in_flies,
    config_path,
    print_json,
    refusing,
    tell,
    whole_number,
)
from landerd.config.files import ConfigError, Loaded, config_files
from landerd.drivers import read_configuration
from landerd.pad import PadError, load_pad


@dataclass(frozen=True)
class _SimulatedLanding:
    """Flies one landing; what `landerd.campaigns` is handed."""

    campaign: Campaign
    config: Path
    overrides: tuple[str, ...]

    def __call__(self, name: str, seed: int) -> dict[str, Any]:
        from landerd.simulation.flight import simulate

        logging.basicConfig(level=logging.ERROR)  # faults are counted in the result
        row = self.campaign.row(name)
        longest_s = self.campaign.longest_s
        try:
            return simulate(self.load(row, seed), name, seed, longest_s=longest_s)
        finally:
            gc.collect()  # flights are circles of objects, and large

    def load(self, row: Row, seed: int = 1) -> Loaded:
        """Return the configuration of a row as a seed draws it. Raises ConfigError."""
        return self.load_with(row, seed, settings_of(seed) if row.faults else ())

    def load_with(self, row: Row, seed: int, settings: Sequence[str]) -> Loaded:
        """Return the same with further settings. Raises ConfigError."""
        overlays = [config_files("scenarios")[row.scenario]]
        overrides = (*row.settings, *self.overrides, *settings)
        return read_configuration(self.config, overlays=overlays, overrides=overrides, seed=seed)

    def fly_with(self, row: Row, seed: int, faults: Sequence[FaultOptions]) -> Run:
        """Fly a seed with these faults instead of its own."""
        from landerd.simulation.flight import simulate

        loaded = self.load_with(row, seed, settings_of(seed, faults))
        try:
            result = simulate(loaded, row.name, seed, longest_s=self.campaign.longest_s)
        except Exception as e:
            return Run(row.name, seed, None, error_line(e))
        return Run(row.name, seed, result)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    names = ", ".join(config_files("campaigns"))
    parser.add_argument("name", metavar="NAME", help=f"{names}, or a scenario of landerd sim")
    parser.add_argument(
        "--runs", type=_count, metavar="N", help="seeds 1 to N; without: what the campaign says"
    )
    parser.add_argument(
        "--jobs", type=_count, metavar="N", help="processes; without: one for every core"
    )
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="FILE",
        help="write every run down as it ends; runs that FILE holds are not flown again",
    )
    add_json(parser)
    add_config(parser)


def run(args: argparse.Namespace) -> int:
    """Fly the campaign; return 0, or 1 if a row misses what it needs."""
    with refusing(ConfigError, CalibrationError, PadError, JournalError):
        campaign = load_campaign(args.name)
        landing = _SimulatedLanding(campaign, config_path(args), tuple(args.set))
        loaded = [landing.load(row) for row in campaign.all_rows]
        for each in loaded:
            check_stand_in_flies(each)
            check_faults(each)
        load_camera(loaded[0].config.camera.calibration)
        load_pad(loaded[0].config.pad.layout)
        journal = Journal(args.keep, _settings(args.name, loaded)) if args.keep else None
    with journal or contextlib.nullcontext():
        return _fly(args, campaign, landing, journal)


def _settings(name: str, loaded: Iterable[Loaded]) -> str:
    """Return what tells a campaign's configuration from every other."""
    digest = hashlib.sha256(name.encode())
    for each in loaded:
        digest.update(each.config.model_dump_json().encode())
        for section in sorted(each.options):
            digest.update(f"{section} {each.options[section].model_dump_json()}".encode())
    return digest.hexdigest()


def _fly(
    args: argparse.Namespace,
    campaign: Campaign,
    landing: _SimulatedLanding,
    journal: Journal | None,
) -> int:
    started = time.monotonic()
    count = args.runs or campaign.runs
    seeds = range(1, count + 1)
    # Seed by seed: what is stopped early has flown as much of every row.
    tasks = [(row.name, seed) for seed in seeds for row in campaign.all_rows]
    runs = [journal.runs[task] for task in tasks if task in journal.runs] if journal else []
    kept = {(run.scenario, run.seed) for run in runs}
    waiting = [task for task in tasks if task not in kept]
    try:
        _fly_all(landing, waiting, args.jobs or len(os.sched_getaffinity(0)), journal, runs)
    except KeyboardInterrupt:
        if not args.json:
            if runs:
                print(as_text(_rows(campaign, runs), get_terminal_size().columns))
            print(f"stopped after {len(runs)} of {len(tasks)} runs")
        raise
    rows = _rows(campaign, runs)
    wall_s = time.monotonic() - started
    least = _least(campaign, landing, runs)
    if args.json:
        print_json({"campaign": args.name, "rows": rows, "least": least, "wall_s": wall_s})
    else:
        print(as_text(rows, get_terminal_size().columns))
        for row in rows:
            for line in as_lines(row["days"]) if "days" in row else ():
                print(line)
            for line in fault_lines(row["faults"]) if "faults" in row else ():
                print(line)
        for each in least:
            print(f"{'; '.join(each['failures'])}: {each['again']}")
        print(f"{len(waiting)} landings in {wall_s / 60.0:.1f} min")
    return 1 if any(row["missed"] for row in rows) else 0


def _fly_all(
    landing: _SimulatedLanding,
    tasks: Sequence[Task],
    jobs: int,
    journal: Journal | None,
    runs: list[Run],
) -> None:
    """Fly all tasks, and add each run as it ends, also to the journal, while telling how far."""
    # Runs are what is spread over the cores; the children take this over.
    os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    progress = _Progress(len(tasks))
    try:
        with contextlib.closing(run_all(landing, tasks, jobs)) as series:
            for ended in series:
                runs.append(ended)
                if journal is not None:
                    journal.keep(ended)
                progress.show(ended)
    finally:
        progress.clear()


def _rows(campaign: Campaign, runs: Iterable[Run]) -> list[dict[str, Any]]:
    of: dict[str, list[Run]] = {row.name: [] for row in campaign.all_rows}
    for ended in runs:
        of[ended.scenario].append(ended)
    rows = []
    for row in campaign.all_rows:
        flown = sorted(of[row.name], key=lambda r: r.seed)
        if flown:
            made = make_row(row, flown)
            if row.days:
                made["days"] = summary(flown)
            if row.faults:
                made["faults"] = found = fault_summary(flown)
                failed = made["failed_seeds"] = found["failed_seeds"]
                made["missed"] = [f"{len(failed)} flights failed"] if failed else []
            rows.append(made)
    return rows


def _least(
    campaign: Campaign, landing: _SimulatedLanding, runs: Iterable[Run]
) -> list[dict[str, Any]]:
    """Return the least faults with which the first of the flights that failed still fail."""
    rows = {row.name: row for row in campaign.all_rows if row.faults}
    failed = [run for run in runs if run.scenario in rows and failures(run)]
    found = []
    for run in sorted(failed, key=lambda run: run.seed)[:SHRUNK_SEEDS]:
        row = rows[run.scenario]
        fly = partial(landing.fly_with, row, run.seed)
        found.append(shrink(row, run, fly, landing.overrides))
    return found


class _Progress:
    """Says on stderr how far the campaign is: a line for every failure and, on a terminal, one
    that changes, elsewhere one whenever another tenth is flown.
    """

    def __init__(self, total: int) -> None:
        self._total = total
        self._done = self._failed = 0
        self._started = time.monotonic()
        self._terminal = sys.stderr.isatty()

    def show(self, ended: Run) -> None:
        """Count a run."""
        self._done += 1
        why = _why(ended)
        if why is not None:
            self._failed += 1
            self.clear()
            tell(f"{ended.scenario}, seed {ended.seed}: {why}")
        left_min = (time.monotonic() - self._started) / self._done * self._left / 60.0
        line = f"{self._done} of {self._total}, {self._failed} failed, {left_min:.0f} min left"
        if self._terminal:
            print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)
        elif self._left and 10 * self._done // self._total > 10 * (self._done - 1) // self._total:
            print(line, file=sys.stderr, flush=True)

    @property
    def _left(self) -> int:
        return self._total - self._done

    def clear(self) -> None:
        """Take the line off the terminal."""
        if self._terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def _why(run: Run) -> str | None:
    """Say why a run has failed; None: it has not."""
    result = run.result
    if result is None:
        return run.error
    if result.get("faults_flown"):
        return "; ".join(failures(run)) or None
    broken = "; ".join(result["rules_broken"])
    if broken:
        return f"rules broken: {broken}"
    return f"did not land: {result['outcome']}" if has_failed(run) else None


def _count(text: str) -> int:
    return whole_number(text, 1)
