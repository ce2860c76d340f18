"""The service around the program: user, groups, udev's rules, example configuration, unit."""

import grp
import json
import os
import pwd
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import NamedTuple

from landerd.installation.program import OPT, PROGRAM
from landerd.installation.steps import InstallError, Step, call, command, link, remove, write

USER = "landerd"
GROUPS = ("dialout", "video", "i2c", "gpio")  # serial ports, cameras, I2C, the board's PWM
_MADE_BY_US = OPT / "groups.json"  # of these, to be removed with the rest
CONFIGURATION = Path("/etc/landerd/landerd.yaml")
STATE = Path("/var/lib/landerd")
_UNITS = Path("/etc/systemd/system")
_UNIT = _UNITS / "landerd.service"
_FOR_MORE = _UNITS / "landerd@.service"  # the same file: landerd@boat reads landerd@boat.yaml
_DROP_INS = _UNITS / "landerd.service.d"
_RULES = Path("/etc/udev/rules.d/99-landerd.rules")
_LINK = Path("/usr/local/bin/landerd")


class Board(NamedTuple):
    """What differs between companion boards."""

    dropin: str | None  # of systemd/, beside the unit
    left: Sequence[str]  # to be done by hand, a line each


BOARDS: Mapping[str, Board] = {
    "pixhawk-usb": Board(None, ()),
    "pixhawk-uart": Board(
        None,
        (
            "sudo raspi-config: login shell over serial no, serial hardware yes",
            "on a Raspberry Pi 5: autopilot.url serial:/dev/ttyAMA0?baud=921600",
        ),
    ),
    "navio2": Board(
        "navio2.conf",
        (
            'in /etc/default/arducopter: TELEM2="-A udp:127.0.0.1:14550"',
            "in arducopter.service: CPUAffinity=0 1",
        ),
    ),
    "jetson": Board(
        "jetson.conf",
        (
            "sudo apt install python3-gi gir1.2-gst-plugins-base-1.0",
            "sudo systemctl disable --now nvgetty",
        ),
    ),
}


def install_steps(board: str, root: Path) -> list[Step]:
    """Return what is left to do.

    Args:
        board: of BOARDS.
        root: "/", or the folder of another system's files: then no command is run.
    """
    here = root == Path("/")
    account = list(_account()) if here else []
    rules = list(write(_below(root, _RULES), _shipped("systemd", _RULES.name)))
    units = list(_unit_steps(board, root))
    steps = [*account, *_configuration(board, root), *rules, *units]
    if here:
        steps += link(_LINK, PROGRAM)
    return steps + (_tell(bool(rules), bool(units)) if here else [])


def uninstall_steps(root: Path) -> list[Step]:
    """Return what is there to be taken away: all but logs and configurations."""
    here = root == Path("/")
    rules = list(remove(_below(root, _RULES)))
    units = [
        step for path in (_UNIT, _FOR_MORE, *_DROP_IN_FILES) for step in remove(_below(root, path))
    ]
    if here and units and _systemd_runs():
        units.insert(0, command("systemctl", "disable", "--quiet", "landerd.service"))
    folder = _below(root, _DROP_INS)
    if folder.is_dir() and not {p.name for p in folder.iterdir()} - {
        p.name for p in _DROP_IN_FILES
    }:
        units.append(Step(f"remove {folder}", folder.rmdir))
    steps = [*units, *rules]
    if here:
        steps += _tell(bool(rules), bool(units))
        if _LINK.is_symlink() and _LINK.readlink() == PROGRAM:
            steps += remove(_LINK)
        steps += _account_away()
        steps += remove(OPT)
    return steps


def parameter_file(board: str) -> Path:
    """Return the file of ArduCopter's parameters for a board, names of 4.5 and 4.6."""
    package = Path(__file__).parents[1]
    packaged = package / "ardupilot_files"
    folder = packaged if packaged.is_dir() else package.parent / "ardupilot"
    return folder / f"{board}.param"


def refuse_while_it_runs() -> None:
    """Raise InstallError while the service runs: it may be flying."""
    if not _systemd_runs():
        return
    names = ("landerd.service", "landerd@*.service")
    states = "--state=active,activating,reloading,deactivating"
    listing = ("systemctl", "list-units", "--plain", "--no-legend", states, *names)
    running = subprocess.run(listing, capture_output=True, text=True, check=False).stdout.split()
    if running:
        unit = running[0].removesuffix(".service")
        raise InstallError(
            f"{unit} is running, and may be flying: on the ground, sudo systemctl stop {unit}"
        )


def _systemd_runs() -> bool:
    return Path("/run/systemd/system").is_dir()  # sd_booted(3)


def _below(root: Path, path: Path) -> Path:
    return root / path.relative_to("/")


def _shipped(folder: str, *names: str) -> str:
    """Return the text of a file that comes with landerd, in a checkout, wheel or environment."""
    packaged: Traversable = resources.files("landerd") / f"{folder}_files"
    found = packaged if packaged.is_dir() else Path(__file__).parents[2] / folder
    return found.joinpath(*names).read_text(encoding="utf-8")


# ---- account -----------------------------------------------------------------------------------


def _account() -> Iterator[Step]:
    """Yield what makes user and groups; it joins the groups, udev's rules name them."""
    there = {group.gr_name: group.gr_mem for group in grp.getgrall()}
    missing = [group for group in GROUPS if group not in there]
    for group in missing:
        yield command("groupadd", "--system", group)
    if missing:
        made = json.dumps(sorted({*_made_by_us(), *missing}))
        yield from write(_MADE_BY_US, made)
    if not _user_exists():
        words = ("--system", "--no-create-home", "--shell", "/usr/sbin/nologin")
        yield command("useradd", *words, USER)
    outside = [group for group in GROUPS if USER not in there.get(group, ())]
    if outside:
        yield command("usermod", "--append", "--groups", ",".join(outside), USER)


def _account_away() -> Iterator[Step]:
    if STATE.is_dir():  # a user number that is free may be another's tomorrow
        text = f"give what is in {STATE} to root"
        yield Step(text, partial(call, "chown", "--recursive", "root:root", str(STATE)))
    if _user_exists():
        yield command("userdel", USER)
    there = {group.gr_name for group in grp.getgrall()}
    for group in _made_by_us():
        if group in there:
            yield command("groupdel", group)


def _made_by_us() -> list[str]:
    try:
        names: list[str] = json.loads(_MADE_BY_US.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []
    return names


def _user_exists() -> bool:
    try:
        pwd.getpwnam(USER)
    except KeyError:
        return False
    return True


# ---- files -------------------------------------------------------------------------------------


def _configuration(board: str, root: Path) -> Iterator[Step]:
    """Yield what writes the example for a board; a configuration that is there is the user's."""
    path = _below(root, CONFIGURATION)
    if not path.exists():
        # There it lies beside nothing: what it includes is found among landerd's own files.
        text = _shipped("config", "vehicles", f"{board}.yaml").replace("../", "")
        yield from write(path, text, why=f", the example for {board}")


_DROP_IN_FILES = [_DROP_INS / board.dropin for board in BOARDS.values() if board.dropin]


def _unit_steps(board: str, root: Path) -> Iterator[Step]:
    unit = _shipped("systemd", _UNIT.name)
    yield from write(_below(root, _UNIT), unit)
    more = _below(root, _FOR_MORE)
    if more.exists():
        yield from write(more, unit)
    dropin = BOARDS[board].dropin
    for path in _DROP_IN_FILES:
        if path.name == dropin:
            yield from write(_below(root, path), _shipped("systemd", dropin))
        else:
            yield from remove(_below(root, path))


def _tell(rules: bool, units: bool) -> list[Step]:
    """Return what tells udev and systemd of changed files."""
    steps = []
    if rules and os.access("/run/udev/control", os.F_OK):
        steps += [command("udevadm", "control", "--reload"), command("udevadm", "trigger")]
    if units and _systemd_runs():
        steps.append(command("systemctl", "daemon-reload"))
    return steps
