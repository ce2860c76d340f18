"""The command line: the table of commands, and what an error's exit code is.

Exit codes: 0 done, 1 ran and the result is bad, 2 the input is wrong. A command's module is
imported when it is called, so that --help does not wait for numpy and OpenCV.
"""

import argparse
import errno
import os
import re
import signal
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from io import TextIOWrapper
from typing import Any, NamedTuple, NoReturn, Protocol, cast

from landerd import __version__
from landerd.commands.shared import InputError
from landerd.worker import exit_without_waiting

_STOPPED = 130  # exit code after Ctrl-C, as shells have it


class CommandModule(Protocol):
    """What each module of `landerd.commands` that has a line in the table consists of."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the command's arguments."""

    def run(self, args: argparse.Namespace) -> int:
        """Do it and return 0, or 1 if the result is bad. Raises InputError."""
        ...


class _Command(NamedTuple):
    module: str  # of landerd.commands
    help: str
    example: str


_COMMANDS: Mapping[str, _Command] = {
    "sim": _Command(
        "sim",
        "fly one landing in the simulator",
        "landerd sim moving --seed 3 --set sim.pad.speed_mps=0.5 --picture flight.png",
    ),
    "detect": _Command(
        "detect",
        "find the pad's markers in images, a folder, a video or a camera",
        "landerd detect photos/ --camera config/cameras/thesis.yaml --pad config/pads/thesis.yaml",
    ),
    "pad": _Command(
        "pad",
        "print a pad at true size, propose one, or enter what you measured on it",
        "landerd pad nested -o pad.pdf --paper a4\n"
        "  landerd pad nested -o pad.pdf --paper sheet             one sheet for a print shop\n"
        "  landerd pad nested -o cut.svg --outline                 for a vinyl cutter\n"
        "  landerd pad nested --measured ruler=99.2mm -o mine.yaml\n"
        "  landerd pad --for 1.2m --seen-from 20m -o own.pdf       writes own.yaml too",
    ),
    "calibrate": _Command(
        "calibrate",
        "find out what a camera's lens does, or how a gimbal answers",
        "landerd calibrate camera photos/ --size 9x6 --square 0.025 -o my-camera.yaml",
    ),
    "campaign": _Command(
        "campaign",
        "fly many landings in the simulator and print a table of results",
        "landerd campaign guidance --runs 5 --jobs 2",
    ),
    "compare": _Command(
        "compare",
        "say what is better or worse in one campaign than in another, flight by flight",
        "landerd compare before.jsonl after.jsonl      files of landerd campaign --keep",
    ),
    "tune": _Command(
        "tune",
        "search the best gains in the simulator, or fit them to recorded flights",
        "landerd tune thesis-pid -c thesis-gains.yaml -o gains.yaml\n"
        "  landerd tune --from flight.mcap -o gains.yaml",
    ),
    "replay": _Command(
        "replay",
        "run a flight log through today's code and compare",
        "landerd replay flight.mcap --set guidance.limits.speed_mps=2",
    ),
    "report": _Command(
        "report",
        "show what happened in flights, or what came of campaigns, as a page to read",
        "landerd report flight.mcap -o report.html\n"
        "  landerd report guidance.jsonl -o guidance.html        file of campaign --keep\n"
        "  landerd report *.jsonl vision.txt -o docs/results.md",
    ),
    "dry-run": _Command(
        "dry_run",
        "say what landerd would have ordered on a recorded flight; sends nothing",
        "landerd dry-run -c my.yaml --video flight.mp4 --telemetry flight.bin --gimbal 0,-90",
    ),
    "bench-test": _Command(
        "bench_test",
        "measure camera and gimbal on marked places of the floor, before the first flight",
        "landerd bench-test pose -c my.yaml --height 1.52 --mark 2,0 --mark 3,1 -o bench.csv",
    ),
    "install": _Command(
        "install",
        "put landerd on this computer as a service",
        "landerd install --board pixhawk-usb --dry-run",
    ),
    "uninstall": _Command(
        "uninstall",
        "take the service away; logs and configuration stay",
        "landerd uninstall --dry-run",
    ),
    "check": _Command(
        "check",
        "open and measure camera, gimbal and autopilot, and say what would stop a landing",
        "landerd check -c /etc/landerd/landerd.yaml",
    ),
    "run": _Command(
        "run",
        "fly: drive camera, gimbal and autopilot until stopped",
        "landerd run -c /etc/landerd/landerd.yaml",
    ),
}


class _Parser(argparse.ArgumentParser):
    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        # A place that begins with a minus, as -35.36,149.17, is a value and no option.
        self._negative_number_matcher = re.compile(r"-[0-9.]")

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def entry_point() -> NoReturn:
    """Run the process's command line, and end it without waiting for a search that still hangs."""
    try:
        code = main()
    except KeyboardInterrupt:  # once more, while it stops for the first
        code = _STOPPED
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # from here on it ends without a traceback
    exit_without_waiting(code)
    sys.exit(code)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return the exit code."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    _open_closed_streams()
    try:
        try:
            args = _parser(arguments).parse_args(arguments)
            code: int = args.run(args)
        finally:
            sys.stdout.flush()
    except InputError as e:
        if not e.is_told:
            print(e, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return _STOPPED
    except BrokenPipeError:
        # Whoever read our output has gone; nothing is left to say, at exit neither.
        _give_up_stdout()
        return 141
    except OSError as e:
        if e.errno == errno.ENAMETOOLONG:
            print(f"{str(e.filename)[:40]}...: {e.strerror}", file=sys.stderr)
            return 2
        if e.errno == errno.EACCES and e.filename is not None:  # its folder may not be entered
            print(f"{e.filename}: cannot be read: {e.strerror}", file=sys.stderr)
            return 2
        if not _has_working_folder():
            print("the working folder is gone: cd to one that is there", file=sys.stderr)
            return 2
        failure = _stdout_failure()
        if failure is None:
            raise
        _give_up_stdout()
        print(f"standard output cannot be written: {failure}", file=sys.stderr)
        return 2
    return code


def _has_working_folder() -> bool:
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


def _open_closed_streams() -> None:
    """Let what is printed to a stream that the caller has closed go nowhere."""
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - it stays open
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - it stays open
    # A file's name may hold what the terminal cannot show.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _stdout_failure() -> str | None:
    """Return why standard output takes nothing, not what is left over nor an empty line."""
    try:
        sys.stdout.flush()
        os.write(sys.stdout.fileno(), b"\n")
    except OSError as e:
        return e.strerror
    return None


def _give_up_stdout() -> None:
    """Let nothing of what is waiting be tried again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    parser = _Parser(
        prog="landerd",
        description="Lands an ArduPilot multicopter on a marked pad by what a camera sees.",
        epilog="Try: landerd sim",
    )
    parser.add_argument("-V", "--version", action="version", version=f"landerd {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, command in _COMMANDS.items():
        sub = commands.add_parser(
            name,
            help=command.help,
            description=f"{command.help[0].upper()}{command.help[1:]}.",
            epilog=f"example:\n  {command.example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name in arguments:
            module = import_module(f"landerd.commands.{command.module}")
            implementation = cast(CommandModule, module)
            implementation.add_arguments(sub)
            sub.set_defaults(run=implementation.run)
    return parser
