"""`landerd install`: program, user, udev's rules, example configuration and unit, as a service.

It runs from a checkout or out of a wheel file, with nothing but Python there: first it puts the
program into /opt, and then the program there does the rest.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from landerd.commands.shared import InputError, refusing

if TYPE_CHECKING:
    from landerd.installation.steps import Step

_BOARDS = ("pixhawk-usb", "pixhawk-uart", "navio2", "jetson")
_SYSTEM = Path("/")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "--board",
        required=True,
        choices=_BOARDS,
        help="how autopilot and companion are put together (docs/install.md)",
    )
    add_root(parser)


def add_root(parser: argparse.ArgumentParser) -> None:
    """Add what install and uninstall share."""
    parser.add_argument("--dry-run", action="store_true", help="say each action and do none")
    parser.add_argument(
        "--root",
        type=_system,
        default=_SYSTEM,
        metavar="DIR",
        help="another system's files, of an image: only files are written, no command is run",
    )


def _system(text: str) -> Path:
    if not text:  # as of a shell's variable that is not set; the working directory is meant by "."
        raise argparse.ArgumentTypeError("found '', expected a folder")
    if not Path(text).is_dir():  # an image that is not mounted would be written beside
        raise argparse.ArgumentTypeError(f"{text}: no such folder")
    return Path(text)


def run(args: argparse.Namespace) -> int:
    """Install; return 0, or 1 if this version cannot read the configuration that is there."""
    if sys.version_info < (3, 11):  # noqa: UP036 - nothing has asked before
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
        key_steps, news, unreadable = _keys() if is_installed_copy() else ([], [], [])
        carry_out([*steps, *key_steps], args)
    if news:
        print("changed in the configuration's keys:", *news, sep="\n  ")
    if unreadable:
        print("this version cannot read your configuration, landerd would not start:")
        print("\n".join(unreadable))
        return 1
    if steps and not args.dry_run:
        left = [
            *BOARDS[args.board].left,
            f"ArduCopter's parameters: load {parameter_file(args.board)} (docs/ardupilot.md)",
            f"sudo nano {CONFIGURATION}    (an example: make it yours)",
            f"landerd check -c {CONFIGURATION}",
            "sudo systemctl enable --now landerd",
        ]
        print("left to you (docs/install.md):", *left, sep="\n  ")
    return 0


def carry_out(steps: "Sequence[Step]", args: argparse.Namespace) -> None:
    """Say each step and do it, unless it is a dry run. Raises InstallError, OSError, InputError."""
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
    """Let the program in /opt do the rest: it can read configurations."""
    from landerd.installation.program import PROGRAM

    return subprocess.run([PROGRAM, "install", "--board", board], check=False).returncode


def _keys() -> "tuple[list[Step], list[str], list[str]]":
    """Return what notes this version's keys, what is new in them, and faults of the user's."""
    from landerd.installation import keys
    from landerd.installation.service import CONFIGURATION

    return keys.key_steps(CONFIGURATION)
