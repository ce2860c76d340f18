"""What the commands share: how input is refused, choosing a configuration, writing files."""

import argparse
import contextlib
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from landerd.files import as_bytes, write_whole

if TYPE_CHECKING:
    from landerd.config.files import Loaded

_SERVICE = Path("/etc/landerd")  # where the unit has its configurations
_STATE = Path("/var/lib")  # in it systemd gives each service a folder of its name


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
    except BrokenPipeError:
        raise
    except errors as e:
        raise InputError(str(e)) from None


async def ask(question: str) -> None:
    """Show a person what is to be done, and wait until it is.

    Raises:
        InputError: nobody can answer.
    """
    from landerd.worker import in_thread

    print(question)
    try:
        await in_thread(lambda: input("Press Enter when it is so. "), "prompt")
    except EOFError:
        raise InputError("nobody can press Enter: standard input has ended") from None


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


def add_vehicle(parser: argparse.ArgumentParser) -> None:
    """Add what chooses a vehicle's configuration: -c, which must be given, --set and --overlay."""
    add_config(parser, required=True)
    parser.add_argument(
        "--overlay",
        type=Path,
        metavar="FILE",
        help="laid over the configuration if it exists, and where parameters that a ground station "
        "saves are written; without it: /var/lib/NAME/saved.yaml of a service's configuration, "
        "/etc/landerd/NAME.yaml, and NAME.saved.yaml beside any other",
    )


def config_path(args: argparse.Namespace) -> Path:
    """Return the file of `add_config`'s arguments; landerd's own where there is none here."""
    from landerd.config.files import default_config, own_or

    path: Path = args.config or default_config()
    found = own_or(path)
    if found != path:
        tell(f"{path}: not here, landerd's own is taken: {found}")
    return found


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
    overlay: Path = args.overlay or saved_file(args.config)
    return load_config(args, [overlay] if overlay.exists() else []), overlay


def saved_file(config: Path) -> Path:
    """Return where saved parameters are kept, unless --overlay says so: as the unit has it."""
    if config.absolute().parent == _SERVICE and config.stem.startswith("landerd"):
        return service_folder(config) / "saved.yaml"
    # A folder, as "" is, has no suffix; that it is no configuration is told where it is read.
    return config.parent / f"{config.stem}.saved.yaml"


def service_folder(config: Path) -> Path:
    """Return where the service that reads a configuration, /etc/landerd/NAME.yaml, keeps things."""
    return _STATE / (config.stem if config.stem.startswith("landerd") else "landerd")


def check_faults(loaded: "Loaded", *, in_sitl: bool = False, takes_off: bool = True) -> None:
    """Refuse faults of devices that do not fly.

    Args:
        loaded: has the faults.
        in_sitl: a real autopilot flies.
        takes_off: the simulated pilot flies it.

    Raises:
        InputError: there are some.
    """
    from hw.sim.fault_options import FAULTS
    from landerd.devices import sim_options

    faults = [each.fault for each in sim_options(loaded).faults]
    if faults and not takes_off:
        raise InputError("sim.faults: with --autopilot only with --takeoff, too")
    driver = loaded.config.gimbal.driver
    for fault in faults:
        if in_sitl and not FAULTS[fault].in_sitl:
            raise InputError(f"sim.faults: {fault} is not to be had with --autopilot")
        if FAULTS[fault].device == "gimbal" and driver != "sim":
            raise InputError(f"sim.faults: {fault} needs gimbal.driver sim, found {driver}")


def check_stand_in_flies(loaded: "Loaded") -> None:
    """Refuse a configuration that stand-ins cannot fly.

    Raises:
        InputError: the autopilot itself is to land, or the pilot to hold with no switch for it.
    """
    from landerd.devices import sim_options

    rc = loaded.config.rc
    if sim_options(loaded).autopilot.hold_s > 0.0 and rc.land_threshold_us <= rc.gate_threshold_us:
        raise InputError(
            "sim.autopilot.hold_s: the simulated pilot asks to hold with the middle of his switch, "
            "which is between rc.gate_threshold_us and rc.land_threshold_us: set the latter too"
        )
    if loaded.config.guidance.output == "landing_target":
        raise InputError(
            "guidance.output: landing_target needs ArduPilot's own precision landing, which the "
            "simulated autopilot has not; fly an ArduCopter in SITL (landerd sim --autopilot URL)"
        )


def pad_path(name: str) -> Path:
    """Return a pad's file: the one of this name, or else landerd's own, as nested.

    Raises:
        InputError: there is neither.
    """
    from landerd.config.files import config_files, own_or

    if Path(name).exists():
        return Path(name)
    own = config_files("pads")
    found = own.get(name) or own_or(Path(name))
    if not found.exists():
        known = ", ".join(own)
        raise InputError(f"{name}: no such file, and none of landerd's own pads: {known}")
    return found


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
    if path is None:
        return
    where = f"{flag} {path}".lstrip()
    if not (path.suffix == suffix and path.absolute().parent.is_dir()):
        raise InputError(f"{where}: expected a {suffix} in a folder that exists")
    _try_to_write(path, where)


def check_folder(path: Path | None) -> None:
    """Refuse an -o that cannot be written, before the work is done; None: there is none.

    Raises:
        InputError: its folder is not there, or it cannot be written there.
    """
    if path is None:
        return
    if not path.absolute().parent.is_dir():
        raise InputError(f"-o {path}: its folder does not exist")
    _try_to_write(path, f"-o {path}")


def check_not_read(path: Path | None, read: Path | None, flag: str = "-o") -> None:
    """Refuse a file that is to be written, if it is one that is read.

    Raises:
        InputError: what it holds would be lost.
    """
    if path is None or read is None or not (path.exists() and read.exists()):
        return
    if path.samefile(read):
        raise InputError(f"{flag} {path}: is read, too, and would be lost; name another file")


def _try_to_write(path: Path, where: str) -> None:
    """Open a file for writing, and leave all as it was: what `access` says is not always so."""
    try:
        is_new = not path.exists()
        path.open("ab").close()
        if is_new and not path.is_symlink():
            path.unlink()
    except OSError as e:
        raise InputError(f"{where}: cannot be written: {e.strerror}") from None


def write_text(path: Path, text: str) -> None:
    """Write a file whole, or leave the one that was there.

    Raises:
        InputError: it cannot be written.
    """
    write_bytes(path, as_bytes(text))


def write_bytes(path: Path, data: bytes) -> None:
    """Do the same with bytes."""
    try:
        write_whole(path, data)
    except OSError as e:
        raise InputError(f"{path}: cannot be written: {e.strerror}") from None


# ---- numbers of the command line ---------------------------------------------------------------


def number(text: str) -> float:
    """Return a command line's number; NaN: it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def metres(least: float, most: float) -> Callable[[str], float]:
    """Return the `type` of an argument that is a length within these limits, m."""

    def parse(text: str) -> float:
        length = number(text)
        if not least <= length <= most:
            raise argparse.ArgumentTypeError(
                f"found {text!r}, expected metres from {least:g} to {most:g}"
            )
        return length

    return parse


def whole_number(least: int) -> Callable[[str], int]:
    """Return the `type` of an argument that is a whole number, and no less than this."""

    def parse(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and int(text) >= least):
            raise argparse.ArgumentTypeError(
                f"found {text!r}, expected a whole number, {least} or more"
            )
        return int(text)

    return parse


# ---- on the bench ------------------------------------------------------------------------------


def add_bench(parser: argparse.ArgumentParser, output: str, what: str) -> None:
    """Add what the commands for a vehicle on a bench share.

    Args:
        parser: gets the arguments.
        output: what -o is shown with, as FILE.csv.
        what: what -o writes there.
    """
    parser.add_argument(
        "--without-autopilot",
        action="store_true",
        help="on a bench: nobody is asked whether the vehicle is disarmed, and it stands level",
    )
    parser.add_argument("-o", "--output", type=Path, metavar=output, help=what)
    add_json(parser)
    add_vehicle(parser)


def check_bench(args: argparse.Namespace, loaded: "Loaded") -> None:
    """Refuse arguments of `add_bench` that do not fit the configuration.

    Raises:
        InputError: -o cannot be written, or the gimbal speaks through an autopilot that is not
            there.
    """
    from landerd.drivers import gimbal_speaks_over

    check_folder(args.output)
    check_not_read(args.output, args.config)
    driver = loaded.config.gimbal.driver
    if args.without_autopilot and gimbal_speaks_over(driver) == "autopilot":
        raise InputError(f"--without-autopilot: {driver} speaks through the autopilot")
