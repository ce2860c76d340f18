"""The file in which commands that fly keep their runs (--keep), and the version that flew them."""

import argparse
import contextlib
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from landerd import __version__
from landerd.campaigns.journal import Journal, Plan, Sitting
from landerd.campaigns.plan import Campaign

PROGRAM = ("landerd", "hw", "config")  # folders of a checkout whose changes may change flights


def journal_of(
    args: argparse.Namespace, settings: str, campaigns: Mapping[str, Campaign]
) -> Journal | None:
    """Return the journal in the file of --keep; None without --keep.

    Args:
        args: of `add_flying` and `add_config`.
        settings: identifies the configuration.
        campaigns: the campaigns to fly, by name.

    Raises:
        JournalError: the file cannot be used.
    """
    if args.keep is None:
        return None
    config = () if args.config is None else ("-c", str(args.config))
    changes = tuple(word for each in args.set for word in ("--set", each))
    return Journal(args.keep, Plan(settings, campaigns, (*config, *changes)), sitting())


def sitting() -> Sitting:
    """Return the current time and landerd's version, in a checkout with its commit."""
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    commit = _git("log", "-1", "--format=%h")
    if not commit:
        return Sitting(now, __version__)
    changed = ", changed" if _git("status", "--porcelain") else ""
    return Sitting(now, f"{__version__} ({commit}{changed})")


def _git(*arguments: str) -> str:
    """Return what a git command prints about the program's files; "" if they are no checkout."""
    command = ["git", *arguments, "--", *PROGRAM]
    root = Path(__file__).parents[2]
    with contextlib.suppress(OSError):
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""
    return ""
