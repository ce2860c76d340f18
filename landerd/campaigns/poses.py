"""Errors of a marker's poses by distance, beside the thesis's regressions (3.3, 3.4)."""

import math
from collections.abc import Mapping, Sequence
from statistics import fmean, stdev
from typing import Any

import numpy as np

from landerd.analysis.intervals import in_percent, mean_interval, percentile, wilson, with_interval
from landerd.analysis.regression import in_words, regression
from landerd.campaigns.plan import Poses, Row
from landerd.campaigns.pool import Run
from landerd.campaigns.table import right_aligned

BIN_M = 2.0
AXES = ("north", "east", "up")


def make_pose_row(row: Row, runs: Sequence[Run]) -> dict[str, Any]:
    """Return the figures of all pictures of one row, and those of the thesis."""
    asked = row.poses
    assert asked is not None
    pictures = [p for run in runs if run.result is not None for p in run.result["poses"]]
    seen = [p["markers"][asked.marker] for p in pictures if asked.marker in p["markers"]]
    distances = [m["distance_m"] for m in seen]
    errors = [math.hypot(*m["error_m"]) for m in seen]
    yaws = [m["yaw_error_rad"] for m in seen if m["yaw_error_rad"] is not None]
    return {
        "scenario": row.name,
        "label": row.label or row.name,
        "marker": asked.marker,
        "runs": len(runs),
        "pictures": len(pictures),
        "seen": len(seen),
        "bins": _bins(pictures, asked),
        "error_m_fit": regression(distances, errors, 3),
        "axes": {axis: _mean_sd([m["error_m"][i] for m in seen]) for i, axis in enumerate(AXES)},
        "yaw_error_rad": _mean_sd(yaws),
        "yaw_error_rad_fit": regression(distances, [abs(y) for y in yaws], 2) if yaws else None,
        "flips": _share([p["flipped"] for p in pictures]),
        "flips_without_gravity": _share([p["flipped_alone"] for p in pictures]),
        "thesis": asked.model_dump(exclude={"marker"}),
        "errors": {str(run.seed): run.error for run in runs if run.error is not None},
        "missed": ["exceptions, needed none"] if any(run.error for run in runs) else [],
    }


def _bins(pictures: Sequence[dict[str, Any]], asked: Poses) -> list[dict[str, Any]]:
    bins: dict[int, list[dict[str, Any]]] = {}
    for picture in pictures:
        bins.setdefault(int(picture["distance_m"] / BIN_M), []).append(picture)
    return [_bin(i * BIN_M, bins[i], asked) for i in sorted(bins)]


def _bin(from_m: float, pictures: Sequence[dict[str, Any]], asked: Poses) -> dict[str, Any]:
    seen = [p["markers"][asked.marker] for p in pictures if asked.marker in p["markers"]]
    errors = [math.hypot(*m["error_m"]) for m in seen]
    yaws = [abs(m["yaw_error_rad"]) for m in seen if m["yaw_error_rad"] is not None]
    middle = from_m + 0.5 * BIN_M
    return {
        "from_m": from_m,
        "to_m": from_m + BIN_M,
        "pictures": len(pictures),
        "seen": len(seen),
        "seen_95": wilson(len(seen), len(pictures)),
        "error_m_mean": fmean(errors) if errors else None,
        "error_m_mean_95": mean_interval(errors),
        "error_m_p95": percentile(errors, 95.0),
        "thesis_error_m": _at(asked.error_m, middle),
        "yaw_error_rad_mean": fmean(yaws) if yaws else None,
        "yaw_error_rad_mean_95": mean_interval(yaws),
        "thesis_yaw_error_rad": _at(asked.yaw_error_rad, middle),
    }


def _at(polynomial: tuple[float, ...] | None, x: float) -> float | None:
    return None if polynomial is None else float(np.polyval(polynomial, x))


def _mean_sd(values: Sequence[float]) -> dict[str, Any] | None:
    if len(values) < 2:
        return None
    return {"mean": fmean(values), "mean_95": mean_interval(values), "sd": stdev(values)}


def _share(flipped: Sequence[bool | None]) -> dict[str, Any]:
    known = [f for f in flipped if f is not None]
    return {"flipped": sum(known), "of": len(known), "share_95": wilson(sum(known), len(known))}


# ---- as text -------------------------------------------------------------------------------------


def as_text(row: dict[str, Any]) -> str:
    """Return the table of distances, and remarks on all of them."""
    title = f"{row['label']}: {row['marker']}, {row['pictures']} pictures"
    said = (f"  {line}" for line in remarks(row))
    return "\n".join([title, *right_aligned(bin_cells(row), indent=2), *said])


def bin_cells(row: Mapping[str, Any]) -> list[list[str]]:
    """Return the cells of the table of distances, its heads first."""
    has_yaw = row["yaw_error_rad"] is not None
    head = ["distance m", "seen", "95 %", "error m", "p95", "thesis m"]
    lines = [head + ["yaw rad", "thesis rad"] * has_yaw]
    for b in row["bins"]:
        line = [
            f"{b['from_m']:g} to {b['to_m']:g}",
            f"{b['seen']}/{b['pictures']}",
            in_percent(b["seen_95"]),
            with_interval(b["error_m_mean"], b["error_m_mean_95"], 3),
            *(_number(b[key]) for key in ("error_m_p95", "thesis_error_m")),
        ]
        if has_yaw:
            yaw = with_interval(b["yaw_error_rad_mean"], b["yaw_error_rad_mean_95"], 3)
            line += [yaw, _number(b["thesis_yaw_error_rad"])]
        lines.append(line)
    return lines


def remarks(row: Mapping[str, Any]) -> list[str]:
    """Return regressions, means and flips in words, beside the thesis's."""
    lines, thesis = [], row["thesis"]
    for name, key in (("error m", "error_m_fit"), ("yaw error rad", "yaw_error_rad_fit")):
        fit = row[key]
        if fit is not None:
            published = thesis[key.removesuffix("_fit")]
            beside = f"; thesis {' '.join(f'{c:+g}' for c in published)}" if published else ""
            lines.append(f"{name} {in_words(fit)}{beside}")
    for i, axis in enumerate(AXES):
        found = row["axes"][axis]
        if found is not None:
            beside = f"; thesis sd {thesis['sd_m'][i]:.3f}" if thesis["sd_m"] else ""
            mean = with_interval(found["mean"], found["mean_95"], 3)
            lines.append(f"{axis}: mean {mean} m, sd {found['sd']:.3f} m{beside}")
    if row["yaw_error_rad"] is not None:
        beside = f"; thesis sd {thesis['yaw_sd_rad']}" if thesis["yaw_sd_rad"] else ""
        yaw = row["yaw_error_rad"]
        mean = with_interval(yaw["mean"], yaw["mean_95"], 4)
        lines.append(f"yaw: mean {mean} rad, sd {yaw['sd']:.4f} rad{beside}")
    for name, key in (("with", "flips"), ("without", "flips_without_gravity")):
        flips = row[key]
        lines.append(
            f"axis of the pad flipped, {name} gravity: {flips['flipped']} of {flips['of']} "
            f"(95 %: {in_percent(flips['share_95'])})"
        )
    return [*lines, *(f"seed {seed}: {error}" for seed, error in row["errors"].items())]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
