"""Calibrates a gimbal from views and swings, and judges whether the result can be trusted."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from landerd.calibration.gimbal_fit import Axis, GimbalFit, View, fit
from landerd.calibration.gimbal_motion import FEWEST_VIEWS, AxisName, Delays, Measured

_LEAST_TURN = math.radians(8.0)  # least range of an axis's angles over all views
# Largest rms error of the pad's direction: with a larger one something has moved or is loose.
_LARGEST_BEARING_ERROR = math.radians(0.6)
_LARGEST_SIGMA = math.radians(1.0)  # largest standard deviation of an axis's values
_LARGEST_SCALE_ERROR = 0.05  # largest relative error of reported turns
_SAME_ANGLE = math.radians(0.3)  # reported angles closer together are one row of a table


@dataclass(frozen=True)
class AxisResult:
    """The calibration of one axis: its sign and zero, or a table; angles in rad."""

    sign: int
    zero: float | None  # true = sign * reported + zero
    table: tuple[tuple[float, float], ...] | None  # reported, true
    sigma: float
    delays: Delays | None


@dataclass(frozen=True)
class GimbalCalibration:
    """How a gimbal is mounted."""

    yaw: AxisResult | None  # None: it does not turn
    pitch: AxisResult
    camera_rotation: tuple[float, float, float]  # roll, pitch, yaw on the last axis
    error: float  # rms of the pad's direction


def calibrate(
    measured: Measured, *, tables: bool, turns: bool, aside_m: float
) -> tuple[GimbalCalibration | None, list[str]]:
    """Return the calibration, and the reasons not to fly with it; empty: it is good.

    Args:
        measured: views and delays.
        tables: whether the axes are servos, with tables instead of zeros.
        turns: whether there is a yaw axis, or a zero for it.
        aside_m: distance of the airframe's centre line, on which the pad lies, to the right of the
            gimbal's pivot.
    """
    views = measured.views
    if len(views) < FEWEST_VIEWS:
        return None, [
            f"the pad was seen in {len(views)} pictures, {FEWEST_VIEWS} are needed: lay it farther "
            "away, so that it stays in the picture while the camera turns"
        ]
    reasons = _turned_too_little(measured)
    if reasons:
        return None, reasons
    axes: dict[AxisName, Axis] = {
        "yaw": _axis("yaw", measured, tables=tables) if turns else Axis("none"),
        "pitch": _axis("pitch", measured, tables=tables),
    }
    if not tables:
        reasons += _scale_errors(measured, axes, aside_m)
    found = fit(views, axes["yaw"], axes["pitch"], aside_m, turns=bool(measured.signs))
    reasons += _uncertain(found)
    result = _result(measured, axes, found)
    for name, axis in (("yaw", result.yaw), ("pitch", result.pitch)):
        if axis is not None and axis.table is not None and not _monotonic(axis.table):
            reasons.append(f"{name}: the camera turns to and fro while the pulse rises: play?")
    return result, reasons


def _turned_too_little(measured: Measured) -> list[str]:
    """Return texts on axes that were not turned far enough."""
    reasons = []
    for name in measured.signs:
        angles = [getattr(view, name) for view in measured.views]
        if max(angles) - min(angles) < _LEAST_TURN:
            degrees = math.degrees(max(angles) - min(angles))
            reasons.append(
                f"{name} was turned by {degrees:.0f} degrees only, "
                f"{math.degrees(_LEAST_TURN):.0f} are needed: farther away, or wider limits"
            )
    return reasons


def _uncertain(found: GimbalFit) -> list[str]:
    """Return texts on views that contradict each other, or are too few for an axis."""
    reasons = []
    if found.error > _LARGEST_BEARING_ERROR:
        reasons.append(
            f"the pad was {math.degrees(found.error):.2f} degrees (rms) from where it should have "
            "been: did pad, airframe or camera move? Is there play in the gimbal?"
        )
    for name, sigma in (("yaw", found.yaw_sigma), ("pitch", found.pitch_sigma)):
        if sigma > _LARGEST_SIGMA:
            reasons.append(
                f"{name} is only known to {math.degrees(sigma):.1f} degrees (1 sigma): a larger or "
                "nearer pad, wider turns"
            )
    return reasons


def _axis(name: AxisName, measured: Measured, *, tables: bool) -> Axis:
    """Return the unknowns of an axis."""
    sign = measured.signs.get(name, 1)
    if not tables or name not in measured.signs:
        return Axis("shift", sign)
    return Axis("table", sign, _rows(measured.views, name))


def _rows(views: Sequence[View], name: AxisName) -> tuple[float, ...]:
    """Return the reported angles of all views, rad, ascending; nearly equal ones are averaged."""
    rows: list[list[float]] = []
    for angle in sorted(getattr(view, name) for view in views):
        if rows and angle - rows[-1][0] < _SAME_ANGLE:
            rows[-1].append(angle)
        else:
            rows.append([angle])
    return tuple(float(np.mean(row)) for row in rows)


def _scale_errors(measured: Measured, axes: dict[AxisName, Axis], aside_m: float) -> list[str]:
    """Return texts on axes that turn by other angles than they report."""
    free: dict[AxisName, Axis] = {}
    for name, axis in axes.items():
        angles = [getattr(view, name) for view in measured.views]
        turned = name in measured.signs
        free[name] = Axis("table", axis.sign, (min(angles), max(angles))) if turned else axis
    found = fit(measured.views, free["yaw"], free["pitch"], aside_m, turns=True)
    reasons = []
    for (name, axis), values in zip(free.items(), (found.yaw, found.pitch), strict=True):
        if axis.kind != "table":
            continue
        slope = axis.sign * (values[1] - values[0]) / (axis.at[1] - axis.at[0])
        if abs(slope - 1.0) > _LARGEST_SCALE_ERROR:
            reasons.append(
                f"{name} turns by {slope:.2f} degrees for each one that it reports: is the "
                "camera's calibration right? Else set the gimbal's own scale"
            )
    return reasons


def _result(measured: Measured, axes: dict[AxisName, Axis], found: GimbalFit) -> GimbalCalibration:
    """Return the calibration from the least-squares solution."""

    def axis_result(name: AxisName, values: tuple[float, ...], sigma: float) -> AxisResult:
        axis = axes[name]
        table = tuple(zip(axis.at, values, strict=True)) if axis.kind == "table" else None
        zero = values[0] if axis.kind == "shift" else None
        return AxisResult(axis.sign, zero, table, sigma, measured.delays.get(name))

    yaw = axis_result("yaw", found.yaw, found.yaw_sigma) if axes["yaw"].kind != "none" else None
    pitch = axis_result("pitch", found.pitch, found.pitch_sigma)
    rotation = (found.camera_roll, 0.0, found.camera_yaw)
    return GimbalCalibration(yaw, pitch, rotation, found.error)


def _monotonic(table: tuple[tuple[float, float], ...]) -> bool:
    """Tell whether the true angles of a table only rise or only fall."""
    steps = np.diff([true for _, true in table])
    return bool(np.all(steps > 0.0) or np.all(steps < 0.0))
