"""The command line: one function a command.

Exit codes: 0 done, 1 ran and the result is bad, 2 the input is wrong. Modules are imported inside
the functions so that --help does not wait for numpy and OpenCV.
"""

import argparse
import difflib
import importlib.util
import json
import math
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from landerd import __version__

if TYPE_CHECKING:
    from landerd.config.files import Loaded


class InputError(Exception):
    """The input is wrong; the text is what the user reads."""


class _Command(NamedTuple):
    help: str
    example: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return the exit code."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    try:
        try:
            args = _parser(arguments).parse_args(arguments)
            code: int = args.run(args)
        finally:
            sys.stdout.flush()
    except InputError as e:
        print(e, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Whoever read our output has gone; nothing is left to say, at exit neither.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    return code


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    parser = _Parser(
        prog="landerd",
        description="Lands an ArduPilot multicopter on a marked pad by what a camera sees.",
        epilog="Try: landerd sim",
    )
    parser.add_argument("--version", action="version", version=f"landerd {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, command in _COMMANDS.items():
        sub = commands.add_parser(
            name,
            help=command.help,
            description=f"{command.help[0].upper()}{command.help[1:]}.",
            epilog=f"example:\n  {command.example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name in arguments:  # a command's arguments may need imports
            command.add_arguments(sub)
        sub.set_defaults(run=command.run)
    return parser


# ---- sim ---------------------------------------------------------------------------------------


def _sim_arguments(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(_scenarios())
    parser.add_argument(
        "scenario",
        nargs="?",
        default="stationary",
        metavar="SCENARIO",
        help=f"{names}; without one: stationary",
    )
    parser.add_argument(
        "--seed", type=_seed, default=1, metavar="N", help="of everything random (1)"
    )
    _add_config(parser)
    parser.add_argument("--realtime", action="store_true", help="no faster than a real flight")
    parser.add_argument(
        "--autopilot",
        metavar="URL",
        help="an ArduCopter in SITL flies, reached as autopilot.url says (tcp:127.0.0.1:5760); "
        "camera, gimbal and pad are simulated around it",
    )
    parser.add_argument(
        "--takeoff",
        type=_height,
        metavar="ALT",
        help="with --autopilot: arm it, take off to ALT metres, fly to the start, open the gate",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw the flight")
    parser.add_argument("--log", type=Path, metavar="FILE.mcap", help="record the flight")
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")


def _sim(args: argparse.Namespace) -> int:
    known = _scenarios()
    if args.scenario not in known:
        near = difflib.get_close_matches(args.scenario, known, n=1, cutoff=0.0)
        raise InputError(
            f"scenario {args.scenario!r} is not known; nearest: {near[0]}; all: {', '.join(known)}"
        )
    if args.picture is not None and not (
        args.picture.suffix == ".png" and args.picture.absolute().parent.is_dir()
    ):
        raise InputError(f"--picture {args.picture}: expected a .png in a folder that exists")
    if args.log is not None and not (
        args.log.suffix == ".mcap" and args.log.absolute().parent.is_dir()
    ):
        raise InputError(f"--log {args.log}: expected a .mcap in a folder that exists")
    if args.picture is not None and importlib.util.find_spec("matplotlib") is None:
        raise InputError("--picture needs matplotlib: pip install 'landerd[report]'")
    if args.autopilot is None and args.takeoff is not None:
        raise InputError("--takeoff: only with --autopilot URL; the stand-in flies already")
    if args.autopilot is not None and args.realtime:
        raise InputError("--realtime: not with --autopilot; the autopilot keeps the clock")
    loaded = _load(args, overlays=[known[args.scenario]])

    import logging

    from landerd.camera_model import CalibrationError
    from landerd.pad import PadError
    from landerd.simulation.flight import simulate
    from landerd.simulation.sitl import AutopilotError, simulate_sitl

    logging.basicConfig(level=logging.ERROR)  # faults are counted in the result
    shows_progress = sys.stdout.isatty() and not args.json
    progress = _show_progress if shows_progress else None
    try:
        if args.autopilot is None:
            result = simulate(
                loaded,
                args.scenario,
                args.seed,
                realtime=args.realtime,
                picture=args.picture,
                log=args.log,
                progress=progress,
            )
        else:
            result = simulate_sitl(
                loaded,
                args.scenario,
                args.seed,
                args.autopilot,
                take_off_m=args.takeoff,
                picture=args.picture,
                log=args.log,
                progress=progress,
            )
    except (AutopilotError, CalibrationError, PadError) as e:
        raise InputError(str(e)) from None
    if shows_progress:
        _show_progress("")
    print(json.dumps(result, allow_nan=False) if args.json else _summary(result))
    if args.picture is not None and not args.json:
        print(f"  picture: {args.picture}")
    if args.log is not None and not args.json:
        print(f"  flight log: {args.log}")
    return 0 if result["landed"] and not result["rules_broken"] else 1


def _show_progress(line: str) -> None:
    print(f"\r\x1b[K{line}", end="", flush=True)


def _summary(result: dict[str, Any]) -> str:
    """Say in plain words how the landing went."""

    def say(key: str, unit: str, digits: int) -> str:
        value = result[key]
        return "unknown" if value is None else f"{abs(value):.{digits}f} {unit}"

    phases = [
        f"{phase['name']} {phase['start']:.1f}-{phase['end']:.1f} s"
        for phase in result["phases"]
        if phase["name"] != "NOT_LANDING"
    ]
    landed = "Landed" if result["landed"] else f"Did not land: {result['outcome']}"
    lines = [
        f"{landed} (scenario {result['scenario']}, seed {result['seed']})",
        f"  touch-down {say('touchdown_error_m', 'm', 2)} from the landing point, "
        f"heading {say('yaw_error_deg', 'degrees', 1)} off",
        f"  at {say('touchdown_vertical_mps', 'm/s', 2)} down and "
        f"{say('touchdown_horizontal_mps', 'm/s', 2)} sideways over the pad",
        f"  first sight to touch-down {say('time_to_touchdown_s', 's', 1)}, "
        f"to disarm {say('time_s', 's', 1)}, {say('energy_hj', 'hJ', 1)}",
        f"  pad lost from sight {result['aborts']} times; "
        f"safety rules broken: {', '.join(result['rules_broken']) or 'none'}",
        f"  phases: {', '.join(phases)}",
        f"  {result['simulated_s']:.1f} s flown in {result['wall_s']:.1f} s",
    ]
    return "\n".join(lines)


def _scenarios() -> dict[str, Path]:
    from landerd.config.files import config_files

    return config_files("scenarios")


def _height(text: str) -> float:
    try:
        height = float(text)
    except ValueError:
        height = math.nan
    if not 2.0 <= height <= 100.0:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected metres from 2 to 100")
    return height


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdecimal()):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected a whole number, 0 or more")
    return int(text)


# ---- detect ------------------------------------------------------------------------------------


def _detect_arguments(parser: argparse.ArgumentParser) -> None:
    from landerd.commands.detect import add_arguments

    add_arguments(parser)


def _detect(args: argparse.Namespace) -> int:
    from landerd.commands.detect import run

    return run(args)


# ---- calibrate ---------------------------------------------------------------------------------


def _calibrate_arguments(parser: argparse.ArgumentParser) -> None:
    from landerd.commands import calibrate_camera, calibrate_gimbal

    devices = parser.add_subparsers(metavar="DEVICE", required=True)
    camera = devices.add_parser(
        "camera",
        help="lens, from pictures of a board",
        description="Find out what a camera's lens does, from pictures of a board.",
    )
    calibrate_camera.add_arguments(camera)
    camera.set_defaults(calibrate=calibrate_camera.run)
    gimbal = devices.add_parser(
        "gimbal",
        help="signs, zeros or tables, and delays, from views of a pad",
        description="Move a gimbal about and find out how it answers, from views of a pad that "
        "lies still. The vehicle stands disarmed.",
        epilog="example: landerd calibrate gimbal -c landerd.yaml -o gimbal-found.yaml",
    )
    calibrate_gimbal.add_arguments(gimbal)
    _add_config(gimbal, required=True)
    _add_overlay(gimbal)
    gimbal.set_defaults(calibrate=_calibrate_gimbal)


def _calibrate(args: argparse.Namespace) -> int:
    code: int = args.calibrate(args)
    return code


def _calibrate_gimbal(args: argparse.Namespace) -> int:
    from landerd.commands.calibrate_gimbal import run

    overlay = _overlay(args)
    return run(args, _load(args, overlays=[overlay] if overlay.exists() else []), overlay)


# ---- campaign ----------------------------------------------------------------------------------


def _campaign_arguments(parser: argparse.ArgumentParser) -> None:
    from landerd.commands.campaign import add_arguments

    add_arguments(parser)
    _add_config(parser)


def _campaign(args: argparse.Namespace) -> int:
    from landerd.commands.campaign import run

    return run(args)


# ---- replay ------------------------------------------------------------------------------------


def _replay_arguments(parser: argparse.ArgumentParser) -> None:
    from landerd.commands.replay import add_arguments

    add_arguments(parser)


def _replay(args: argparse.Namespace) -> int:
    from landerd.commands.replay import run

    return run(args)


# ---- report ------------------------------------------------------------------------------------


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    from landerd.commands.report import add_arguments

    add_arguments(parser)


def _report(args: argparse.Namespace) -> int:
    from landerd.commands.report import run

    return run(args)


# ---- dry-run -----------------------------------------------------------------------------------


def _dry_run_arguments(parser: argparse.ArgumentParser) -> None:
    from landerd.commands.dry_run import add_arguments

    add_arguments(parser)
    _add_config(parser)


def _dry_run(args: argparse.Namespace) -> int:
    from landerd.commands.dry_run import run

    return run(args, _load(args))


# ---- check -------------------------------------------------------------------------------------


def _check_arguments(parser: argparse.ArgumentParser) -> None:
    from landerd.commands.check import add_arguments

    add_arguments(parser)
    _add_config(parser, required=True)
    _add_overlay(parser)


def _check(args: argparse.Namespace) -> int:
    from landerd.commands.check import run

    overlay = _overlay(args)
    loaded = _load(args, overlays=[overlay] if overlay.exists() else [])
    return run(args, loaded, overlay)


# ---- run ---------------------------------------------------------------------------------------


def _run_arguments(parser: argparse.ArgumentParser) -> None:
    _add_config(parser, required=True)
    _add_overlay(parser)


def _run(args: argparse.Namespace) -> int:
    from landerd.commands.run import run

    overlay = _overlay(args)
    return run(_load(args, overlays=[overlay] if overlay.exists() else []), overlay)


# ---- shared ------------------------------------------------------------------------------------


def _add_config(parser: argparse.ArgumentParser, *, required: bool = False) -> None:
    parser.add_argument(
        "-c",
        "--config",
        type=Path,
        required=required,
        metavar="FILE",
        help="configuration" if required else "configuration; without one: the packaged default",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="set one key of the configuration; may be given again",
    )


def _add_overlay(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--overlay",
        type=Path,
        metavar="FILE",
        help="laid over the configuration if it exists, and where parameters that a ground station "
        "saves are written; without it: NAME.saved.yaml beside the configuration",
    )


def _overlay(args: argparse.Namespace) -> Path:
    path: Path = args.overlay or args.config.with_suffix(".saved.yaml")
    return path


def _load(args: argparse.Namespace, overlays: Sequence[Path] = ()) -> "Loaded":
    from landerd import devices as registry
    from landerd.config.files import ConfigError, config_dir, load

    try:
        loaded = load(
            args.config or config_dir() / "default.yaml",
            options_models=registry.options_models(),
            drivers=registry.names(),
            overlays=overlays,
            overrides=args.set,
        )
    except ConfigError as e:
        raise InputError(str(e)) from None
    for remark in loaded.remarks:
        print(remark, file=sys.stderr)
    return loaded


_COMMANDS = {
    "sim": _Command(
        "fly one landing in the simulator",
        "landerd sim moving --seed 3 --set sim.pad.speed_mps=0.5 --picture flight.png",
        _sim_arguments,
        _sim,
    ),
    "detect": _Command(
        "find the pad's markers in images, a folder, a video or a camera",
        "landerd detect photos/ --camera config/cameras/thesis.yaml --pad config/pads/thesis.yaml",
        _detect_arguments,
        _detect,
    ),
    "calibrate": _Command(
        "find out what a camera's lens does, or how a gimbal answers",
        "landerd calibrate camera photos/ --size 9x6 --square 0.025 -o my-camera.yaml",
        _calibrate_arguments,
        _calibrate,
    ),
    "campaign": _Command(
        "fly many landings in the simulator and print a table of results",
        "landerd campaign guidance --runs 5 --jobs 2",
        _campaign_arguments,
        _campaign,
    ),
    "replay": _Command(
        "run a flight log through today's code and compare",
        "landerd replay flight.mcap --set guidance.limits.speed_mps=2",
        _replay_arguments,
        _replay,
    ),
    "report": _Command(
        "show what happened in a flight, as a page for the browser",
        "landerd report flight.mcap -o report.html",
        _report_arguments,
        _report,
    ),
    "dry-run": _Command(
        "say what landerd would have ordered on a recorded flight; sends nothing",
        "landerd dry-run -c my.yaml --video flight.mp4 --telemetry flight.bin --gimbal 0,-90",
        _dry_run_arguments,
        _dry_run,
    ),
    "check": _Command(
        "open and measure camera, gimbal and autopilot, and say what would stop a landing",
        "landerd check -c /etc/landerd/landerd.yaml",
        _check_arguments,
        _check,
    ),
    "run": _Command(
        "fly: drive camera, gimbal and autopilot until stopped",
        "landerd run -c /etc/landerd/landerd.yaml",
        _run_arguments,
        _run,
    ),
}
