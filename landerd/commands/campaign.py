"""`landerd campaign`: many simulated landings, and a table of what came of them."""

import argparse
import contextlib
import gc
import hashlib
import json
import os
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from landerd import devices as registry
from landerd.camera_model import CalibrationError, load_camera
from landerd.campaigns.journal import Journal, JournalError
from landerd.campaigns.plan import Campaign, load_campaign
from landerd.campaigns.pool import Run, run_all
from landerd.campaigns.table import as_text, has_failed, make_row
from landerd.config.files import ConfigError, Loaded, config_dir, config_files, load
from landerd.pad import PadError, load_pad


@dataclass(frozen=True)
class _SimulatedLanding:
    """Flies one landing; what `landerd.campaigns` is handed."""

    config: Path
    overrides: tuple[str, ...]

    def __call__(self, scenario: str, seed: int) -> dict[str, Any]:
        import logging

        from landerd.simulation.flight import simulate

        logging.basicConfig(level=logging.ERROR)  # faults are counted in the result
        try:
            return simulate(self.load(scenario), scenario, seed)
        finally:
            gc.collect()  # flights are circles of objects, and large

    def load(self, scenario: str) -> Loaded:
        """Return the configuration of a scenario. Raises ConfigError."""
        return load(
            self.config,
            options_models=registry.options_models(),
            drivers=registry.names(),
            overlays=[config_files("scenarios")[scenario]],
            overrides=self.overrides,
        )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments, all but those of the configuration."""
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
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")


def run(args: argparse.Namespace) -> int:
    """Fly the campaign; return 0, 1 if a row misses what it needs, 2 if the input is wrong."""
    landing = _SimulatedLanding(args.config or config_dir() / "default.yaml", tuple(args.set))
    try:
        campaign = load_campaign(args.name)
        loaded = [landing.load(row.scenario) for row in campaign.rows]
        load_camera(loaded[0].config.camera.calibration)
        load_pad(loaded[0].config.pad.layout)
        journal = Journal(args.keep, _settings(args.name, loaded)) if args.keep else None
    except (ConfigError, CalibrationError, PadError, JournalError) as e:
        print(e, file=sys.stderr)
        return 2
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
    # Runs are what is spread over the cores; the children take this over.
    os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    tasks = [(row.scenario, seed) for row in campaign.rows for seed in range(1, count + 1)]
    runs = [journal.runs[task] for task in tasks if task in journal.runs] if journal else []
    kept = {(run.scenario, run.seed) for run in runs}
    waiting = [task for task in tasks if task not in kept]
    progress = _Progress(len(waiting))
    jobs = args.jobs or len(os.sched_getaffinity(0))
    try:
        with contextlib.closing(run_all(landing, waiting, jobs)) as series:
            for ended in series:
                runs.append(ended)
                if journal is not None:
                    journal.keep(ended)
                progress.show(ended)
    except KeyboardInterrupt:
        progress.clear()
        if not args.json:
            if runs:
                print(as_text(_rows(campaign, runs)))
            print(f"stopped after {len(runs)} of {len(tasks)} runs")
        raise
    progress.clear()
    rows = _rows(campaign, runs)
    wall_s = time.monotonic() - started
    if args.json:
        print(json.dumps({"campaign": args.name, "rows": rows, "wall_s": wall_s}, allow_nan=False))
    else:
        print(as_text(rows))
        print(f"{len(waiting)} landings in {wall_s / 60.0:.1f} min")
    return 1 if any(row["missed"] for row in rows) else 0


def _rows(campaign: Campaign, runs: Iterable[Run]) -> list[dict[str, Any]]:
    of: dict[str, list[Run]] = {row.scenario: [] for row in campaign.rows}
    for ended in runs:
        of[ended.scenario].append(ended)
    return [
        make_row(row, sorted(of[row.scenario], key=lambda r: r.seed))
        for row in campaign.rows
        if of[row.scenario]
    ]


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
        if has_failed(ended):
            self._failed += 1
            why = ended.error or _why(ended.result or {})
            self.clear()
            print(f"{ended.scenario}, seed {ended.seed}: {why}", file=sys.stderr)
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


def _why(result: dict[str, Any]) -> str:
    broken = "; ".join(result["rules_broken"])
    return f"rules broken: {broken}" if broken else f"did not land: {result['outcome']}"


def _count(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected a whole number, 1 or more")
    return int(text)
