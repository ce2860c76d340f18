"""ardupilot/*.param: what to set in ArduCopter, a file for each board and generation of names.

What `landerd check` judges comes from its own table (landerd.preflight.parameters); beside it here
stands what a board needs for its link and gimbal. Sources: docs/ardupilot.md; names of 4.7 from
ArduPilot's list of renamed parameters.

Ground stations read lines of NAME,VALUE and skip those that begin with #; more on a line is refused
by some of them, so a remark has a line of its own.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.preflight.parameters import SUCCESSORS, judged_parameters


class _Entry(NamedTuple):
    name: str
    value: float
    why: str


_FOR_ALL = (
    _Entry("DISARM_DELAY", 3, "disarms by itself where landerd's order is not heard"),
    _Entry("FS_EKF_ACTION", 1, "LAND when the EKF fails: GUIDED needs a position"),
    _Entry("BATT_FS_LOW_ACT", 2, "RTL: set BATT_LOW_VOLT for your battery, or nothing comes of it"),
)
_TELEM2 = (
    _Entry("SERIAL2_PROTOCOL", 2, "MAVLink 2 on TELEM2"),
    _Entry("SERIAL2_BAUD", 921, "as in autopilot.url"),
    _Entry("BRD_SER2_RTSCTS", 0, "no flow control lines are connected"),
)
_STREAMS = ("RAW_SENS", "EXT_STAT", "RC_CHAN", "RAW_CTRL", "POSITION", "EXTRA1", "EXTRA2", "EXTRA3")
_BOARDS: Mapping[str, tuple[_Entry, ...]] = {
    "pixhawk-usb": (_Entry("SERIAL0_PROTOCOL", 2, "MAVLink 2 on USB"),),
    "pixhawk-uart": _TELEM2,
    "navio2": (
        _Entry("SERIAL0_PROTOCOL", 2, "MAVLink 2 to landerd's port, -A of /etc/default/arducopter"),
        _Entry("SERVO13_FUNCTION", 0, "landerd's servo of yaw"),
        _Entry("SERVO14_FUNCTION", 0, "landerd's servo of pitch"),
    ),
    "jetson": _TELEM2,
}
_AT_TELEM2 = ("pixhawk-uart", "jetson")
_BY_HAND: Mapping[str, tuple[str, ...]] = {
    "jetson": ("By hand: MNT1_TYPE for your gimbal, and what ArduPilot's page on it asks for.",),
}
_HEAD = """\
# What landerd wants of ArduCopter {release}, board {board}. Load it with Mission Planner (Config,
# Full Parameter List, Load from file) or MAVProxy (param load FILE), and restart the autopilot.
# It calibrates nothing and tunes nothing: your vehicle flies well in LOITER before.
# By hand: a position of your mode switch for GUIDED, one for LOITER (FLTMODE1 to FLTMODE6).
"""


def files() -> dict[str, str]:
    """Return the text of each file by its path below the checkout."""
    made = {}
    for board in _BOARDS:
        made[f"ardupilot/{board}.param"] = _text(board, "4.5 or 4.6", renamed=False)
        made[f"ardupilot/{board}-4.7.param"] = _text(board, "4.7 or newer", renamed=True)
    return made


def _text(board: str, release: str, *, renamed: bool) -> str:
    lines = [_HEAD.format(release=release, board=board).rstrip()]
    lines += [f"# {line}" for line in _BY_HAND.get(board, ())]
    if board in _AT_TELEM2 and renamed:
        lines.append("# By hand: the MAVn_ stream rates of TELEM2's link number to 0.")
    for entry in _entries(board, renamed=renamed):
        lines += [f"# {entry.why}"] if entry.why else []
        lines.append(f"{entry.name},{entry.value:g}")
    return "\n".join(lines) + "\n"


def _entries(board: str, *, renamed: bool) -> Iterator[_Entry]:
    config = read_configuration(config_dir() / "vehicles" / f"{board}.yaml").config
    gone = SUCCESSORS.keys() if renamed else SUCCESSORS.values()
    for name, rule in judged_parameters(config).items():
        if name not in gone:
            yield _Entry(name, rule.best, f"else: {rule.why}")
    yield from _FOR_ALL
    yield from _BOARDS[board]
    if board in _AT_TELEM2 and not renamed:
        for stream in _STREAMS:
            yield _Entry(f"SR2_{stream}", 0, "")
