"""Figures as in the thesis, made from a campaign's flights; needs matplotlib.

Each is a drawing for every row: the thesis's controller beside landerd's.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from landerd.analysis.page import Figures, drawing
from landerd.campaigns.plan import OF_POSES, Campaign, Figure, Row
from landerd.campaigns.pool import Run
from landerd.campaigns.table import has_failed_to_land

WIDTH_IN, HEIGHT_IN = 5.2, 3.6  # so that text can be read on a phone's width
OURS, THEIRS, LINE = "#1f77b4", "#d62728", {"lw": 0.8, "alpha": 0.7}
MOST_ROWS = 4  # most rows shown; of more, only some, among them the best and the worst

Path = Mapping[str, Sequence[float | None]]  # of landerd.simulation.path
Draw = Callable[[Any, Row, Sequence[Run]], None]


def figures(campaign: Campaign, runs: Mapping[str, Sequence[Run]]) -> list[Figures]:
    """Return the campaign's figures, as far as there are flights for them.

    Raises:
        ImportError: matplotlib is not installed.
    """
    found = []
    for name, number in campaign.figures.items():
        draw, caption = _FIGURES[name]
        key = "poses" if name in OF_POSES else "path"
        drawings = [
            _drawn(draw, row, flown)
            for row, flown in _shown(campaign, runs)
            if any(run.result is not None and run.result.get(key) for run in flown)
        ]
        if drawings:
            figure = "figure" if number.replace(".", "").isdigit() else "figures"
            found.append(Figures(drawings, f"{caption} Thesis: {figure} {number}."))
    return found


def _shown(
    campaign: Campaign, runs: Mapping[str, Sequence[Run]]
) -> list[tuple[Row, Sequence[Run]]]:
    """Return all rows, or of many those outside of grids, and the best and the worst."""
    rows = [(campaign.row(name), flown) for name, flown in runs.items()]
    if len(rows) <= MOST_ROWS:
        return rows

    def order(row: tuple[Row, Sequence[Run]]) -> tuple[float, float]:
        flown = row[1]
        times = [r.result["time_s"] for r in flown if r.result and r.result.get("time_s")]
        return sum(map(has_failed_to_land, flown)) / len(flown), sum(times) / max(1, len(times))

    varied = {row.name for grid in campaign.grids for row in grid.rows()} or set(runs)
    ordered = sorted((each for each in rows if each[0].name in varied), key=order)
    return [*ordered[:1], *ordered[1:][-1:], *(r for r in rows if r[0].name not in varied)]


def _drawn(draw: Draw, row: Row, runs: Sequence[Run]) -> str:
    def onto(figure: Any) -> None:
        figure.suptitle(row.label or row.name, fontsize=10)
        draw(figure, row, runs)
        for axes in figure.axes:
            axes.grid(alpha=0.3)

    return drawing(WIDTH_IN, HEIGHT_IN, onto)


def _paths(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return the columns of all flights that have any, with NaN for unknown values."""
    paths = [run.result["path"] for run in runs if run.result and run.result.get("path")]
    return [
        {key: np.array([math.nan if v is None else v for v in column]) for key, column in p.items()}
        for p in paths
        if p["t"]
    ]


# ---- of flights ----------------------------------------------------------------------------------


def _camera(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    for axes, axis in zip(figure.subplots(3, 1, sharex=True), "xyz", strict=True):
        for path in _paths(runs):
            seen = ~np.isnan(path[axis])
            axes.plot(path["t"][seen], path[axis][seen], color=OURS, **LINE)
        axes.set(ylabel=f"{axis} (m)")
    axes.set(xlabel="time since first sight (s)")


def _distance(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    axes = figure.add_subplot()
    for path in _paths(runs):
        away = np.hypot(path["north"] - path["pad_north"], path["east"] - path["pad_east"])
        axes.plot(path["t"], away, color=OURS, **LINE)
    axes.set(xlabel="time since first sight (s)", ylabel="distance to the pad, level (m)")


def _descent(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    above, below = figure.subplots(2, 1, sharex=True)
    for path in _paths(runs):
        above.plot(path["t"], path["up"], color=OURS, **LINE)
        if len(path["t"]) > 1:
            below.plot(path["t"], np.gradient(path["up"], path["t"]), color=OURS, **LINE)
    above.set(ylabel="height (m)")
    below.set(xlabel="time since first sight (s)", ylabel="speed up (m/s)")


def _heading(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    axes = figure.add_subplot()
    for path in _paths(runs):
        axes.plot(path["t"], path["heading_error_deg"], color=OURS, **LINE)
    axes.set(xlabel="time since first sight (s)", ylabel="off the pad's heading (deg)")


def _trajectories(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    """Draw the paths relative to the pad: from above, and height over distance."""
    left, right = figure.subplots(1, 2)
    for path in _paths(runs):
        north, east = path["north"] - path["pad_north"], path["east"] - path["pad_east"]
        left.plot(east, north, color=OURS, **LINE)
        right.plot(np.hypot(north, east), path["up"], color=OURS, **LINE)
    left.plot(0.0, 0.0, "k+", markersize=10)
    left.set(xlabel="east of the pad (m)", ylabel="north of the pad (m)")
    left.set_aspect("equal", adjustable="datalim")
    right.set(xlabel="distance, level (m)", ylabel="height (m)")


def _estimated(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    """Draw the pad's estimated positions relative to the vehicle: from above, and below it."""
    left, right = figure.subplots(1, 2)
    for path in _paths(runs):
        if "ahead" in path:  # older files do not tell
            left.plot(path["right"], path["ahead"], color=OURS, **LINE)
            right.plot(np.hypot(path["ahead"], path["right"]), path["below"], color=OURS, **LINE)
    left.plot(0.0, 0.0, "k+", markersize=10)
    left.set(xlabel="right of the vehicle (m)", ylabel="ahead of it (m)")
    left.set_aspect("equal", adjustable="datalim")
    right.set(xlabel="distance, level (m)", ylabel="below its feet (m)")


# ---- of poses ------------------------------------------------------------------------------------


def _seen(row: Row, runs: Sequence[Run]) -> list[dict[str, Any]]:
    assert row.poses is not None
    kind = row.poses.marker
    pictures = [p for run in runs if run.result is not None for p in run.result.get("poses", ())]
    return [p["markers"][kind] for p in pictures if kind in p["markers"]]


def _errors(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    left, right = figure.subplots(1, 2)
    seen = _seen(row, runs)
    assert row.poses is not None
    left.plot([m["error_m"][1] for m in seen], [m["error_m"][0] for m in seen], ".", ms=2)
    left.set(xlabel="error east (m)", ylabel="error north (m)")
    distances = [m["distance_m"] for m in seen]
    errors = [math.hypot(*m["error_m"]) for m in seen]
    _over_distance(right, distances, errors, 3, row.poses.error_m)
    right.set(xlabel="distance (m)", ylabel="error (m)")


def _yaw_errors(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    axes = figure.add_subplot()
    assert row.poses is not None
    seen = [m for m in _seen(row, runs) if m["yaw_error_rad"] is not None]
    errors = [abs(m["yaw_error_rad"]) for m in seen]
    distances = [m["distance_m"] for m in seen]
    _over_distance(axes, distances, errors, 2, row.poses.yaw_error_rad)
    axes.set(xlabel="distance (m)", ylabel="heading's error (rad)")


def _over_distance(
    axes: Any, x: Sequence[float], y: Sequence[float], degree: int, thesis: Sequence[float] | None
) -> None:
    axes.plot(x, y, ".", ms=2, color=OURS)
    if len(x) <= degree + 1:
        return
    along = np.linspace(min(x), max(x), 60)
    axes.plot(along, np.polyval(np.polyfit(x, y, degree), along), color=OURS, label="ours")
    if thesis is not None:
        axes.plot(along, np.polyval(thesis, along), "--", color=THEIRS, label="thesis")
    axes.set_yscale("symlog", linthresh=0.01)
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8)


def _flips(figure: Any, row: Row, runs: Sequence[Run]) -> None:
    """Draw the distances at which the axis found was the mirrored one."""
    axes = figure.add_subplot()
    pictures = [p for run in runs if run.result is not None for p in run.result.get("poses", ())]
    for height, key in enumerate(("flipped_alone", "flipped")):
        for flipped, colour in ((False, OURS), (True, THEIRS)):
            x = [p["distance_m"] for p in pictures if p[key] is flipped]
            axes.plot(x, [height] * len(x), "|", color=colour, ms=14)
    axes.set(xlabel="distance (m)", ylim=(-0.6, 1.6))
    axes.set_yticks([0, 1], ["gravity\nunknown", "gravity\nknown"])


_FIGURES: Mapping[Figure, tuple[Draw, str]] = {
    "camera": (
        _camera,
        "The landing point in the camera's frame: x right, y down, z away. Each line is a landing.",
    ),
    "distance": (_distance, "Distance over time. Each line is a flight."),
    "descent": (_descent, "Height and speed over time. Each line is a landing."),
    "heading": (_heading, "Off the pad's heading over time. Each line is a turn."),
    "paths": (_trajectories, "Ways to the pad, as seen from it. Each line is a landing."),
    "estimated": (
        _estimated,
        "Where landerd took the pad to be, as seen from the vehicle. Each line is a landing.",
    ),
    "errors": (_errors, "Where the marker was said to be, and how far off over the distance."),
    "yaw_errors": (_yaw_errors, "How far off the heading was, over the distance."),
    "flips": (_flips, "Each stroke is a picture; red: the axis is the mirrored one."),
}
