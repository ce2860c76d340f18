"""What the commands share: reporting wrong input, reading a configuration, writing files."""

import argparse
import contextlib
import json
import math
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from landerd.files import as_bytes, write_whole

if TYPE_CHECKING:
    from landerd.config.files import Loaded

_SERVICE = Path("/etc/landerd")  # folder of the services' configurations
_STATE = Path("/var/lib")  # in it systemd makes a folder for each service, with its name


class InputError(Exception):
    """The input is wrong: the command prints this error's text and exits with code 2.

    Attributes:
        is_told: the user has been told already; the text is not printed.
    """

    def __init__(self, text: str, *, is_told: bool = False) -> None:
        super().__init__(text)
        self.is_told = is_told


@contextlib.contextmanager
def refusing(*errors: type[Exception]) -> Iterator[None]:
    """Convert errors of these types within the block to InputError, with the same text."""
    try:
        yield
    except BrokenPipeError:
        raise
    except errors as e:
        raise InputError(str(e)) from None


async def ask(question: str) -> None:
    """Print an instruction, and wait until the user presses Enter.

    Args:
        question: the instruction.

    Raises:
        InputError: standard input has ended.
    """
    from landerd.worker import in_thread

    print(question)
    try:
        await in_thread(lambda: input("Press Enter when it is done. "), "prompt")
    except EOFError:
        raise InputError("nobody can press Enter: standard input has ended") from None


def tell(line: str) -> None:
    """Print a line that is not part of the result, to standard error."""
    print(line, file=sys.stderr)


# ---- the configuration -------------------------------------------------------------------------


def file_name(text: str) -> Path:
    """Return the path of a file or folder; the `type` of an argument.

    Raises:
        ArgumentTypeError: the text is empty, as of a shell variable that is not set; as a Path it
            would be the working directory.
    """
    if not text:
        raise argparse.ArgumentTypeError("found '', expected a file or folder")
    return Path(text)


def add_set(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --set; `what`: its help text."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help=f"{what}; may be given again",
    )


def add_config(parser: argparse.ArgumentParser, *, required: bool = False) -> None:
    """Add the arguments that choose a configuration: -c and --set."""
    parser.add_argument(
        "-c",
        "--config",
        type=file_name,
        required=required,
        metavar="FILE",
        help="configuration" if required else "configuration; without one: the packaged default",
    )
    add_set(parser, "set one key of the configuration")


def add_vehicle(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that choose a vehicle's configuration: -c (required), --set, --overlay."""
    add_config(parser, required=True)
    parser.add_argument(
        "--overlay",
        type=file_name,
        metavar="FILE",
        help="file of the parameters that a ground station saves; laid over the configuration if "
        "it exists; without: /var/lib/NAME/saved.yaml for a service's configuration "
        "(/etc/landerd/NAME.yaml), NAME.saved.yaml beside any other",
    )


def config_path(args: argparse.Namespace) -> Path:
    """Return the file that -c names, or landerd's own of that name if it does not exist.

    Without -c, the default configuration.
    """
    from landerd.config.files import default_config, own_or

    path: Path = args.config or default_config()
    found = own_or(path)
    if found != path:
        tell(f"{path}: not found here, landerd's own is used: {found}")
    return found


@contextlib.contextmanager
def settings_of_file(name: str, settings: Collection[str]) -> Iterator[None]:
    """Name the file, of a campaign or a tuning, in each ConfigError about one of its settings.

    Args:
        name: of the file.
        settings: KEY=VALUE, as the file has them.
    """
    from landerd.config.files import ConfigError

    try:
        yield
    except ConfigError as e:
        own = tuple(f"--set {setting}" for setting in settings)
        lines = [
            f"{name}: {line.removeprefix('--set ')}" if line.startswith(own) else line
            for line in e.lines
        ]
        raise ConfigError(lines) from None


def load_config(args: argparse.Namespace, overlays: Sequence[Path] = (), seed: int = 0) -> "Loaded":
    """Read the configuration that -c and --set choose, and print remarks on it.

    Args:
        args: of `add_config`.
        overlays: files laid over it.
        seed: of the values drawn from distributions.

    Raises:
        InputError: the configuration cannot be used.
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

    Args:
        args: of `add_vehicle`.

    Returns:
        The configuration, and the file into which parameters are saved; it need not exist.

    Raises:
        InputError: the configuration cannot be used.
    """
    overlay: Path = args.overlay or saved_file(args.config)
    return load_config(args, [overlay] if overlay.exists() else []), overlay


def saved_file(config: Path) -> Path:
    """Return the file of saved parameters that belongs to a configuration, without --overlay.

    For a service's configuration it is the file that the service itself uses.
    """
    if config.absolute().parent == _SERVICE and config.stem.startswith("landerd"):
        return service_folder(config) / "saved.yaml"
    # Not with_suffix, which fails for a folder without a name, as "/". That it is no configuration
    # is reported when it is read.
    return config.parent / f"{config.stem}.saved.yaml"


def service_folder(config: Path) -> Path:
    """Return the state folder of the service that reads /etc/landerd/NAME.yaml.

    Args:
        config: the configuration; for another file the folder is that of the service landerd.
    """
    return _STATE / (config.stem if config.stem.startswith("landerd") else "landerd")


def check_faults(loaded: "Loaded", *, in_sitl: bool = False, takes_off: bool = True) -> None:
    """Raise InputError if a simulated fault needs a device that is not simulated.

    Args:
        loaded: configuration with the faults.
        in_sitl: whether a real autopilot flies, in SITL.
        takes_off: whether the simulated pilot takes off with it.

    Raises:
        InputError: a fault cannot be simulated.
    """
    from hw.sim.fault_options import FAULTS
    from landerd.devices import sim_options

    faults = [each.fault for each in sim_options(loaded).faults]
    if faults and not takes_off:
        raise InputError("sim.faults: with --autopilot only with --takeoff, too")
    driver = loaded.config.gimbal.driver
    for fault in faults:
        if in_sitl and not FAULTS[fault].in_sitl:
            raise InputError(f"sim.faults: {fault} cannot be simulated with --autopilot")
        if FAULTS[fault].device == "gimbal" and driver != "sim":
            raise InputError(f"sim.faults: {fault} needs gimbal.driver sim, found {driver}")


def check_stand_in_flies(loaded: "Loaded") -> None:
    """Raise InputError if the simulated autopilot and pilot cannot fly a configuration.

    Raises:
        InputError: the autopilot's own precision landing is chosen; or the pilot is to ask for
            hold, but his switch has no position for it.
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
            "simulated autopilot does not have; fly an ArduCopter in SITL (landerd sim --autopilot "
            "URL)"
        )


def pad_path(name: str) -> Path:
    """Return the path of a pad file, or of landerd's own pad of this name.

    Args:
        name: path, or name as "nested".

    Raises:
        InputError: there is neither, or the name is empty.
    """
    from landerd.config.files import config_files, own_or

    if not name:  # as of a shell variable that is not set
        raise InputError("pad '': expected the name of a pad or a file")
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
    """Add --json, which prints the result as JSON."""
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")


def print_json(data: dict[str, Any]) -> None:
    """Print a JSON object on one line. Raises ValueError if it contains NaN or infinity."""
    print(json.dumps(data, allow_nan=False))


def check_output(path: Path | None, suffix: str, flag: str = "") -> None:
    """Raise InputError if a file has the wrong suffix or cannot be written.

    Args:
        path: file to be written; None: nothing is written.
        suffix: that the file must have, as ".png".
        flag: argument that names the file, as "--picture", for the error message; "": none.

    Raises:
        InputError: the suffix is wrong, the folder does not exist, or the file cannot be written.
    """
    if path is None:
        return
    where = f"{flag} {path}".lstrip()
    if not (path.suffix == suffix and path.absolute().parent.is_dir()):
        raise InputError(f"{where}: expected a {suffix} in a folder that exists")
    _try_to_write(path, where)


def check_folder(path: Path | None) -> None:
    """Raise InputError if the file of -o cannot be written; called before the work is done.

    Args:
        path: the file; None: nothing is written.

    Raises:
        InputError: its folder does not exist, or it cannot be written.
    """
    if path is None:
        return
    if not path.absolute().parent.is_dir():
        raise InputError(f"-o {path}: its folder does not exist")
    _try_to_write(path, f"-o {path}")


def check_not_read(path: Path | None, read: Path | None, flag: str = "-o") -> None:
    """Raise InputError if the file to be written is one that is read, and would be lost.

    Args:
        path: file to be written; None: nothing is written.
        read: file that is read; None: nothing is read.
        flag: argument that names the file to be written, for the error message.

    Raises:
        InputError: both are the same file.
    """
    if path is None or read is None or not (path.exists() and read.exists()):
        return
    if path.samefile(read):
        raise InputError(f"{flag} {path}: is read, too, and would be lost; name another file")


def _try_to_write(path: Path, where: str) -> None:
    """Raise InputError if a file cannot be opened for writing; the file is left as it was.

    os.access is not enough: it is not always right.

    Args:
        path: of the file.
        where: begins the error message.
    """
    try:
        is_new = not path.exists()
        path.open("ab").close()
        if is_new and not path.is_symlink():
            path.unlink()
    except OSError as e:
        raise InputError(f"{where}: cannot be written: {e.strerror}") from None


def write_text(path: Path, text: str) -> None:
    """Write a text into a file, completely or not at all.

    Raises:
        InputError: the file cannot be written; its old contents are kept.
    """
    write_bytes(path, as_bytes(text))


def write_bytes(path: Path, data: bytes) -> None:
    """Write bytes into a file, completely or not at all.

    Raises:
        InputError: the file cannot be written; its old contents are kept.
    """
    try:
        write_whole(path, data)
    except OSError as e:
        raise InputError(f"{path}: cannot be written: {e.strerror}") from None


# ---- numbers of the command line ---------------------------------------------------------------


def number(text: str) -> float:
    """Return the number in a text; NaN if it is no number."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def metres(least: float, most: float) -> Callable[[str], float]:
    """Return the `type` of an argument that is a length, m.

    Args:
        least: smallest length that is allowed, m.
        most: largest length that is allowed, m.
    """

    def parse(text: str) -> float:
        length = number(text)
        if not least <= length <= most:
            raise argparse.ArgumentTypeError(
                f"found {text!r}, expected metres from {least:g} to {most:g}"
            )
        return length

    return parse


def whole_number(least: int) -> Callable[[str], int]:
    """Return the `type` of an argument that is a whole number; least: the smallest allowed."""

    def parse(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and int(text) >= least):
            raise argparse.ArgumentTypeError(
                f"found {text!r}, expected a whole number, {least} or more"
            )
        return int(text)

    return parse


# ---- vehicle on a bench ------------------------------------------------------------------------


def add_bench(parser: argparse.ArgumentParser, output: str, what: str) -> None:
    """Add the arguments that the commands for a vehicle on a bench share.

    These are --without-autopilot, -o, --json and those of `add_vehicle`.

    Args:
        parser: gets the arguments.
        output: placeholder for the file of -o in the help, as FILE.csv.
        what: what -o writes, for the help.
    """
    parser.add_argument(
        "--without-autopilot",
        action="store_true",
        help="no autopilot is connected: the vehicle is taken to be disarmed and level",
    )
    parser.add_argument("-o", "--output", type=file_name, metavar=output, help=what)
    add_json(parser)
    add_vehicle(parser)


def check_bench(args: argparse.Namespace, loaded: "Loaded") -> None:
    """Raise InputError if arguments of `add_bench` cannot be used with the configuration.

    Raises:
        InputError: -o cannot be written or is the configuration itself, or the gimbal is reached
            through the autopilot, which --without-autopilot leaves out.
    """
    from landerd.drivers import gimbal_speaks_over

    check_folder(args.output)
    check_not_read(args.output, args.config)
    driver = loaded.config.gimbal.driver
    if args.without_autopilot and gimbal_speaks_over(driver) == "autopilot":
        raise InputError(f"--without-autopilot: the gimbal ({driver}) needs the autopilot's link")
