"""`landerd replay`: runs a recorded flight through this version's code, and compares."""

import argparse
import math
from typing import Any

from landerd.commands.shared import (
    InputError,
    add_json,
    add_set,
    file_name,
    print_json,
    refusing,
    tell,
)
from landerd.config.files import ConfigError, from_record
from landerd.config.models import Config
from landerd.drivers import options_models
from landerd.flightlog.reader import FlightLog, LogError, read_log
from landerd.flightlog.replay import (
    TOLERANCE,
    Comparison,
    Replayed,
    VisionReplayed,
    phases,
    replay,
    replay_vision,
)
from landerd.messages import Command

# Keys that name files. The log contains what these files were, so --set cannot change them.
_HELD = ("pad.layout", "camera.calibration")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("log", type=file_name, metavar="LOG.mcap", help="flight log")
    add_set(parser, "replay with another value of this key of the configuration")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print how the replay differs from the log; return 0, or 1 if it differs without --set."""
    for key in (option.partition("=")[0].strip() for option in args.set):
        if key in _HELD:
            raise InputError(f"--set {key}: the log's own is replayed; no other can be given")
        if any(f"{key}.".startswith(f"{block}.") for block in options_models()):
            raise InputError(
                f"--set {key}: a log has neither simulator nor drivers, only what came of them"
            )
    with refusing(LogError, ConfigError):
        log = read_log(args.log)
        config, unknown = config_of(log, args.set)
    for note in log.notes:
        tell(note)
    for key in unknown:
        tell(f"{log.path}: {key}: this version has no such key, it is left out")
    if not log.replayable:
        raise InputError(f"{log.path}: the flight's first messages are missing: none is replayed")
    replayed = replay(log, config)
    vision = replay_vision(log, config)
    if args.json:
        print_json(_as_json(replayed.comparison, vision))
    else:
        print(_in_words(log, replayed, vision, what_if=bool(args.set)))
    good = _is_good(replayed.comparison) and (isinstance(vision, str) or vision.within_tolerance)
    return 0 if good or args.set else 1


def config_of(log: FlightLog, overrides: list[str]) -> tuple[Config, list[str]]:
    """Return a log's configuration with overrides, and those of its keys that are unknown today.

    Args:
        log: the flight log.
        overrides: KEY=VALUE, each.

    Raises:
        ConfigError: a value cannot be used.
    """
    return from_record(log.config, str(log.path), others=options_models(), overrides=overrides)


def _is_good(comparison: Comparison) -> bool:
    """Tell whether the replay agrees with the log within TOLERANCE."""
    return comparison.identical or comparison.largest <= TOLERANCE


def _as_json(logic: Comparison, vision: VisionReplayed | str) -> dict[str, Any]:
    """Return the object that `--json` prints; vision: as a text, why it was not replayed."""
    seen = None
    if isinstance(vision, VisionReplayed):
        seen = _comparison(vision.comparison, "frames") | {
            "largest_px": _finite(vision.pixels),
            "largest_m": _finite(vision.metres),
            "within_tolerance": vision.within_tolerance,
        }
    return _comparison(logic, "commands") | {"within_tolerance": _is_good(logic), "vision": seen}


def _comparison(comparison: Comparison, what: str) -> dict[str, Any]:
    return {
        "identical": comparison.identical,
        what: comparison.compared,
        "first_difference": comparison.first.as_json() if comparison.first else None,
        "largest_difference": _finite(comparison.largest),
    }


def _finite(x: float) -> float | None:
    """Return a number for JSON, which cannot represent infinity or NaN: these are None."""
    return x if math.isfinite(x) else None


def _in_words(
    log: FlightLog, replayed: Replayed, vision: VisionReplayed | str, *, what_if: bool
) -> str:
    logic = replayed.comparison
    first, last = log.steps[0].now, log.steps[-1].now
    recorded = ", ".join(f"{k} {log.versions[k]}" for k in ("landerd", "python", "machine"))
    lines = [
        f"{log.path}: {len(log.steps)} messages from {first:.1f} to {last:.1f} s, by {recorded}",
        f"  commands: {_verdict(logic, logic.compared)}",
        *_first(logic),
        f"  vision: {vision}"
        if isinstance(vision, str)
        else f"  vision: {_verdict(vision.comparison, vision.comparison.compared, ' frames')}",
    ]
    if isinstance(vision, VisionReplayed):
        lines += _first(vision.comparison)
        if not vision.comparison.identical:
            lines.append(f"    at most {vision.pixels:.3g} px and {vision.metres:.3g} m apart")
    if what_if or not _is_good(logic):
        lines += ["  phases as flown:", *_timeline([(s.now, s.commands) for s in log.steps])]
        lines += ["  phases now:", *_timeline(replayed.steps)]
        outcome = replayed.outcome or "none"
        lines.append(f"  outcome now: {outcome}, pad lost {replayed.aborts} times")
        lines.append("  (the vehicle moves as it was recorded, whatever is ordered now)")
    return "\n".join(lines)


def _verdict(comparison: Comparison, count: int, what: str = "") -> str:
    """Return in words how many differ, and by how much.

    Args:
        comparison: of the replay with the log.
        count: number of things compared.
        what: their name after a space; "": none.
    """
    if comparison.identical:
        return f"all {count}{what} identical"
    size = f", by at most {comparison.largest:.3g}" if math.isfinite(comparison.largest) else ""
    return f"{comparison.differing} of {count}{what} differ{size}"


def _first(comparison: Comparison) -> list[str]:
    """Return lines on the first difference; none if there is none."""
    d = comparison.first
    if d is None:
        return []
    return [
        f"    first at {d.t:.3f} s, step {d.step}: {d.field}",
        f"      logged   {d.logged!r}",
        f"      replayed {d.replayed!r}",
    ]


def _timeline(steps: list[tuple[float, list[Command]]]) -> list[str]:
    """Return a line for each change of phase; steps: times (s) and commands."""
    changes = phases(steps)
    return [f"    {t:7.2f} s  {c.phase.value:14}  {c.reason}" for t, c in changes] or ["    none"]
