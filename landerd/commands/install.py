"""`landerd install`: installs landerd as a service of systemd.

It installs the program, the service's user, udev rules, an example configuration and the unit.

It runs from a checkout or from inside a wheel file, without any other Python package. So it first
installs the program into /opt, and then lets that program do the rest.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from landerd.commands.shared import InputError, file_name, refusing

if TYPE_CHECKING:
    from landerd.installation.steps import Step

_BOARDS = ("pixhawk-usb", "pixhawk-uart", "navio2", "jetson")
_SYSTEM = Path("/")  # root folder of the running system


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "--board",
        required=True,
        choices=_BOARDS,
        help="how autopilot and companion computer are connected (docs/install.md)",
    )
    add_root(parser)


def add_root(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that install and uninstall share: --dry-run and --root."""
    parser.add_argument("--dry-run", action="store_true", help="print each action and do none")
    parser.add_argument(
        "--root",
        type=_system,
        default=_SYSTEM,
        metavar="DIR",
        help="root folder of another system, as a mounted image: only files are written, no "
        "command is run",
    )


def _system(text: str) -> Path:
    """Return the root folder of a system; the type of --root."""
    folder = file_name(text)
    if not folder.is_dir():  # an image that is not mounted: the folder must not be created
        raise argparse.ArgumentTypeError(f"{text}: no such folder")
    return folder.resolve()  # so that the running system is known by any of its names


def run(args: argparse.Namespace) -> int:
    """Install; return 0, or 1 if this version cannot read the user's configuration.

    Raises:
        InputError: Python is too old, a step fails, or it needs root.
    """
    # ruff takes this for needless, but run from a checkout pip has not checked the version.
    if sys.version_info < (3, 11):  # noqa: UP036
        found = ".".join(str(part) for part in sys.version_info[:2])
        raise InputError(f"landerd needs Python 3.11 or newer, this is {found}")
    from landerd.installation.program import (
        is_installed_copy,
        picamera2_steps,
        program_steps,
        source,
    )
    from landerd.installation.service import (
        BOARDS,
        CONFIGURATION,
        install_steps,
        parameter_file,
    )
    from landerd.installation.steps import InstallError

    root: Path = args.root
    in_place = root != _SYSTEM or is_installed_copy()
    with refusing(InstallError, OSError):
        program = [] if in_place else [*program_steps(source()), *picamera2_steps()]
        if program and not args.dry_run:
            carry_out(program, args)
            return _by_the_installed_copy(args.board)
        steps = [*program, *install_steps(args.board, root)]
        reads_keys = root == _SYSTEM and is_installed_copy()
        key_steps, news, unreadable = _keys() if reads_keys else ([], [], [])
        carry_out([*steps, *key_steps], args)
    if news:
        print("changes of the configuration's keys:", *news, sep="\n  ")
    if unreadable:
        print("this version cannot read your configuration; landerd would not start:")
        print("\n".join(unreadable))
        return 1
    if steps and not args.dry_run:
        if root == _SYSTEM:
            left = [
                *BOARDS[args.board].left,
                f"ArduCopter's parameters: load {parameter_file(args.board)},",
                "  of 4.7 the -4.7.param beside it (docs/ardupilot.md)",
                f"sudo nano {CONFIGURATION}    (an example: make it yours)",
                f"landerd check -c {CONFIGURATION}",
                "sudo systemctl enable --now landerd",
            ]
        else:  # an image has only the files: program and account are made where it runs
            board = args.board
            left = [f"sudo python3 -m landerd install --board {board}    (on the board itself)"]
        print("left to you (docs/install.md):", *left, sep="\n  ")
    return 0


def carry_out(steps: "Sequence[Step]", args: argparse.Namespace) -> None:
    """Print each step, and do it unless --dry-run is given.

    Args:
        steps: what is to be done.
        args: of `add_root`.

    Raises:
        InputError: it needs root.
        InstallError: the service is running, or a step fails.
        OSError: a step fails.
    """
    from landerd.installation.service import refuse_while_it_runs

    if not steps:
        print("nothing left to do")
        return
    if not args.dry_run and args.root == _SYSTEM:
        if os.geteuid() != 0:
            raise InputError("this needs root: begin the command with sudo (or --dry-run)")
        refuse_while_it_runs()
    for step in steps:
        print(f"would {step.text}" if args.dry_run else step.text, flush=True)
        if not args.dry_run:
            step.do()


def _by_the_installed_copy(board: str) -> int:
    """Run the program in /opt for the rest, as it can read configurations; return its exit code."""
    from landerd.installation.program import PROGRAM

    return subprocess.run([PROGRAM, "install", "--board", board], check=False).returncode


def _keys() -> "tuple[list[Step], list[str], list[str]]":
    """Compare this version's keys of the configuration with those of the version before.

    Returns:
        Steps that store this version's keys, a line for each change, and a line for each fault in
        the user's configuration.
    """
    from landerd.installation import keys
    from landerd.installation.service import CONFIGURATION

    return keys.key_steps(CONFIGURATION)
