"""What the commands share: how input is refused, choosing a configuration, writing files."""

import argparse
import contextlib
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from landerd.config.files import Loaded


class InputError(Exception):
    """The input is wrong; the text is what the user reads. The way to exit code 2.

    Attributes:
        is_told: the user has read it already.
    """

    def __init__(self, text: str, *, is_told: bool = False) -> None:
        super().__init__(text)
        self.is_told = is_told


@contextlib.contextmanager
def refusing(*errors: type[Exception]) -> Iterator[None]:
    """Make an InputError of these: what they say of the input is meant for the user."""
    try:
        yield
    except errors as e:
        raise InputError(str(e)) from None


def tell(line: str) -> None:
    """Say something that is no result: to stderr."""
    print(line, file=sys.stderr)


# ---- the configuration -------------------------------------------------------------------------


def add_set(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --set, of which `what` says what it does."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help=f"{what}; may be given again",
    )


def add_config(parser: argparse.ArgumentParser, *, required: bool = False) -> None:
    """Add what chooses a configuration: -c and --set."""
    parser.add_argument(
        "-c",
        "--config",
        type=Path,
        required=required,
        metavar="FILE",
        help="configuration" if required else "configuration; without one: the packaged default",
    )
    add_set(parser, "set one key of the configuration")


def add_overlay(parser: argparse.ArgumentParser) -> None:
    """Add what chooses the file of saved parameters: --overlay."""
    parser.add_argument(
        "--overlay",
        type=Path,
        metavar="FILE",
        help="laid over the configuration if it exists, and where parameters that a ground station "
        "saves are written; without it: NAME.saved.yaml beside the configuration",
    )


def config_path(args: argparse.Namespace) -> Path:
    """Return the file of `add_config`'s arguments."""
    from landerd.config.files import config_dir

    path: Path = args.config or config_dir() / "default.yaml"
    return path


def load_config(args: argparse.Namespace, overlays: Sequence[Path] = (), seed: int = 0) -> "Loaded":
    """Read the configuration of `add_config`'s arguments, and tell what was changed in it.

    Args:
        args: of the command line.
        overlays: files laid over it.
        seed: of what the simulated world draws.

    Raises:
        InputError: it cannot be used.
    """
    from landerd.config.files import ConfigError
    from landerd.drivers import read_configuration

    with refusing(ConfigError):
        loaded = read_configuration(
            config_path(args), overlays=overlays, overrides=args.set, seed=seed
        )
    for remark in loaded.remarks:
        tell(remark)
    return loaded


def load_with_saved(args: argparse.Namespace) -> tuple["Loaded", Path]:
    """Read the configuration with the parameters that a ground station has saved.

    Returns:
        The configuration, and where parameters are saved.

    Raises:
        InputError: it cannot be used.
    """
    overlay: Path = args.overlay or args.config.with_suffix(".saved.yaml")
    return load_config(args, [overlay] if overlay.exists() else []), overlay


def check_stand_in_flies(loaded: "Loaded") -> None:
    """Refuse a configuration in which the autopilot itself lands: the stand-in for it cannot.

    Raises:
        InputError: it is one.
    """
    if loaded.config.guidance.output == "landing_target":
        raise InputError(
            "guidance.output: landing_target needs ArduPilot's own precision landing, which the "
            "simulated autopilot has not; fly an ArduCopter in SITL (landerd sim --autopilot URL)"
        )


# ---- output ------------------------------------------------------------------------------------


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json."""
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")


def print_json(data: dict[str, Any]) -> None:
    """Print one JSON object on a line; what is no number in it is an error."""
    print(json.dumps(data, allow_nan=False))


def check_output(path: Path | None, suffix: str, flag: str = "") -> None:
    """Refuse a file that is to be written, if it has another suffix or its folder is not there.

    Args:
        path: None: nothing is to be written.
        suffix: as ".png".
        flag: as "--picture", for what is said.

    Raises:
        InputError: it cannot be written there.
    """
    if path is not None and not (path.suffix == suffix and path.absolute().parent.is_dir()):
        where = f"{flag} {path}".lstrip()
        raise InputError(f"{where}: expected a {suffix} in a folder that exists")


def check_folder(path: Path | None) -> None:
    """Refuse an -o whose folder is not there; None: nothing is to be written.

    Raises:
        InputError: it cannot be written there.
    """
    if path is not None and not path.absolute().parent.is_dir():
        raise InputError(f"-o {path}: its folder does not exist")


def whole_number(text: str, least: int) -> int:
    """Return a command line's whole number.

    Raises:
        ArgumentTypeError: it is none, or less.
    """
    if not (text.isascii() and text.isdecimal() and int(text) >= least):
        raise argparse.ArgumentTypeError(
            f"found {text!r}, expected a whole number, {least} or more"
        )
    return int(text)
