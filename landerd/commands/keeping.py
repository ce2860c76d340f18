"""Where the commands that fly keep their flights, and which landerd flew them."""

import argparse
import contextlib
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from landerd import __version__
from landerd.campaigns.journal import Journal, Plan, Sitting
from landerd.campaigns.plan import Campaign

PROGRAM = ("landerd", "hw", "config")


def journal_of(
    args: argparse.Namespace, settings: str, campaigns: Mapping[str, Campaign]
) -> Journal | None:
    """Return the file of --keep; None: nothing is kept.

    Args:
        args: of `add_flying` and `add_config`.
        settings: tells the configuration from every other.
        campaigns: what is flown, by name.

    Raises:
        JournalError: it cannot be used.
    """
    if args.keep is None:
        return None
    config = () if args.config is None else ("-c", str(args.config))
    changes = tuple(word for each in args.set for word in ("--set", each))
    return Journal(args.keep, Plan(settings, campaigns, (*config, *changes)), sitting())


def sitting() -> Sitting:
    """Return when it is, and which landerd this is: its version, and its commit in a checkout."""
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    commit = _git("log", "-1", "--format=%h")
    if not commit:
        return Sitting(now, __version__)
    changed = ", changed" if _git("status", "--porcelain") else ""
    return Sitting(now, f"{__version__} ({commit}{changed})")


def _git(*arguments: str) -> str:
    """Return what git says of the program's files; nothing where they are not its."""
    command = ["git", *arguments, "--", *PROGRAM]
    root = Path(__file__).parents[2]
    with contextlib.suppress(OSError):
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""
    return ""
