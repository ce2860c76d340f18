"""`landerd compare`: what has become better and worse from one campaign to another."""

import argparse
from typing import Any

from landerd.campaigns.compare import as_text, compare
from landerd.campaigns.journal import JournalError, read_runs
from landerd.commands.shared import InputError, add_json, file_name, print_json, refusing, tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("a", type=file_name, metavar="A", help="file of landerd campaign --keep")
    parser.add_argument(
        "b",
        type=file_name,
        metavar="B",
        help="another one; flights of the same row and seed are compared",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Compare two campaigns and print the changes; return 0, or 1 if anything is worse in B.

    Raises:
        InputError: a file cannot be read, or the two have no flight in common.
    """
    with refusing(JournalError):
        a, b = read_runs(args.a), read_runs(args.b)
    rows = compare(a, b)
    if not rows:
        raise InputError(f"{args.a} and {args.b}: no flight (row and seed) is in both")
    alone = len(a) + len(b) - 2 * len(a.keys() & b.keys())
    if alone:
        tell(f"{alone} flights are in only one of the two, and are left out")
    if args.json:
        print_json({"a": str(args.a), "b": str(args.b), "left_out": alone, "rows": rows})
    else:
        print(f"A: {args.a}\nB: {args.b}\n{as_text(rows)}")
    return 1 if any(_is_worse(row) for row in rows) else 0


def _is_worse(row: dict[str, Any]) -> bool:
    """Tell whether the share of successes or a figure is worse in B."""
    verdicts = [row["succeeded"]["verdict"], *(f["verdict"] for f in row["figures"].values())]
    return "worse" in verdicts
