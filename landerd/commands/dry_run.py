"""`landerd dry-run`: prints what landerd would have ordered in a recorded flight; sends nothing."""

import argparse
import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hw.replay.align import SURE, find_offset, picture_motion, turning_motion
from hw.replay.pictures import VideoPictures
from hw.replay.telemetry import (
    LEAST_RATE_HZ,
    Telemetry,
    TelemetryError,
    is_fast_enough,
    read_telemetry,
)
from hw.replay.track import MAX_GAP_S
from hw.replay.vehicle import RecordedVehicle
from hw.replay.video import VideoError, rate_hz, read_video
from landerd.analysis.orders_video import OrdersVideo, VideoNotWritten
from landerd.camera_model import CalibrationError, CameraModel, load_camera
from landerd.commands.shared import (
    InputError,
    add_config,
    add_json,
    check_not_read,
    check_output,
    file_name,
    load_config,
    number,
    print_json,
    refusing,
)
from landerd.config.files import Loaded
from landerd.config.models import Config
from landerd.devices import drawn_pictures, recorded_vehicle
from landerd.flightlog.contents import Head
from landerd.flightlog.recorder import Recorder
from landerd.flightlog.replay import phases
from landerd.geometry import Vec3
from landerd.messages import Command, Phase, PhaseChange
from landerd.pad import PadError, PadLayout, load_pad
from landerd.runtime.dry_run import DryRun, DryRunResult, Expose
from landerd.runtime.observer import Observer

GOOD_RATE_HZ = 20.0  # with a lower rate of attitudes or positions there is a remark
BELIEVED_MPS = 60.0  # highest speed in a recording that is believed: no copter flies faster
SEEN_FROM_M = 20.0  # distance beyond which pads of a metre are not detected
IN_THE_AIR_M = 2.0  # height above the pad from which on the recording has not ended on it
_FILMS = (".webm", ".mp4")  # suffixes of --draw; all browsers play the first
# Outcomes in words, where the outcome's name is not clear by itself.
_OUTCOMES = {
    None: "the recording ends before the landing does",
    "landed": "landed: on the pad when it was disarmed",
    "landed_off_pad": "disarmed beside the pad",
    "tipped_over": "disarmed, tipped over",
    "handed_back": "it would have handed back to the pilot, for the reason in the last line",
    "touchdown_unconfirmed": "it would have touched down; that the autopilot detects this, which "
    "landerd waits for, is in no recording",
}


@dataclass(frozen=True)
class _Flight:
    """A recorded flight as it is given to the core; times on the recording's clock, s."""

    camera: CameraModel  # calibration at the size of the pictures
    vehicle: RecordedVehicle
    expose: Expose  # takes the pictures, filmed or drawn
    start: float  # of the core's run
    end: float
    offset_s: float | None = None  # the video's start minus the telemetry's; None: no video
    offset_correlation: float | None = None  # None: the offset was given
    drawn_pad: Vec3 | None = None  # local NED, m; None: there is a video


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "--telemetry",
        required=True,
        type=file_name,
        metavar="FILE",
        help="ArduPilot log of the flight, .bin or .tlog",
    )
    parser.add_argument(
        "--video",
        type=file_name,
        metavar="FILE",
        help="video, or folder of images with their times; without: pictures of a pad are drawn",
    )
    parser.add_argument(
        "--offset",
        type=_seconds,
        metavar="S",
        help="start of the video minus start of the telemetry; without: found by their motion",
    )
    parser.add_argument(
        "--gimbal",
        type=_numbers(2, most=360.0),
        metavar="YAW,PITCH",
        help="direction of a fixed camera, degrees relative to the airframe (0,-90: down); "
        "without: from the telemetry",
    )
    pad = parser.add_mutually_exclusive_group()
    pad.add_argument(
        "--pad-local",
        type=_numbers(2, 3),
        metavar="N,E[,D]",
        help="where the pad is drawn, m in the autopilot's local frame; without: where the "
        "flight ended",
    )
    pad.add_argument(
        "--pad-at", type=_numbers(2), metavar="LAT,LON", help="where the pad is drawn, degrees"
    )
    parser.add_argument(
        "--fps",
        type=_positive,
        default=10.0,
        metavar="N",
        help="rate of drawn pictures, per second (10)",
    )
    parser.add_argument(
        "--from",
        dest="start",
        type=_seconds,
        default=0.0,
        metavar="S",
        help="begin this long after the telemetry's start (0)",
    )
    parser.add_argument(
        "--to",
        dest="end",
        type=_seconds,
        metavar="S",
        help="end this long after the telemetry's start; without: at its end",
    )
    parser.add_argument(
        "--draw",
        type=file_name,
        metavar="FILE",
        help="write a video with sightings and orders drawn over the pictures: FILE.webm, which "
        "browsers play, or FILE.mp4",
    )
    parser.add_argument(
        "--log", type=file_name, metavar="FILE.mcap", help="write a flight log, for landerd report"
    )
    add_json(parser)
    add_config(parser)


def run(args: argparse.Namespace) -> int:
    """Print what landerd would have ordered, and write the files asked for; return 0.

    Raises:
        InputError: an argument, the configuration or a file cannot be used or written.
    """
    loaded = load_config(args)
    _check_arguments(args)
    with refusing(TelemetryError, VideoError, VideoNotWritten, CalibrationError, PadError):
        telemetry = _telemetry(args.telemetry)
        layout = load_pad(loaded.config.pad.layout)
        flight = _flight(args, loaded, layout, telemetry)
        result, not_written = _fly(args, loaded.config, layout, flight)
    if args.video is not None and not result.frames:
        raise InputError(f"{args.video}: no frame is within the telemetry's time: see --offset")
    report = _report(telemetry, flight, result)
    if args.json:
        print_json(report)
    else:
        print(_in_words(args, report, not_written))
    if not_written:
        raise InputError("\n".join(not_written))
    return 0


def _check_arguments(args: argparse.Namespace) -> None:
    """Raise InputError for arguments of no use, or files that cannot be written."""
    has_video = args.video is not None
    for wrong, line in (
        (args.offset is not None and not has_video, "--offset: only with --video"),
        (args.pad_local is not None and has_video, "--pad-local: not with --video"),
        (args.pad_at is not None and has_video, "--pad-at: not with --video"),
        (args.start < 0.0, f"--from {args.start:g}: expected 0 s or more"),
    ):
        if wrong:
            raise InputError(line)
    if args.draw is not None:
        if args.draw.suffix not in _FILMS:
            raise InputError(f"--draw {args.draw}: expected a {' or '.join(_FILMS)}")
        check_output(args.draw, args.draw.suffix, "--draw")
        check_not_read(args.draw, args.video, "--draw")
    check_output(args.log, ".mcap", "--log")


# ---- the recording -----------------------------------------------------------------------------


def _telemetry(path: Path) -> Telemetry:
    """Return the telemetry in a file.

    Raises:
        InputError: attitude or position were recorded too rarely.
        TelemetryError: the file cannot be used.
    """
    telemetry = read_telemetry(path)
    for track, name in ((telemetry.attitude, "attitude"), (telemetry.position, "position")):
        if not is_fast_enough(track, telemetry.flown):
            raise InputError(
                f"{path}: {name} only {track.rate_hz(telemetry.flown):.1f} times a second while "
                f"{'armed' if telemetry.armed else 'it was recorded'}, expected "
                f"{LEAST_RATE_HZ:g} or more"
            )
    return telemetry


def _flight(
    args: argparse.Namespace, loaded: Loaded, layout: PadLayout, telemetry: Telemetry
) -> _Flight:
    """Return the flight with its video, or with drawn pictures.

    Raises:
        InputError: the arguments do not fit the recording.
        CalibrationError: the calibration cannot be used for these pictures.
        VideoError: there is no video.
    """
    camera = load_camera(loaded.config.camera.calibration)
    start, end = _part(args, telemetry)
    vehicle = recorded_vehicle(
        telemetry, args.gimbal, has_video=args.video is not None, start=start
    )
    if args.video is None:
        pad = _pad(args, telemetry, loaded.config)
        drawn = drawn_pictures(loaded, layout, camera, vehicle, pad, start=start, fps=args.fps)
        return _Flight(camera, vehicle, drawn.expose, start, end, drawn_pad=pad)
    camera = _fitting(camera, args.video, loaded.config)
    offset, correlation = _offset(args, camera, vehicle, telemetry)
    begins = telemetry.start + offset
    filmed = VideoPictures(args.video, begins)
    start = max(start, begins)
    return _Flight(camera, vehicle, filmed.expose, start, end, offset, correlation)


def _part(args: argparse.Namespace, telemetry: Telemetry) -> tuple[float, float]:
    """Return the start and end of the core's run, s on the recording's clock.

    Raises:
        InputError: nothing is between them.
    """
    start = telemetry.start + args.start
    end = telemetry.end if args.end is None else min(telemetry.end, telemetry.start + args.end)
    if start >= end:
        raise InputError(
            f"{args.telemetry}: nothing between --from and --to; it has "
            f"{telemetry.end - telemetry.start:.1f} s"
        )
    return start, end


def _pad(args: argparse.Namespace, telemetry: Telemetry, config: Config) -> Vec3:
    """Return where the pad is drawn, local NED, m: as given, or below the end of the flight.

    Its height is that of the feet at the flight's lowest point, unless it is given.
    """
    flown = _flown(telemetry)
    north, east, *_ = flown[-1]
    down = max(values[2] for values in flown) + config.vehicle.gear_height_m
    if args.pad_at is not None:
        north, east = telemetry.local(*args.pad_at)
    if args.pad_local is not None:
        north, east, *given = args.pad_local
        down = given[0] if given else down
    return (north, east, down)


def _flown(telemetry: Telemetry) -> list[tuple[float, ...]]:
    """Return positions and velocities in flight, local NED; all if it is not known when it flew."""
    track = telemetry.position
    flown = [v for span in telemetry.flown for v in track.values[track.within(span)]]
    return flown or track.values


def _fitting(camera: CameraModel, video: Path, config: Config) -> CameraModel:
    """Return the calibration at the size of a video's frames.

    Raises:
        CalibrationError: it does not fit their size.
        VideoError: the video cannot be read.
    """
    first = next(read_video(video))
    height, width = first.image.shape
    try:
        return camera.scaled(width, height)
    except CalibrationError as e:
        raise CalibrationError(f"{video}: {config.camera.calibration}: {e}") from None


def _offset(
    args: argparse.Namespace, camera: CameraModel, vehicle: RecordedVehicle, telemetry: Telemetry
) -> tuple[float, float | None]:
    """Return the video's start minus the telemetry's, s, and the correlation by which it was found.

    The correlation, of the motion in the pictures with that of the camera, is None if the offset
    was given.

    Raises:
        InputError: the offset cannot be found, or the direction of the camera is unknown.
        VideoError: the video cannot be read.
    """
    if args.gimbal is None and not telemetry.gimbal.times:
        raise InputError(f"{args.telemetry}: no gimbal angles in it: give --gimbal YAW,PITCH")
    if args.offset is not None:
        return args.offset, None
    times, seen = picture_motion(read_video(args.video), camera.fx)
    if len(times) < 40:
        raise InputError(f"{args.video}: too short to be aligned by its motion: give --offset")
    turns = turning_motion(vehicle.look, telemetry.start, telemetry.end)
    offset, correlation = find_offset(times, seen, turns)
    if correlation < SURE:
        raise InputError(
            f"{args.video}: its motion fits the telemetry nowhere (correlation {correlation:.2f}, "
            f"expected {SURE:g} or more): give --offset"
        )
    return offset, correlation


# ---- the run and its results -------------------------------------------------------------------


def _fly(
    args: argparse.Namespace, config: Config, layout: PadLayout, flight: _Flight
) -> tuple[DryRunResult, list[str]]:
    """Run the core on the flight, and write log and video if asked to.

    Returns:
        The result, and a text for each file that could not be written.

    Raises:
        VideoNotWritten: the video of --draw cannot be begun.
        VideoError: the video cannot be read.
    """
    not_written: list[str] = []
    recorder = _recorder(args.log, config, layout, flight.camera)
    video = OrdersVideo(args.draw, flight.camera, layout, _fps(args)) if args.draw else None
    observers: list[Observer] = [each for each in (recorder, video) if each is not None]
    dry = DryRun(config, layout, flight.camera, observers)
    flight.vehicle.ordered = lambda: dry.gimbal
    try:
        dry.run(flight.start, flight.end, flight.vehicle.measure, flight.expose)
    finally:
        if recorder is not None:
            recorder.close()
            not_written += recorder.failures
        if video is not None and not video.close():
            not_written.append(f"{args.draw}: cannot be written, or not completely")
    return dry.result, not_written


def _fps(args: argparse.Namespace) -> float:
    """Return the number of pictures per second."""
    fps: float | None = args.fps if args.video is None else rate_hz(args.video)
    return fps or float(args.fps)


def _recorder(
    path: Path | None, config: Config, layout: PadLayout, camera: CameraModel
) -> Recorder | None:
    """Return a recorder that replaces the flight log at a path; None without a path."""
    if path is None:
        return None
    path.unlink(missing_ok=True)
    head = Head(config, layout, camera, is_dry=True)
    return Recorder(head, config.log, path, background=False)


def _report(telemetry: Telemetry, flight: _Flight, result: DryRunResult) -> dict[str, Any]:
    """Return the object that `--json` prints."""
    zero = telemetry.start
    flown = telemetry.flown
    return {
        "telemetry_s": telemetry.end - zero,
        "armed_s": sum(b - a for a, b in telemetry.armed) if telemetry.says_armed else None,
        "attitude_hz": telemetry.attitude.rate_hz(flown),
        "position_hz": telemetry.position.rate_hz(flown),
        "position_source": telemetry.position_source,
        "remarks": _remarks(telemetry, flight),
        "offset_s": flight.offset_s,
        "offset_correlation": flight.offset_correlation,
        "frames": result.frames,
        "frames_with_pad": result.seen,
        "first_seen_s": None if result.first_seen_t is None else result.first_seen_t - zero,
        "setpoints": result.setpoints,
        "phases": [
            {"t": t - zero, "name": change.phase.value, "reason": change.reason}
            for t, change in phases(result.steps)
        ],
        "not_landing_s": _not_landing_s(result.steps),
        "outcome": result.outcome,
    }


def _not_landing_s(steps: Sequence[tuple[float, list[Command]]]) -> dict[str, float]:
    """Return the times (s) of not landing by reason, the longest first."""
    changes = [(t, c) for t, commands in steps for c in commands if isinstance(c, PhaseChange)]
    ends = [t for t, _ in changes[1:]] + [t for t, _ in steps[-1:]]
    lasted: defaultdict[str, float] = defaultdict(float)
    for (t, change), end in zip(changes, ends, strict=False):
        if change.phase is Phase.NOT_LANDING:
            lasted[change.reason] += end - t
    return dict(sorted(lasted.items(), key=lambda each: -each[1]))


def _remarks(telemetry: Telemetry, flight: _Flight) -> list[str]:
    """Return remarks that are needed to judge the result, a line each."""
    lines = list(telemetry.remarks)
    flown = _flown(telemetry)
    if not telemetry.says_armed:
        lines.append("it does not tell when the vehicle was armed: all of it counts as the flight")
    elif not telemetry.armed:
        lines.append("the vehicle was never armed in it")
    length = sum(b - a for a, b in telemetry.flown)
    for track, name in ((telemetry.attitude, "attitude"), (telemetry.position, "position")):
        missing = length - track.covered_s(telemetry.flown)
        if missing > MAX_GAP_S:
            lines.append(f"{name} is missing for {missing:.1f} s of the {length:.1f} s flown")
    if flight.vehicle.is_pretended:
        lines.append("no gimbal angles in it: a gimbal that follows landerd's orders is simulated")
    fastest = max(math.hypot(*values[3:]) for values in flown)
    if fastest > BELIEVED_MPS:
        lines.append(f"its position is implausible: by it the vehicle flew up to {fastest:.0f} m/s")
    if flight.drawn_pad is not None:
        lines += _drawn(flight.drawn_pad, flown)
    return lines


def _drawn(pad: Vec3, flown: Sequence[tuple[float, ...]]) -> list[str]:
    """Return remarks on pictures of a pad that was not there."""
    north, east, down = pad
    lines = [
        f"no video: pictures are drawn, of a pad {_side(north, 'north', 'south')}, "
        f"{_side(east, 'east', 'west')} and {_side(down, 'below', 'above')} local zero"
    ]
    nearest = min(math.dist(place[:3], pad) for place in flown)
    above = down - flown[-1][2]
    if nearest > SEEN_FROM_M:
        lines.append(f"the vehicle never came nearer to that pad than {nearest:.0f} m")
    if above > IN_THE_AIR_M:
        lines.append(f"the recording ends {above:.0f} m above that pad: it may lie elsewhere")
    return lines


def _side(value: float, positive: str, negative: str) -> str:
    """Return a distance in words, as "2.0 m north".

    Args:
        value: distance, m.
        positive: name of its direction if it is not negative.
        negative: name of its direction otherwise.
    """
    return f"{abs(value):.1f} m {positive if value >= 0.0 else negative}"


def _in_words(args: argparse.Namespace, result: dict[str, Any], not_written: Sequence[str]) -> str:
    armed = "" if result["armed_s"] is None else f", armed for {result['armed_s']:.1f} s"
    lines = [
        f"{args.telemetry}: {result['telemetry_s']:.1f} s of attitude and position{armed}",
        f"  attitude {result['attitude_hz']:.0f} and position {result['position_hz']:.0f} times a "
        f"second ({result['position_source']})",
        *(f"  {remark}" for remark in result["remarks"]),
    ]
    if min(result["attitude_hz"], result["position_hz"]) < GOOD_RATE_HZ:
        lines.append(
            "  slow: values between are interpolated; in flight landerd asks for 50 a second"
        )
    if result["offset_s"] is not None:
        found = result["offset_correlation"]
        how = "" if found is None else f" (found by motion, correlation {found:.2f})"
        lines.append(f"  the video begins {result['offset_s']:.2f} s after it{how}")
    first = result["first_seen_s"]
    lines.append(
        f"  pad seen in {result['frames_with_pad']} of {result['frames']} pictures"
        + ("" if first is None else f", first at {first:.1f} s")
    )
    lines.append(
        f"  armed, in GUIDED and with the switch high, landerd would have sent "
        f"{result['setpoints']} set-points:"
    )
    for change in result["phases"]:
        lines.append(f"    {change['t']:7.2f} s  {change['name']:14}  {change['reason']}")
    if not result["phases"]:
        lines.append("    none: it would have stayed silent")
        lines += [f"      for {s:.1f} s: {why}" for why, s in result["not_landing_s"].items()]
    lines.append(f"  outcome: {outcome_in_words(result['outcome'])}")
    lines.append("  (the vehicle moves as it was recorded; nothing was sent)")
    for name in ("draw", "log"):
        path = getattr(args, name)
        if path is not None and not any(str(path) in line for line in not_written):
            lines.append(f"  {'video' if name == 'draw' else 'flight log'}: {path}")
    return "\n".join(lines)


def outcome_in_words(outcome: str | None) -> str:
    """Return the outcome in words; outcome: None: the landing did not end."""
    return _OUTCOMES.get(outcome, str(outcome).replace("_", " "))


def _numbers(*lengths: int, most: float = math.inf) -> Callable[[str], tuple[float, ...]]:
    """Return the `type` of an argument of numbers between commas.

    Args:
        lengths: how many are allowed.
        most: largest magnitude that is allowed.
    """

    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        are_good = all(math.isfinite(value) and abs(value) <= most for value in values)
        if len(values) not in lengths or not are_good:
            counts = " or ".join(map(str, lengths))
            within = "" if math.isinf(most) else f" from {-most:g} to {most:g}"
            raise argparse.ArgumentTypeError(f"found {text!r}, expected {counts} numbers{within}")
        return values

    return parse


def _seconds(text: str) -> float:
    """Return a time in s; the type of an argument."""
    value = number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected seconds")
    return value


def _positive(text: str) -> float:
    """Return a rate of pictures per second; the type of --fps."""
    value = number(text)
    if not 0.0 < value <= 60.0:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected a rate up to 60")
    return value
