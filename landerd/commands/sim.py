"""`landerd sim`: flies one landing in the simulator, and prints how it went."""

import argparse
import contextlib
import importlib.util
import logging
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from landerd.camera_model import CalibrationError
from landerd.commands.keeping import sitting
from landerd.commands.shared import (
    InputError,
    add_config,
    add_json,
    check_faults,
    check_output,
    check_stand_in_flies,
    file_name,
    load_config,
    metres,
    print_json,
    refusing,
    tell,
    whole_number,
)
from landerd.config.files import Loaded, config_files
from landerd.config.schema import nearest
from landerd.pad import PadError

if TYPE_CHECKING:
    from landerd.runtime.daemon import Daemon
    from landerd.web import FoxgloveServer, StatusPage


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    names = ", ".join(config_files("scenarios"))
    parser.add_argument(
        "scenario",
        nargs="?",
        default="stationary",
        metavar="SCENARIO",
        help=f"{names}; without one: stationary",
    )
    parser.add_argument(
        "--seed",
        type=whole_number(0),
        default=1,
        metavar="N",
        help="seed of all random numbers (1)",
    )
    add_config(parser)
    parser.add_argument(
        "--realtime", action="store_true", help="simulate no faster than a real flight"
    )
    parser.add_argument(
        "--autopilot",
        metavar="URL",
        help="fly an ArduCopter in SITL at this address, written as autopilot.url "
        "(tcp:127.0.0.1:5760); camera, gimbal and pad are simulated around it",
    )
    parser.add_argument(
        "--takeoff",
        type=metres(2.0, 100.0),
        metavar="ALT",
        help="with --autopilot: arm it, take off to ALT metres, fly to the start, open the gate",
    )
    parser.add_argument(
        "--picture", type=file_name, metavar="FILE.png", help="write a drawing of the flight"
    )
    parser.add_argument("--log", type=file_name, metavar="FILE.mcap", help="record the flight")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Fly the landing and print how it went.

    Returns:
        0, or 1 if it did not land or broke a rule, or 2 if a file could not be written.

    Raises:
        InputError: an argument or the configuration cannot be used, or SITL fails.
    """
    loaded = _load(args)
    logging.basicConfig(level=logging.ERROR)  # faults are counted in the result
    shows_progress = sys.stdout.isatty() and not args.json
    page, foxglove = _viewers(args, loaded)
    viewers = [viewer for viewer in (page, foxglove) if viewer is not None]

    def watch(daemon: "Daemon") -> None:
        for viewer in viewers:
            viewer.watch(daemon)

    try:
        result = _fly(args, loaded, _show_progress if shows_progress else None, watch)
        if shows_progress:
            _show_progress("")
        _print(args, result)
        if page is not None:
            _show_on(page, stays=shows_progress)
    finally:
        for viewer in viewers:
            viewer.close()
    if result["not_written"]:
        return 2
    return 0 if result["landed"] and not result["rules_broken"] else 1


def _print(args: argparse.Namespace, result: dict[str, Any]) -> None:
    """Print how the flight went, and the files that were written and that could not be."""
    if args.json:
        # A flight in SITL cannot be repeated exactly: its date and landerd's version are recorded.
        flown = {} if args.autopilot is None else {"flown": sitting()._asdict()}
        print_json({**result, **flown})
    else:
        print(_summary(result))
        is_modelled = result.get("sight") == "modelled"
        without = " (without the camera's pictures: sim.sight is modelled)" if is_modelled else ""
        files = [("picture", args.picture), *(("flight log", log) for log in result["logs"])]
        for name, path in files:
            if path is not None and not any(str(path) in line for line in result["not_written"]):
                print(f"  {name}: {path}{without}")
    if result["not_written"]:
        tell("\n".join(result["not_written"]))


def _load(args: argparse.Namespace) -> Loaded:
    """Return the configuration of the scenario. Raises InputError if an argument is wrong."""
    known = config_files("scenarios")
    if args.scenario not in known:
        near = nearest(args.scenario, known)
        raise InputError(
            f"scenario {args.scenario!r} is not known; nearest: {near}; all: {', '.join(known)}"
        )
    check_output(args.picture, ".png", "--picture")
    check_output(args.log, ".mcap", "--log")
    if args.picture is not None and importlib.util.find_spec("matplotlib") is None:
        raise InputError("--picture needs matplotlib: pip install matplotlib")
    if args.autopilot is None and args.takeoff is not None:
        raise InputError("--takeoff: only with --autopilot URL; the stand-in flies already")
    if args.autopilot is not None and args.realtime:
        raise InputError("--realtime: not with --autopilot; the autopilot keeps the clock")
    loaded = load_config(args, [known[args.scenario]], args.seed)
    if args.autopilot is None:
        check_stand_in_flies(loaded)
    in_sitl = args.autopilot is not None
    check_faults(loaded, in_sitl=in_sitl, takes_off=not in_sitl or args.takeoff is not None)
    return loaded


def _viewers(
    args: argparse.Namespace, loaded: Loaded
) -> "tuple[StatusPage | None, FoxgloveServer | None]":
    """Return the status page and Foxglove's server; None: not configured, or not --realtime.

    Raises:
        InputError: the calibration or the pad file cannot be used.
    """
    config = loaded.config
    asked = [key for key in ("listen", "foxglove") if getattr(config.web, key) is not None]
    if not asked:
        return None, None
    if not args.realtime:
        tell(f"web.{asked[0]}: flights are shown with --realtime only")
        return None, None
    from landerd.camera_model import load_camera
    from landerd.pad import load_pad
    from landerd.preflight.computer import temperature_c
    from landerd.web import FoxgloveServer, StatusPage

    with refusing(CalibrationError, PadError):
        camera, layout = load_camera(config.camera.calibration), load_pad(config.pad.layout)
    folder = args.log.absolute().parent if args.log is not None else None
    page = StatusPage.of(config, camera, layout, folder, temperature_c)
    if page is not None:
        tell(f"status page: {page.url}")
    return page, FoxgloveServer.of(config, camera, layout)


def _show_on(page: "StatusPage", *, stays: bool) -> None:
    """Show the end of the flight on the status page.

    Args:
        page: the status page.
        stays: whether to wait until Ctrl-C: somebody is at the terminal.
    """
    page.flight_is_over()
    if stays:
        tell(f"the flight's end is shown on {page.url} until Ctrl-C")
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


def _fly(
    args: argparse.Namespace,
    loaded: Loaded,
    progress: Callable[[str], None] | None,
    watch: "Callable[[Daemon], None]",
) -> dict[str, Any]:
    """Fly and return the result; `progress` is called with a line on the state of the flight.

    Raises:
        InputError: the autopilot cannot be used, or the calibration or the pad file.
    """
    # Imported here, so that wrong arguments are reported without waiting for the simulator.
    from landerd.simulation.flight import simulate
    from landerd.simulation.sitl import AutopilotError, simulate_sitl

    with refusing(AutopilotError, CalibrationError, PadError):
        if args.autopilot is None:
            return simulate(
                loaded,
                args.scenario,
                args.seed,
                realtime=args.realtime,
                picture=args.picture,
                log=args.log,
                progress=progress,
                watch=watch,
            )
        return simulate_sitl(
            loaded,
            args.scenario,
            args.seed,
            args.autopilot,
            take_off_m=args.takeoff,
            picture=args.picture,
            log=args.log,
            progress=progress,
        )


def _show_progress(line: str) -> None:
    """Replace the terminal's current line."""
    print(f"\r\x1b[K{line}", end="", flush=True)


def _summary(result: dict[str, Any]) -> str:
    """Return in words how the landing went, several lines."""

    def say(key: str, unit: str, digits: int) -> str:
        value = result[key]
        return "unknown" if value is None else f"{abs(value):.{digits}f} {unit}"

    phases = [
        f"{phase['name']} {phase['start']:.1f}-{phase['end']:.1f} s"
        for phase in result["phases"]
        if phase["name"] != "NOT_LANDING"
    ]
    landed = "Landed" if result["landed"] else f"Did not land: {result['outcome']}"
    if result["landed"] and result["rules_broken"]:
        landed = "Landed, but a safety rule was broken"
    lines = [
        f"{landed} (scenario {result['scenario']}, seed {result['seed']})",
        f"  touch-down {say('touchdown_error_m', 'm', 2)} from the landing point, "
        f"heading {say('yaw_error_deg', 'degrees', 1)} off",
        f"  at {say('touchdown_vertical_mps', 'm/s', 2)} down and "
        f"{say('touchdown_horizontal_mps', 'm/s', 2)} sideways over the pad",
        f"  first sight to touch-down {say('time_to_touchdown_s', 's', 1)}, "
        f"to disarm {say('time_s', 's', 1)}, {_energy(result['energy_hj'])}",
        f"  pad lost from sight {result['aborts']} times; "
        f"safety rules broken: {', '.join(_marked(result, 'rules_broken')) or 'none'}",
        f"  phases: {', '.join(phases)}".rstrip(),
        *(f"  danger: {finding}" for finding in _marked(result, "findings")),
        *(f"  fault: {_happened(fault)}" for fault in result["faults_flown"]),
        f"  {result['simulated_s']:.1f} s flown in {result['wall_s']:.1f} s",
        *_held_up(result.get("held_up_s")),
    ]
    return "\n".join(lines)


def _marked(result: dict[str, Any], key: str) -> list[str]:
    """Return the rules broken or the findings, each with a remark if a fault excuses it.

    Args:
        result: of the flight.
        key: "rules_broken" or "findings".
    """
    excused = result["excused"]
    return [f"{each}, excused by a fault" if each in excused else each for each in result[key]]


def _held_up(longest_s: float | None) -> list[str]:
    """Return a warning if this computer was too slow for a flight in real time.

    Args:
        longest_s: longest delay of the flight, s; None: it was not in real time.
    """
    if not longest_s:
        return []
    return [
        f"  this computer was too busy: it delayed the flight by up to {1e3 * longest_s:.0f} ms; "
        "that alone may be why rules were broken or the pad was lost from sight"
    ]


def _energy(hectojoules: float | None) -> str:
    """Return the energy in words: in hJ as in the thesis, and in Wh as for batteries."""
    if hectojoules is None:
        return "energy unknown"
    return f"{hectojoules:.1f} hJ ({hectojoules / 36.0:.2f} Wh)"


def _happened(fault: dict[str, Any]) -> str:
    """Return a fault in words, with its begin, end and phase."""
    if fault["began"] is None:
        return f"{fault['fault']}: it never began"
    until = "the end" if fault["ended"] is None else f"{fault['ended']:.1f} s"
    return f"{fault['fault']} from {fault['began']:.1f} s to {until}, begun in {fault['phase']}"
