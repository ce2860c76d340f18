"""`landerd report`: writes a page on flights, from their logs, or on campaigns' results."""

import argparse
import importlib.util
from pathlib import Path

from landerd.commands.campaign_report import write_campaigns
from landerd.commands.shared import InputError, check_folder, file_name, refusing, tell
from landerd.flightlog.reader import LogError, read_log

_PAGES = (".html", ".md")  # suffixes of files that are written
_READ = (".mcap", ".jsonl", ".txt")  # suffixes of files that are read


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "files",
        nargs="+",
        type=file_name,
        metavar="FILE",
        help="flight logs (.mcap); or results: files of landerd campaign --keep (.jsonl), output "
        "of landerd sim --json (.jsonl), and tables, copied as they are (.txt)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=file_name,
        default=Path("report.html"),
        metavar="FILE",
        help="a page (.html), or for campaigns a text without figures (.md); (report.html)",
    )


def run(args: argparse.Namespace) -> int:
    """Write the page; return 0. Raises InputError."""
    from landerd.analysis.report import NO_PLOTS

    if args.output.suffix not in _PAGES:
        raise InputError(f"-o {args.output}: expected a .html, or for campaigns a .md")
    check_folder(args.output)
    for path in args.files:
        if path.suffix not in _READ and path.exists():
            raise InputError(f"{path}: expected a flight log (.mcap), a .jsonl or a .txt")
    twice = [path for n, path in enumerate(args.files) if _is_among(path, args.files[:n])]
    if twice:
        raise InputError(f"{twice[0]}: given twice, and would count twice")
    logs = [path for path in args.files if path.suffix == ".mcap"]
    if logs and len(logs) < len(args.files):
        raise InputError("expected flight logs (.mcap), or files of campaigns, not both")
    try:
        if logs:
            _write_flights(logs, args.output)
        else:
            write_campaigns(args.files, args.output)
    except OSError as e:
        raise InputError(f"{args.output}: cannot be written: {e.strerror}") from None
    if args.output.suffix != ".md" and importlib.util.find_spec("matplotlib") is None:
        tell(NO_PLOTS)
    print(f"wrote {args.output}")
    return 0


def _is_among(path: Path, others: list[Path]) -> bool:
    """Tell whether a file is one of others, by whatever path."""
    return path.resolve() in [other.resolve() for other in others]


def _write_flights(paths: list[Path], output: Path) -> None:
    """Write a page on flights, from their logs. Raises InputError, OSError."""
    from landerd.analysis.flight import flight_of
    from landerd.analysis.report import write_report

    if output.suffix == ".md":
        raise InputError(f"-o {output}: for flight logs expected .html")
    # Each vehicle calls its logs alike: those of several are told apart by their folders.
    alike = len({path.name for path in paths}) < len(paths)
    with refusing(LogError):
        flights = [flight_of(read_log(path), str(path) if alike else None) for path in paths]
        write_report(flights, output)
