"""`landerd report`: what happened in a flight, as a page for the browser."""

import argparse
import importlib.util
import sys
from pathlib import Path

from landerd.flightlog.reader import LogError, read_log


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG.mcap", help="flight logs")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("report.html"), metavar="FILE.html"
    )


def run(args: argparse.Namespace) -> int:
    """Write the page; return 0, or 2 if a log cannot be used."""
    if importlib.util.find_spec("matplotlib") is None:
        return _refuse("report needs matplotlib: pip install 'landerd[report]'")
    from landerd.analysis.flight import flight_of
    from landerd.analysis.report import write_report

    try:
        flights = [flight_of(read_log(path)) for path in args.logs]
        write_report(flights, args.output)
    except LogError as e:
        return _refuse(str(e))
    except OSError as e:
        return _refuse(f"{args.output}: cannot be written: {e.strerror}")
    print(args.output)
    return 0


def _refuse(text: str) -> int:
    print(text, file=sys.stderr)
    return 2
