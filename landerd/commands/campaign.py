"""`landerd campaign`: flies many simulated landings, and prints a table of their results."""

import argparse
import contextlib
import hashlib
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from shutil import get_terminal_size
from typing import Any

from landerd.camera_model import CalibrationError, load_camera
from landerd.campaigns.effects import effects_of
from landerd.campaigns.failures import as_lines
from landerd.campaigns.fault_table import as_lines as fault_lines
from landerd.campaigns.fault_table import failures
from landerd.campaigns.journal import Journal, JournalError
from landerd.campaigns.plan import Campaign, Row, load_campaigns
from landerd.campaigns.pool import Run
from landerd.campaigns.poses import as_text as poses_as_text
from landerd.campaigns.rows import make_rows, runs_of
from landerd.campaigns.table import as_text, best_rows, right_aligned
from landerd.commands.campaign_report import ReferenceWorld
from landerd.commands.fault_runs import SHRUNK_SEEDS, shrink
from landerd.commands.flying import SimulatedLanding, add_flying, executor, fly_all
from landerd.commands.keeping import journal_of
from landerd.commands.shared import (
    InputError,
    add_config,
    add_json,
    check_faults,
    check_stand_in_flies,
    config_path,
    print_json,
    refusing,
    settings_of_file,
    tell,
    whole_number,
)
from landerd.config.files import ConfigError, Loaded, config_files
from landerd.files import as_bytes
from landerd.pad import PadError, load_pad


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    names = ", ".join(config_files("campaigns"))
    parser.add_argument(
        "name", metavar="NAME", help=f"{names}, a scenario of landerd sim, or a FILE.yaml"
    )
    parser.add_argument(
        "--runs",
        type=whole_number(1),
        metavar="N",
        help="fly the seeds 1 to N; without: as many as the campaign says",
    )
    add_flying(parser)
    add_json(parser)
    add_config(parser)


def run(args: argparse.Namespace) -> int:
    """Fly the campaign; return 0, or 1 if a row misses a requirement."""
    with refusing(ConfigError, CalibrationError, PadError, JournalError):
        config = None if args.config is None else config_path(args)
        parts = [
            _Part(name, campaign, SimulatedLanding(campaign, config, tuple(args.set)))
            for name, campaign in load_campaigns(args.name).items()
        ]
        loaded = [part.load(row) for part in parts for row in part.campaign.all_rows]
        load_camera(loaded[0].config.camera.calibration)
        load_pad(loaded[0].config.pad.layout)
        campaigns = {part.name: part.campaign for part in parts}
        journal = journal_of(args, _settings(args.name, loaded), campaigns)
    with journal or contextlib.nullcontext():
        return _fly(args, parts, journal)


@dataclass(frozen=True)
class _Part:
    """One of the campaigns to fly."""

    name: str
    campaign: Campaign
    landing: SimulatedLanding

    def load(self, row: Row) -> Loaded:
        """Return the configuration of a row. Raises ConfigError, InputError."""
        with settings_of_file(self.name, row.settings):
            loaded = self.landing.load(row)
        driver = loaded.config.gimbal.driver
        if row.faults and driver != "sim":  # the gimbal's are among those that seeds draw
            raise InputError(f"{self.name}: its faults need gimbal.driver sim, found {driver}")
        check_stand_in_flies(loaded)
        check_faults(loaded)
        return loaded


def _settings(name: str, loaded: Iterable[Loaded]) -> str:
    """Return a hash that identifies the campaign and its configurations.

    Args:
        name: of the campaign.
        loaded: configuration of each row.
    """
    digest = hashlib.sha256(as_bytes(name))
    for each in loaded:
        digest.update(each.config.model_dump_json().encode())
        for section in sorted(each.options):
            digest.update(f"{section} {each.options[section].model_dump_json()}".encode())
    return digest.hexdigest()


def _fly(args: argparse.Namespace, parts: Sequence[_Part], journal: Journal | None) -> int:
    """Fly all campaigns, without the runs in the journal, and print them; return the exit code."""
    started = time.monotonic()
    flown, missed = [], False
    for number, part in enumerate(parts, start=1):
        if len(parts) > 1:
            tell(f"{part.name}: {number} of {len(parts)} campaigns")
        campaign = part.campaign
        seeds = range(1, (args.runs or campaign.runs) + 1)
        # Seed by seed, so that a campaign stopped early has flown as much of every row.
        tasks = [(row.name, seed) for seed in seeds for row in campaign.all_rows]
        runs = [journal.runs[task] for task in tasks if task in journal.runs] if journal else []
        kept = {(run.scenario, run.seed) for run in runs}
        waiting = [task for task in tasks if task not in kept]
        try:
            fly_all(part.landing, waiting, executor(args), journal, runs)
        except KeyboardInterrupt:
            if not args.json:
                _print(campaign, make_rows(campaign, runs), runs)
                print(f"stopped after {len(runs)} of {len(tasks)} runs")
            raise
        rows = make_rows(campaign, runs)
        missed = missed or any(row["missed"] for row in rows)
        least = _least(campaign, part.landing, runs)
        flown.append({"campaign": part.name, "rows": rows, "least": least})
        if not args.json:
            if len(parts) > 1:
                print(f"---- {part.name}")
            _print(campaign, rows, runs)
            for each in least:
                print(f"{'; '.join(each['failures'])}: {each['again']}")
            minutes = (time.monotonic() - started) / 60.0
            print(f"{len(waiting)} runs, {minutes:.1f} min since the start")
    if args.json:
        wall_s = time.monotonic() - started
        found = flown[0] if len(flown) == 1 else {"campaign": args.name, "campaigns": flown}
        print_json({**found, "wall_s": wall_s})
    return 1 if missed else 0


def _print(campaign: Campaign, rows: Sequence[dict[str, Any]], runs: Iterable[Run]) -> None:
    """Print the tables of a campaign: its flights, sweeps, poses, failed days and faults."""
    swept = {row.name for sweep in campaign.sweeps for row in sweep.rows()}
    flights = [row for row in rows if "bins" not in row and row["scenario"] not in swept]
    if flights:
        shown = flights if campaign.best is None else best_rows(flights, campaign.best)
        print(as_text(shown, get_terminal_size().columns))
    effects = effects_of(campaign, runs_of(campaign, runs), ReferenceWorld())
    if effects is not None:
        table = [effects.table.head, *effects.table.rows]
        print("\n".join([*right_aligned(table, indent=0), *effects.said]))
    for row in rows:
        if "bins" in row:
            print(poses_as_text(row))
        for line in as_lines(row["days"]) if "days" in row else ():
            print(line)
        for line in fault_lines(row["faults"]) if "faults" in row else ():
            print(line)


def _least(
    campaign: Campaign, landing: SimulatedLanding, runs: Iterable[Run]
) -> list[dict[str, Any]]:
    """Return, for the first failed flights with faults, the smallest faults that make them fail."""
    rows = {row.name: row for row in campaign.all_rows if row.faults}
    failed = [run for run in runs if run.scenario in rows and failures(run)]
    found = []
    for run in sorted(failed, key=lambda run: run.seed)[:SHRUNK_SEEDS]:
        row = rows[run.scenario]
        fly = partial(landing.fly_with, row, run.seed)
        found.append(shrink(row, run, fly, landing.overrides))
    return found
