"""`landerd calibrate gimbal`: how a gimbal is built in, from views of a pad before it."""

import argparse
import asyncio
import json
import math
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hw.gimbals.fixed import FixedOptions
from hw.gimbals.mounting import MountOptions
from hw.gimbals.servo import ServoAxisOptions, ServoOptions
from landerd import devices as registry
from landerd.calibration.gimbal import AxisResult, GimbalCalibration, calibrate
from landerd.calibration.gimbal_motion import AxisName, GimbalMotion, Refused
from landerd.camera_model import CalibrationError
from landerd.commands.run import SetUpError, fitting_camera, make_devices
from landerd.config.files import Loaded
from landerd.config.yaml_tree import put
from landerd.geometry import clamp
from landerd.pad import PadError, load_pad
from landerd.ports import DeviceLost, Feedback, GimbalOptions
from landerd.runtime.daemon import Devices
from landerd.vision import Vision

_FIRST = (
    "Stand the vehicle level and unpowered by its motors, on a table, say. Lay the pad flat on the "
    "floor, 1 to 3 m ahead and lower than the camera by a third of that, its middle straight ahead "
    "of the nose. Nothing may move from now on but the gimbal."
)
_NEXT = "Lay the pad nearer or farther, flat and straight ahead again."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments, all but those of the configuration."""
    parser.add_argument(
        "--places",
        type=int,
        choices=range(1, 10),
        default=1,
        metavar="N",
        help="lay the pad in so many places, so that a servo's table becomes longer (1)",
    )
    parser.add_argument(
        "--yes", action="store_true", help="ask nothing: the pad lies there, in one place"
    )
    parser.add_argument(
        "--without-autopilot",
        action="store_true",
        help="on a bench: nobody is asked whether the vehicle is disarmed, and it stands level",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.yaml", help="the keys to set")
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")


def run(args: argparse.Namespace, loaded: Loaded, overlay: Path) -> int:
    """Calibrate; return 0, 1 if nothing to be trusted came of it, 2 if the input is wrong."""
    driver = loaded.config.gimbal.driver
    try:
        if args.yes and args.places > 1:
            raise ValueError("--places needs somebody to move the pad: not with --yes")
        if args.output is not None and not args.output.absolute().parent.is_dir():
            raise ValueError(f"-o {args.output}: its folder does not exist")
        if args.without_autopilot and registry.over("gimbal", driver) == "autopilot":
            raise ValueError(f"--without-autopilot: {driver} speaks through the autopilot")
        if not load_pad(loaded.config.pad.layout).has_heading:
            raise ValueError(f"{loaded.config.pad.layout}: a pad with a tag or WhyCode is needed")
        fitting_camera(loaded)
        devices = make_devices(loaded, overlay)
    except (CalibrationError, PadError, SetUpError, ValueError) as e:
        print(e, file=sys.stderr)
        return 2
    try:
        report = asyncio.run(
            calibrate_gimbal(
                loaded,
                devices,
                places=args.places,
                with_autopilot=not args.without_autopilot,
                ask=_ask if not args.yes else None,
                say=(lambda _: None) if args.json else print,
            )
        )
    except KeyboardInterrupt:
        return 1
    if args.json:
        print(json.dumps(report, allow_nan=False))
    else:
        print("\n".join(_in_words(report)))
    if not report["good"]:
        return 1
    text = yaml.safe_dump(_tree(report["keys"]), sort_keys=False, default_flow_style=None)
    if args.output is not None:
        args.output.write_text(text, encoding="utf-8")
    elif not args.json:
        print("set in the configuration:", text, sep="\n", end="")
    return 0


async def calibrate_gimbal(
    loaded: Loaded,
    devices: Devices,
    *,
    places: int = 1,
    with_autopilot: bool = True,
    ask: Callable[[str], Awaitable[None]] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Return the object that `--json` prints; the devices are opened and closed.

    Args:
        loaded: the configuration.
        devices: closed.
        places: how many the pad is laid in.
        with_autopilot: whether it has to be heard, disarmed.
        ask: shows a question and waits for the answer; None: nobody is asked.
        say: tells a line.
    """
    config = loaded.config
    camera, layout = fitting_camera(loaded), load_pad(config.pad.layout)
    search = Vision(layout, camera, config.vision).process
    options = loaded.options[f"gimbal.{config.gimbal.driver}"]
    assert isinstance(options, GimbalOptions)
    reach: dict[AxisName, tuple[float, float]] = {
        "yaw": options.traits.yaw_limits,
        "pitch": options.traits.pitch_limits,
    }
    motion = GimbalMotion(
        devices,
        camera,
        reach,
        search,
        say,
        is_measured=options.traits.feedback is Feedback.MEASURED,
        with_autopilot=with_autopilot,
    )

    async def lay(place: int) -> None:
        if ask is not None:
            await ask(_NEXT if place else _FIRST)

    result: GimbalCalibration | None = None
    reasons: list[str] = []
    try:
        measured = await motion.run(places, lay)
        result, reasons = calibrate(
            measured,
            tables=isinstance(options, ServoOptions),
            turns=not (isinstance(options, ServoOptions) and options.yaw is None),
            aside_m=-config.vehicle.camera_offset_m[1],
        )
    except (DeviceLost, Refused) as e:
        reasons = [str(e)]
    report: dict[str, Any] = {
        "good": result is not None and not reasons,
        "reasons": reasons,
        "views": len(motion.measured.views),
    }
    if result is not None:
        report |= {
            "yaw": _axis_report(result.yaw),
            "pitch": _axis_report(result.pitch),
            "camera_rotation_deg": [_deg(angle) for angle in result.camera_rotation],
            "error_deg": _deg(result.error, 3),
            "keys": keys(loaded, result),
        }
    return report


async def _ask(question: str) -> None:
    print(question)
    await asyncio.get_running_loop().run_in_executor(None, input, "Press Enter when it is so. ")


# ---- what came of it ---------------------------------------------------------------------------


def keys(loaded: Loaded, found: GimbalCalibration) -> dict[str, Any]:
    """Return the keys of the configuration that follow, dotted, with their values."""
    driver = loaded.config.gimbal.driver
    options = loaded.options[f"gimbal.{driver}"]
    values: dict[str, Any] = {}
    axes = [("pitch", found.pitch)] + ([("yaw", found.yaw)] if found.yaw is not None else [])
    delays = [axis.delays for _, axis in axes if axis.delays is not None]
    late = sum(d.report for d in delays) / len(delays) if delays else 0.0
    for name, axis in axes:
        if isinstance(options, FixedOptions) and axis.zero is not None:
            old = getattr(options, f"{name}_deg")
            values[f"gimbal.fixed.{name}_deg"] = _wrapped_deg(old + math.degrees(axis.zero))
        elif isinstance(options, MountOptions) and axis.zero is not None:
            sign, zero = getattr(options, f"{name}_sign"), getattr(options, f"{name}_zero_deg")
            zero = axis.sign * zero + math.degrees(axis.zero)
            values[f"gimbal.{driver}.{name}_sign"] = axis.sign * sign
            values[f"gimbal.{driver}.{name}_zero_deg"] = _wrapped_deg(zero)
        elif isinstance(options, ServoOptions) and axis.table is not None:
            servo = getattr(options, name)
            values[f"gimbal.{driver}.{name}.channel"] = servo.channel
            values[f"gimbal.{driver}.{name}.table"] = _servo_table(servo, axis.table)
    if isinstance(options, MountOptions) and delays:
        if options.traits.feedback is Feedback.MEASURED:
            values[f"gimbal.{driver}.latency_s"] = _within(options.latency_s - late, 0.2)
        else:
            values["gimbal.lag_s"] = max(0.001, _within(delays[0].order, 0.5))
    elif isinstance(options, ServoOptions) and delays:
        values[f"gimbal.{driver}.lag_s"] = _within(options.lag_s + late, 0.5)
    values["gimbal.camera_rotation_deg"] = [_deg(angle) for angle in found.camera_rotation]
    if delays:
        values["aim.lead_s"] = _within(max(d.order for d in delays), 0.5)
    return values


def _servo_table(
    servo: ServoAxisOptions, found: tuple[tuple[float, float], ...]
) -> list[list[float]]:
    """Return the table of a servo: what was found, and on to its ends in a straight line."""
    old_deg, old_us = (np.array(column) for column in zip(*servo.table, strict=True))
    at_deg, true_deg = (np.degrees(column) for column in zip(*found, strict=True))
    slope, zero = np.polyfit(at_deg, true_deg, 1)
    ends = [a for a in (old_deg[0], old_deg[-1]) if not at_deg[0] - 1.0 < a < at_deg[-1] + 1.0]
    rows = [
        (float(np.interp(a, old_deg, old_us)), t) for a, t in zip(at_deg, true_deg, strict=True)
    ]
    for end in ends:
        edge = 0 if end < at_deg[0] else -1
        away = slope * end + zero + true_deg[edge] - (slope * at_deg[edge] + zero)
        rows.append((np.interp(end, old_deg, old_us), away))
    rows.sort(key=lambda row: row[1])
    return [[round(float(angle), 2), round(float(pulse), 1)] for pulse, angle in rows]


def _axis_report(axis: AxisResult | None) -> dict[str, Any] | None:
    if axis is None:
        return None
    report: dict[str, Any] = {"sign": axis.sign, "sigma_deg": _deg(axis.sigma)}
    if axis.zero is not None:
        report["zero_deg"] = _wrapped_deg(math.degrees(axis.zero))
    if axis.table is not None:
        report["table_deg"] = [[_deg(at), _deg(true)] for at, true in axis.table]
    if axis.delays is not None:
        report["latency_s"] = round(axis.delays.order, 3)
        report["report_late_s"] = round(axis.delays.report, 3)
    return report


def _in_words(report: dict[str, Any]) -> list[str]:
    lines = []
    for name in ("yaw", "pitch"):
        axis = report.get(name)
        if axis is None:
            continue
        if axis["sign"] < 0:
            lines.append(f"{name} turns the other way than it is told")
        if "zero_deg" in axis:
            zero, sigma = axis["zero_deg"], axis["sigma_deg"]
            lines.append(
                f"{name}: the camera looks to {zero:.2f} degrees (1 sigma {sigma:.2f}) at 0"
            )
        for at, true in axis.get("table_deg", ()):
            lines.append(
                f"{name}: at {at:.1f} degrees by the old table the camera is at {true:.2f}"
            )
        if "latency_s" in axis:
            order, report_ms = (1e3 * axis[key] for key in ("latency_s", "report_late_s"))
            lines.append(
                f"{name}: pictures show an order {order:.0f} ms later, a report {report_ms:.0f} ms"
            )
    if "camera_rotation_deg" in report:
        roll, _, yaw = report["camera_rotation_deg"]
        lines.append(f"the camera sits rolled by {roll:.2f} and turned by {yaw:.2f} degrees")
        lines.append(f"{report['views']} pictures agree within {report['error_deg']:.2f} degrees")
    return lines + [f"refused: {reason}" for reason in report["reasons"]]


def _tree(values: dict[str, Any]) -> dict[str, Any]:
    """Return dotted keys as nested mappings."""
    tree: dict[str, Any] = {}
    for key, value in values.items():
        put(tree, key.split("."), value)
    return tree


def _deg(angle: float, places: int = 2) -> float:
    return round(math.degrees(angle), places) + 0.0  # no -0.0


def _wrapped_deg(angle_deg: float) -> float:
    return round(math.remainder(angle_deg, 360.0), 2) + 0.0


def _within(seconds: float, most: float) -> float:
    return round(clamp(seconds, 0.0, most), 3)
