"""`landerd dry-run`: what landerd would have ordered on somebody's own flight. Nothing is sent."""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.replay.align import SURE, find_offset, picture_motion, turning_motion
from hw.replay.pictures import DrawnPictures, VideoPictures
from hw.replay.telemetry import Telemetry, TelemetryError, read_telemetry
from hw.replay.vehicle import RecordedVehicle
from hw.replay.video import VideoError, read_video
from hw.sim.options import SimOptions
from landerd.camera_model import CalibrationError, CameraModel, load_camera
from landerd.config.files import Loaded
from landerd.config.models import Config
from landerd.flightlog.contents import Head
from landerd.flightlog.recorder import Recorder
from landerd.flightlog.replay import phases
from landerd.geometry import (
    Vec3,
)
from landerd.lander import Lander
from landerd.messages import (
    Command,
    Frame,
    Input,
    Prior,
    Sightings,
)
from landerd.pad import PadError, PadLayout, load_pad
from landerd.runtime.daemon import Observer
from landerd.runtime.dry_run import DryRun
from landerd.vision.draw import draw

GOOD_RATE_HZ = 20.0
LEAST_RATE_HZ = 2.0  # slower telemetry says too little between its measurements


class Unusable(Exception):
    """The recording cannot be used so; the text says why and what helps."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments, beside those that choose the configuration."""
    parser.add_argument(
        "--telemetry", required=True, type=Path, metavar="FILE", help="ArduPilot .bin or .tlog"
    )
    parser.add_argument(
        "--video",
        type=Path,
        metavar="FILE",
        help="video, or folder of images with their times; without one: drawn pictures of a pad",
    )
    parser.add_argument(
        "--offset",
        type=float,
        metavar="S",
        help="the video begins so long after the telemetry; without: found by their motion",
    )
    parser.add_argument(
        "--gimbal",
        type=_numbers(2),
        metavar="YAW,PITCH",
        help="fixed camera, degrees to the airframe (0,-90: down); without: from the telemetry",
    )
    parser.add_argument(
        "--pad-local",
        type=_numbers(2, 3),
        metavar="N,E[,D]",
        help="where the pad is drawn, m in the autopilot's local frame; without: where it ended",
    )
    parser.add_argument("--pad-at", type=_numbers(2), metavar="LAT,LON", help="the same in degrees")
    parser.add_argument("--fps", type=_positive, default=10.0, help="of drawn pictures (10)")
    parser.add_argument("--from", dest="start", type=float, default=0.0, metavar="S")
    parser.add_argument(
        "--to", dest="end", type=float, metavar="S", help="part of the telemetry, s from its start"
    )
    parser.add_argument("--draw", type=Path, metavar="FILE.mp4", help="draw it over the pictures")
    parser.add_argument(
        "--log", type=Path, metavar="FILE.mcap", help="write a flight log, for landerd report"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")


def run(args: argparse.Namespace, loaded: Loaded) -> int:
    """Print what would have been ordered; return 0, or 2 if the recording cannot be used."""
    try:
        result = _dry_run(args, loaded)
    except (TelemetryError, VideoError, Unusable, CalibrationError, PadError) as e:
        print(e, file=sys.stderr)
        return 2
    print(json.dumps(result, allow_nan=False) if args.json else _in_words(args, result))
    return 0


def _dry_run(args: argparse.Namespace, loaded: Loaded) -> dict[str, Any]:
    config = loaded.config
    for path, suffix in ((args.draw, ".mp4"), (args.log, ".mcap")):
        if path is not None and (path.suffix != suffix or not path.absolute().parent.is_dir()):
            raise Unusable(f"{path}: expected a {suffix} in a folder that exists")
    telemetry = read_telemetry(args.telemetry)
    for track, name in ((telemetry.attitude, "attitude"), (telemetry.position, "position")):
        if track.rate_hz < LEAST_RATE_HZ:
            raise Unusable(
                f"{args.telemetry}: {name} only {track.rate_hz:.1f} times a second, expected "
                f"{LEAST_RATE_HZ:g} or more"
            )
    layout = load_pad(config.pad.layout)
    camera = load_camera(config.camera.calibration)
    start = telemetry.start + max(0.0, args.start)
    end = telemetry.end if args.end is None else min(telemetry.end, telemetry.start + args.end)
    if start >= end:
        raise Unusable(
            f"{args.telemetry}: nothing between --from and --to; it has "
            f"{telemetry.end - telemetry.start:.1f} s"
        )
    offset = None
    pretended = args.video is None and args.gimbal is None and not telemetry.gimbal.times
    vehicle = RecordedVehicle(telemetry, args.gimbal, pretended=pretended, start=start)
    if args.video is not None:
        camera = _fitting(camera, args.video, config)
        offset, sure = _offset(args, camera, vehicle, telemetry)
        start = max(start, telemetry.start + offset)
        expose = VideoPictures(args.video, telemetry.start + offset).expose
    else:
        sure = None
        options = loaded.options["sim"]
        assert isinstance(options, SimOptions)
        expose = DrawnPictures(
            layout,
            camera,
            options.render,
            vehicle,
            config.vehicle,
            _pad(args, telemetry, config),
            start=start,
            fps=args.fps,
        ).expose
    observers: list[Observer] = []
    recorder = _recorder(args.log, config, layout, camera)
    if recorder is not None:
        observers.append(recorder)
    drawing = _Drawing(args.draw, camera, layout, args.fps) if args.draw else None
    if drawing is not None:
        observers.append(drawing)
    dry = DryRun(config, layout, camera, observers)
    vehicle.ordered = lambda: dry.gimbal
    if drawing is not None:
        drawing.dry = dry
    try:
        dry.run(start, end, vehicle.measure, expose)
    finally:
        if recorder is not None:
            recorder.close()
        if drawing is not None:
            drawing.close()
    result = dry.result
    if args.video is not None and not result.frames:
        raise Unusable(f"{args.video}: no frame of it falls into the telemetry: see --offset")
    changes = phases(result.steps)
    zero = telemetry.start
    return {
        "telemetry_s": telemetry.end - telemetry.start,
        "attitude_hz": telemetry.attitude.rate_hz,
        "position_hz": telemetry.position.rate_hz,
        "offset_s": offset,
        "offset_correlation": sure,
        "frames": result.frames,
        "frames_with_pad": result.seen,
        "first_seen_s": None if result.first_seen_t is None else result.first_seen_t - zero,
        "setpoints": result.setpoints,
        "phases": [{"t": t - zero, "name": c.phase.value, "reason": c.reason} for t, c in changes],
        "outcome": result.outcome,
    }


def _pad(args: argparse.Namespace, telemetry: Telemetry, config: Config) -> Vec3:
    """Return where the pad is drawn: as asked, or under the recording's last position."""
    north, east, _, *_ = telemetry.position.values[-1]
    down = max(values[2] for values in telemetry.position.values) + config.vehicle.gear_height_m
    if args.pad_at is not None:
        north, east = telemetry.local(*args.pad_at)
    if args.pad_local is not None:
        north, east, *given = args.pad_local
        down = given[0] if given else down
    return (north, east, down)


def _fitting(camera: CameraModel, video: Path, config: Config) -> CameraModel:
    first = next(read_video(video))
    height, width = first.image.shape
    try:
        return camera.scaled(width, height)
    except CalibrationError as e:
        raise CalibrationError(f"{video}: {config.camera.calibration}: {e}") from None


def _offset(
    args: argparse.Namespace, camera: CameraModel, vehicle: RecordedVehicle, telemetry: Telemetry
) -> tuple[float, float | None]:
    """Return when the video begins, s after the telemetry, and how sure that is."""
    if args.gimbal is None and not telemetry.gimbal.times:
        raise Unusable(f"{args.telemetry}: no gimbal angles in it: give --gimbal YAW,PITCH")
    if args.offset is not None:
        return args.offset, None
    times, seen = picture_motion(read_video(args.video), camera.fx)
    if len(times) < 40:
        raise Unusable(f"{args.video}: too short to be aligned by its motion: give --offset")
    turned = turning_motion(vehicle.look, telemetry.start, telemetry.end)
    offset, sure = find_offset(times, seen, turned)
    if sure < SURE:
        raise Unusable(
            f"{args.video}: its motion fits the telemetry nowhere (correlation {sure:.2f}, "
            f"expected {SURE:g} or more): give --offset"
        )
    return offset, sure


# ---- what comes out ----------------------------------------------------------------------------


class _Drawing:
    """An observer that writes a video: what was seen, and what would have been ordered."""

    def __init__(self, path: Path, camera: CameraModel, layout: PadLayout, fps: float) -> None:
        self._camera, self._layout = camera, layout
        size = (camera.width, camera.height)
        code = cv2.VideoWriter.fourcc(*"mp4v")
        self._writer = cv2.VideoWriter(str(path), code, fps, size)
        if not self._writer.isOpened():
            raise Unusable(f"{path}: this video cannot be written")
        self.dry: DryRun | None = None

    def on_flight(self, lander: Lander) -> None:
        """One flight is all there is."""

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Draw one picture."""
        picture = draw(frame.image, sightings, self._camera, self._layout)
        assert self.dry is not None
        lander, order = self.dry.lander, self.dry.setpoint
        lines = [f"{lander.phase.value}: {lander.reason}"]
        if order is not None:
            north, east, down = order.velocity
            turn = math.degrees(order.yaw_rate)
            lines.append(
                f"would send north {north:+.2f} east {east:+.2f} down {down:+.2f} m/s, "
                f"turn {turn:+.1f} deg/s"
            )
        for i, line in enumerate(lines):
            _write(picture, line, picture.shape[0] - 12 - 20 * (len(lines) - 1 - i))
        self._writer.write(picture)

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Steps show in the next picture."""

    def close(self) -> None:
        """Finish the file."""
        self._writer.release()


def _write(picture: NDArray[np.uint8], line: str, y: int) -> None:
    for colour, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.putText(
            picture, line, (8, y), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, thickness, cv2.LINE_AA
        )


def _recorder(
    path: Path | None, config: Config, layout: PadLayout, camera: CameraModel
) -> Recorder | None:
    if path is None:
        return None
    path.unlink(missing_ok=True)
    return Recorder(Head(config, layout, camera), config.log, path, background=False)


def _in_words(args: argparse.Namespace, result: dict[str, Any]) -> str:
    lines = [
        f"{args.telemetry}: {result['telemetry_s']:.1f} s, attitude {result['attitude_hz']:.0f} "
        f"and position {result['position_hz']:.0f} times a second",
    ]
    if min(result["attitude_hz"], result["position_hz"]) < GOOD_RATE_HZ:
        lines.append(
            "  slow: what lies between was interpolated; landerd in flight asks for 50 a second"
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
    lines.append(f"  outcome: {result['outcome'] or 'the recording ends before the landing does'}")
    lines.append("  (the vehicle moves as it was recorded; nothing was sent)")
    for name in ("draw", "log"):
        if getattr(args, name) is not None:
            lines.append(f"  {'video' if name == 'draw' else 'flight log'}: {getattr(args, name)}")
    return "\n".join(lines)


def _numbers(*lengths: int) -> Any:
    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) not in lengths or not all(map(math.isfinite, values)):
            counts = " or ".join(map(str, lengths))
            raise argparse.ArgumentTypeError(f"found {text!r}, expected {counts} numbers")
        return values

    return parse


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= 60.0:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected a rate up to 60")
    return value
