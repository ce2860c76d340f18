"""`landerd report`: what happened in a flight, as a page for the browser."""

import argparse
import importlib.util
from pathlib import Path

from landerd.commands.shared import InputError, refusing, tell
from landerd.flightlog.reader import LogError, read_log


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG.mcap", help="flight logs")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("report.html"), metavar="FILE.html"
    )


def run(args: argparse.Namespace) -> int:
    """Write the page; return 0."""
    from landerd.analysis.flight import flight_of
    from landerd.analysis.report import NO_PLOTS, write_report

    try:
        with refusing(LogError):
            flights = [flight_of(read_log(path)) for path in args.logs]
            write_report(flights, args.output)
    except OSError as e:
        raise InputError(f"{args.output}: cannot be written: {e.strerror}") from None
    if importlib.util.find_spec("matplotlib") is None:
        tell(NO_PLOTS)
    print(args.output)
    return 0
