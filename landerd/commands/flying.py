"""Flies many simulated landings, for the commands campaign and tune, and shows the progress."""

import argparse
import contextlib
import gc
import logging
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from hw.sim.fault_options import FaultOptions
from landerd.campaigns.cluster import ClusterError, run_on_cluster
from landerd.campaigns.fault_table import failures
from landerd.campaigns.journal import Journal
from landerd.campaigns.plan import Campaign, Row
from landerd.campaigns.pool import Executor, Run, RunOne, Task, error_line, run_all
from landerd.campaigns.table import has_failed_to_land
from landerd.commands.fault_runs import drawn_settings, settings_of
from landerd.commands.shared import file_name, refusing, tell, whole_number
from landerd.config.files import Loaded, config_files, default_config
from landerd.drivers import read_configuration


def add_flying(parser: argparse.ArgumentParser) -> None:
    """Add the arguments on where flights run and are kept: --jobs, --scheduler, --keep."""
    parser.add_argument(
        "--jobs",
        type=whole_number(1),
        default=len(os.sched_getaffinity(0)),
        metavar="N",
        help="number of processes; without: one for every core",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="fly on the Dask cluster with this scheduler instead, as tcp://10.0.0.1:8786",
    )
    parser.add_argument(
        "--keep",
        type=file_name,
        metavar="FILE",
        help="write every run into FILE as it ends; runs that FILE has already are not repeated",
    )


def executor(args: argparse.Namespace) -> Executor:
    """Return the executor that the arguments of `add_flying` choose."""
    if args.scheduler is None:
        return partial(run_all, jobs=args.jobs)
    return partial(run_on_cluster, args.scheduler)


@dataclass(frozen=True)
class SimulatedLanding:
    """A function that flies one landing of a campaign; `landerd.campaigns` calls it.

    It is sent to other processes and computers.
    """

    campaign: Campaign
    config: Path | None  # None: the default of the landerd that runs it, wherever that is installed
    overrides: tuple[str, ...]  # KEY=VALUE, of --set

    def __call__(self, name: str, seed: int) -> dict[str, Any]:
        """Fly a row with a seed, and return the result.

        Args:
            name: of the row.
            seed: of the simulated flight.
        """
        logging.basicConfig(level=logging.ERROR)  # faults are counted in the result
        row = self.campaign.row(name)
        try:
            return reach(self.campaign, row, self.load(row, seed), seed)
        finally:
            gc.collect()  # flights are large and contain reference cycles

    def load(self, row: Row, seed: int = 1) -> Loaded:
        """Return the configuration of a row for a seed, which draws its faults and random values.

        Raises:
            ConfigError: the configuration cannot be used.
        """
        return self.load_with(row, seed, drawn_settings(row, seed))

    def load_with(self, row: Row, seed: int, settings: Sequence[str]) -> Loaded:
        """Return the configuration of a row for a seed, with settings instead of drawn faults.

        Args:
            row: of the campaign.
            seed: of the values drawn from distributions.
            settings: KEY=VALUE; they replace those of the row and of the command line.

        Raises:
            ConfigError: the configuration cannot be used.
        """
        overlays = [config_files("scenarios")[row.scenario]]
        overrides = (*row.settings, *self.overrides, *settings)
        path = self.config or default_config()
        return read_configuration(path, overlays=overlays, overrides=overrides, seed=seed)

    def fly_with(self, row: Row, seed: int, faults: Sequence[FaultOptions]) -> Run:
        """Fly a row with a seed, with these faults instead of those that the seed draws."""
        from landerd.simulation.flight import simulate

        loaded = self.load_with(row, seed, settings_of(faults))
        try:
            result = simulate(loaded, row.name, seed, longest_s=self.campaign.longest_s)
        except Exception as e:
            return Run(row.name, seed, None, error_line(e))
        return Run(row.name, seed, result)


def reach(campaign: Campaign, row: Row, loaded: Loaded, seed: int) -> dict[str, Any]:
    """Simulate what a row is about (a landing, a part of one, or poses), and return the result.

    Args:
        campaign: with the longest flight time.
        row: of the campaign, with the goal.
        loaded: configuration of the row.
        seed: of the simulation.
    """
    match row.goal:
        case "landing":
            from landerd.simulation.flight import simulate

            return simulate(
                loaded,
                row.name,
                seed,
                longest_s=campaign.longest_s,
                with_path=campaign.keeps_paths,
            )
        case "poses":
            from landerd.simulation.poses import see_poses

            return see_poses(loaded, row.name, seed)
        case part:
            from landerd.simulation.goals import simulate_part

            return simulate_part(
                loaded,
                part,
                row.name,
                seed,
                longest_s=campaign.longest_s,
                with_path=campaign.keeps_paths,
            )


def fly_all(
    landing: RunOne,
    tasks: Sequence[Task],
    fly: Executor,
    journal: Journal | None,
    runs: list[Run],
) -> None:
    """Fly all tasks, and show the progress.

    Args:
        landing: flies one task.
        tasks: rows and seeds.
        fly: runs the tasks on processes or on a cluster.
        journal: every run is written into it as it ends; None: there is none.
        runs: every run is appended as it ends.

    Raises:
        InputError: the cluster cannot be used.
    """
    if not tasks:
        return
    # One thread per process, as every core has a process; the processes inherit this.
    os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    progress = _Progress(len(tasks))
    try:
        with refusing(ClusterError), contextlib.closing(fly(landing, tasks)) as series:
            for ended in series:
                runs.append(ended)
                if journal is not None:
                    journal.keep(ended)
                progress.show(ended)
    finally:
        progress.clear()


class _Progress:
    """Shows the progress on standard error.

    It prints a line for every failure. On a terminal another line is updated with every run;
    elsewhere a line is printed after every tenth of the runs.
    """

    def __init__(self, total: int) -> None:
        self._total = total
        self._done = self._failed = 0
        self._started = time.monotonic()
        self._terminal = sys.stderr.isatty()

    def show(self, ended: Run) -> None:
        """Count a run that has ended, and print the progress."""
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
        """Remove the progress line from the terminal."""
        if self._terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def _why(run: Run) -> str | None:
    """Return why a run failed; None: it did not fail."""
    result = run.result
    if result is None:
        return run.error
    if result.get("faults_flown"):
        return "; ".join(failures(run)) or None
    broken = "; ".join(result.get("rules_broken", ()))
    if broken:
        return f"rules broken: {broken}"
    return f"did not land: {result['outcome']}" if has_failed_to_land(run) else None
