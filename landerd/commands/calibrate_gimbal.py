"""`landerd calibrate gimbal`: finds mounting and delay of a gimbal, from pictures of a pad."""

import argparse
import asyncio
import math
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from hw.gimbals.fixed import FixedOptions
from hw.gimbals.mounting import MountOptions
from hw.gimbals.servo import ServoAxisOptions, ServoOptions
from landerd.calibration.bench import Refused
from landerd.calibration.gimbal import AxisResult, GimbalCalibration, calibrate
from landerd.calibration.gimbal_motion import Delays, GimbalMotion
from landerd.camera_model import CalibrationError
from landerd.commands.shared import (
    InputError,
    add_bench,
    ask,
    check_bench,
    load_with_saved,
    print_json,
    refusing,
    write_text,
)
from landerd.config.files import Loaded
from landerd.config.yaml_tree import put
from landerd.devices import SetUpError, fitting_camera, make_devices
from landerd.geometry import clamp
from landerd.pad import PadError, load_pad
from landerd.ports import DeviceLost, Feedback, GimbalOptions
from landerd.runtime.daemon import Devices
from landerd.section import Section
from landerd.vision import Vision

Axes = Mapping[str, AxisResult]  # results by name: "pitch", and "yaw" if the gimbal turns there

_FIRST = (
    "Stand the vehicle level with its motors off, for example on a table. Lay the pad flat on the "
    "floor, 1 to 3 m ahead and lower than the camera by a third of that, its middle straight ahead "
    "of the nose. From now on nothing but the gimbal may move."
)
_NEXT = "Lay the pad nearer or farther, flat and straight ahead again."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "--places",
        type=int,
        choices=range(1, 10),
        default=1,
        metavar="N",
        help="number of places in which the pad is laid; more make a servo's table longer (1)",
    )
    parser.add_argument(
        "--yes", action="store_true", help="ask nothing: the pad is laid already, in one place"
    )
    add_bench(parser, "FILE.yaml", "write the keys of the configuration to set")


def run(args: argparse.Namespace) -> int:
    """Calibrate and write the keys; return 0, or 1 if the result cannot be trusted.

    Raises:
        InputError: an argument, the configuration or a file cannot be used.
    """
    loaded, overlay = load_with_saved(args)
    _check(args, loaded)
    with refusing(CalibrationError, SetUpError):
        fitting_camera(loaded)
        devices = make_devices(loaded, overlay)
    report = asyncio.run(
        calibrate_gimbal(
            loaded,
            devices,
            places=args.places,
            with_autopilot=not args.without_autopilot,
            ask=ask if not args.yes else None,
            say=(lambda _: None) if args.json else print,
        )
    )
    if args.json:
        print_json(report)
    else:
        print("\n".join(_in_words(report)))
    if not report["good"]:
        return 1
    text = yaml.safe_dump(_tree(report["keys"]), sort_keys=False, default_flow_style=None)
    if args.output is not None:
        write_text(args.output, text)
        if not args.json:
            print(f"written: {args.output}")
    elif not args.json:
        print("set in the configuration:", text, sep="\n", end="")
    return 0


def _check(args: argparse.Namespace, loaded: Loaded) -> None:
    """Raise InputError if the gimbal cannot be calibrated with these arguments."""
    if args.yes and args.places > 1:
        raise InputError("--places needs somebody to move the pad: not with --yes")
    check_bench(args, loaded)
    with refusing(PadError):
        layout = load_pad(loaded.config.pad.layout)
    if not layout.has_heading:
        raise InputError(f"{loaded.config.pad.layout}: a pad with a tag or WhyCode is needed")


async def calibrate_gimbal(
    loaded: Loaded,
    devices: Devices,
    *,
    places: int = 1,
    with_autopilot: bool = True,
    ask: Callable[[str], Awaitable[None]] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Calibrate the gimbal and return the object that `--json` prints.

    Args:
        loaded: the configuration.
        devices: not open; they are opened and closed.
        places: number of places in which the pad is laid.
        with_autopilot: whether an autopilot must report that the vehicle is disarmed.
        ask: shows an instruction and waits until it is done; None: nobody is asked.
        say: prints a line on the progress.
    """
    options = _options(loaded)
    motion = _motion(loaded, devices, say, with_autopilot=with_autopilot)

    async def lay(place: int) -> None:
        if ask is not None:
            await ask(_NEXT if place else _FIRST)

    result: GimbalCalibration | None = None
    try:
        measured = await motion.run(places, lay)
        result, reasons = calibrate(
            measured,
            tables=isinstance(options, ServoOptions),
            turns=not (isinstance(options, ServoOptions) and options.yaw is None),
            aside_m=-loaded.config.vehicle.camera_offset_m[1],
        )
    except (DeviceLost, Refused) as e:
        reasons = [str(e)]
    return _report(loaded, result, reasons, len(motion.measured.views))


def _options(loaded: Loaded) -> Section:
    """Return the block of keys of the gimbal's driver."""
    return loaded.options[f"gimbal.{loaded.config.gimbal.driver}"]


def _motion(
    loaded: Loaded, devices: Devices, say: Callable[[str], None], *, with_autopilot: bool
) -> GimbalMotion:
    """Return the object that moves the gimbal within its reach and searches for the pad."""
    camera, layout = fitting_camera(loaded), load_pad(loaded.config.pad.layout)
    options = _options(loaded)
    assert isinstance(options, GimbalOptions)
    traits = options.traits
    return GimbalMotion(
        devices,
        camera,
        {"yaw": traits.yaw_limits, "pitch": traits.pitch_limits},
        Vision(layout, camera, loaded.config.vision).process,
        say,
        is_measured=traits.feedback is Feedback.MEASURED,
        with_autopilot=with_autopilot,
    )


# ---- results -----------------------------------------------------------------------------------


def _report(
    loaded: Loaded, result: GimbalCalibration | None, reasons: list[str], views: int
) -> dict[str, Any]:
    report: dict[str, Any] = {
        "good": result is not None and not reasons,
        "reasons": reasons,
        "views": views,
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


def keys(loaded: Loaded, found: GimbalCalibration) -> dict[str, Any]:
    """Return the resulting keys of the configuration, dotted, with their values."""
    block, options = f"gimbal.{loaded.config.gimbal.driver}", _options(loaded)
    axes = {"pitch": found.pitch} | ({"yaw": found.yaw} if found.yaw is not None else {})
    delays = [axis.delays for axis in axes.values() if axis.delays is not None]
    values: dict[str, Any] = {}
    match options:
        case FixedOptions():
            values = _fixed_keys(block, options, axes)
        case MountOptions():
            values = _mount_keys(block, options, axes, delays)
        case ServoOptions():
            values = _servo_keys(block, options, axes, delays)
    values["gimbal.camera_rotation_deg"] = [_deg(angle) for angle in found.camera_rotation]
    if delays:
        values["aim.lead_s"] = _within(max(d.order for d in delays), 0.5)
    return values


def _fixed_keys(block: str, options: FixedOptions, axes: Axes) -> dict[str, Any]:
    """Return the keys of a bolted camera's direction."""
    old_deg = {"yaw": options.yaw_deg, "pitch": options.pitch_deg}
    return {
        f"{block}.{name}_deg": _wrapped_deg(old_deg[name] + math.degrees(axis.zero))
        for name, axis in axes.items()
        if axis.zero is not None
    }


def _mount_keys(
    block: str, options: MountOptions, axes: Axes, delays: Sequence[Delays]
) -> dict[str, Any]:
    """Return the keys of signs, zeros, and the delay of the reports or of the gimbal."""
    old = {
        "yaw": (options.yaw_sign, options.yaw_zero_deg),
        "pitch": (options.pitch_sign, options.pitch_zero_deg),
    }
    values: dict[str, Any] = {}
    for name, axis in axes.items():
        if axis.zero is not None:
            sign, zero_deg = old[name]
            zero_deg = axis.sign * zero_deg + math.degrees(axis.zero)
            values[f"{block}.{name}_sign"] = axis.sign * sign
            values[f"{block}.{name}_zero_deg"] = _wrapped_deg(zero_deg)
    if delays and options.traits.feedback is Feedback.MEASURED:
        values[f"{block}.latency_s"] = _within(options.latency_s - _report_late_s(delays), 0.2)
    elif delays:
        values["gimbal.lag_s"] = max(0.001, _within(delays[0].order, 0.5))
    return values


def _servo_keys(
    block: str, options: ServoOptions, axes: Axes, delays: Sequence[Delays]
) -> dict[str, Any]:
    """Return the keys of servos' tables, and of their lag."""
    servos = {"yaw": options.yaw, "pitch": options.pitch}
    values: dict[str, Any] = {}
    for name, axis in axes.items():
        servo = servos[name]
        if axis.table is not None and servo is not None:
            values[f"{block}.{name}.channel"] = servo.channel
            values[f"{block}.{name}.table"] = _servo_table(servo, axis.table)
    if delays:
        values[f"{block}.lag_s"] = _within(options.lag_s + _report_late_s(delays), 0.5)
    return values


def _report_late_s(delays: Sequence[Delays]) -> float:
    """Return the delay of pictures behind the gimbal's reports, mean of the axes, s."""
    return sum(d.report for d in delays) / len(delays)


def _servo_table(
    servo: ServoAxisOptions, found: tuple[tuple[float, float], ...]
) -> list[list[float]]:
    """Return a servo's new table: rows of angle (degrees) and pulse width (us).

    The points found are extrapolated linearly to the ends of the old table.

    Args:
        servo: options with the old table.
        found: angles by the old table and measured angles, rad.
    """
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
            lines.append(f"{name} turns opposite to its orders")
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
                f"{name}: pictures are {order:.0f} ms behind the orders, and {report_ms:.0f} ms "
                "behind the gimbal's reports"
            )
    if "camera_rotation_deg" in report:
        roll, _, yaw = report["camera_rotation_deg"]
        lines.append(f"the camera is mounted rolled by {roll:.2f} and turned by {yaw:.2f} degrees")
        lines.append(f"{report['views']} pictures agree within {report['error_deg']:.2f} degrees")
    return lines + [f"refused: {reason}" for reason in report["reasons"]]


def _tree(values: dict[str, Any]) -> dict[str, Any]:
    """Return dotted keys as nested mappings."""
    tree: dict[str, Any] = {}
    for key, value in values.items():
        put(tree, key.split("."), value)
    return tree


def _deg(angle: float, places: int = 2) -> float:
    """Return an angle (rad) in degrees, rounded."""
    return round(math.degrees(angle), places) + 0.0  # + 0.0 makes -0.0 to 0.0


def _wrapped_deg(angle_deg: float) -> float:
    """Return an angle between -180 and 180 degrees, rounded."""
    return round(math.remainder(angle_deg, 360.0), 2) + 0.0


def _within(seconds: float, most: float) -> float:
    """Return a time of at least 0 and at most `most`, rounded, s."""
    return round(clamp(seconds, 0.0, most), 3)
