"""Draws a landing on one sheet: trajectory, height, distance, phases, and pictures of the camera.

`landerd sim` writes such sheets; flight reports use the single plots. It needs matplotlib, which is
not part of the flight install (`pip install matplotlib`).
"""

from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from landerd.files import write_whole
from landerd.geometry import Vec3
from landerd.messages import Phase

COLOURS = {
    Phase.NOT_LANDING: "#9e9e9e",
    Phase.APPROACH: "#1f77b4",
    Phase.CLOSE_APPROACH: "#17becf",
    Phase.YAW_CORRECTION: "#ff7f0e",
    Phase.DESCENT: "#2ca02c",
    Phase.LANDED: "#d62728",
}


@dataclass(frozen=True, slots=True)
class Sample:
    """Vehicle and pad at one time, on axes from the pad's place: x north, y east, z up, m.

    In a simulated flight the axes are those of the pad at its start (see `Recording`); from a log,
    local NED's about the pad's last place (see `Flight.samples`).
    """

    t: float  # since the start, s
    vehicle: Vec3  # centre of the feet, m
    pad: Vec3  # landing point, m
    phase: Phase


@dataclass
class Trace:
    """What is drawn of a landing."""

    title: str
    samples: list[Sample] = field(default_factory=list)
    views: list[tuple[str, NDArray[np.uint8]]] = field(default_factory=list)  # caption, BGR picture


def write_picture(trace: Trace, path: Path) -> None:
    """Draw the sheet of a landing into a PNG file.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 10), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(trace.title, fontsize=14)
    grid = figure.add_gridspec(3, 6, height_ratios=(1.15, 0.9, 1.25))
    side(figure.add_subplot(grid[0, 0:3]), trace.samples)
    above(figure.add_subplot(grid[0, 3:6]), trace.samples)
    over_time(figure.add_subplot(grid[1, 0:6]), trace.samples)
    for i, (caption, image) in enumerate(trace.views[:3]):
        view = figure.add_subplot(grid[2, 2 * i : 2 * i + 2])
        view.imshow(image[:, :, ::-1])
        view.set_title(caption, fontsize=10)
        view.set_axis_off()
    png = BytesIO()
    figure.savefig(png, dpi=80, format="png")
    write_whole(path, png.getvalue())


def runs(samples: list[Sample]) -> list[tuple[Phase, list[Sample]]]:
    """Return samples by runs of the same phase; each begins with the last one before it."""
    runs: list[tuple[Phase, list[Sample]]] = []
    for s in samples:
        if not runs or runs[-1][0] is not s.phase:
            runs.append((s.phase, runs[-1][1][-1:] if runs else []))
        runs[-1][1].append(s)
    return runs


def side(axes: Any, samples: list[Sample]) -> None:
    """Draw the trajectory as seen from the east."""
    for phase, run in runs(samples):
        axes.plot([s.vehicle[0] for s in run], [s.vehicle[2] for s in run], color=COLOURS[phase])
    pad = [s.pad for s in samples]
    axes.plot([p[0] for p in pad], [p[2] for p in pad], color="black", linewidth=3, label="pad")
    axes.set(xlabel="north (m)", ylabel="up (m)", title="from the side")
    axes.set_ylim(bottom=-0.5)
    axes.grid(alpha=0.3)


def above(axes: Any, samples: list[Sample]) -> None:
    """Draw the trajectory as seen from above, north up."""
    for phase, run in runs(samples):
        axes.plot([s.vehicle[1] for s in run], [s.vehicle[0] for s in run], color=COLOURS[phase])
    pad = [s.pad for s in samples]
    axes.plot([p[1] for p in pad], [p[0] for p in pad], color="black", linewidth=3)
    axes.plot(pad[-1][1], pad[-1][0], "k+", markersize=14)
    axes.set(xlabel="east (m)", ylabel="north (m)", title="from above")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)


def over_time(axes: Any, samples: list[Sample]) -> None:
    """Draw height, distance and phases over time."""
    t = [s.t for s in samples]
    height = [s.vehicle[2] - s.pad[2] for s in samples]
    distance = [float(np.hypot(s.vehicle[0] - s.pad[0], s.vehicle[1] - s.pad[1])) for s in samples]
    axes.plot(t, height, color="black", label="height over the pad (m)")
    axes.plot(t, distance, color="black", linestyle="--", label="distance to the pad (m)")
    named: set[Phase] = set()
    for phase, run in runs(samples):
        label = None if phase in named else phase.value
        named.add(phase)
        axes.axvspan(run[0].t, run[-1].t, color=COLOURS[phase], alpha=0.25, label=label, lw=0)
    axes.set(xlabel="time (s)", xlim=(t[0], t[-1]))
    axes.set_ylim(bottom=-0.3)
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right", fontsize=8, ncols=2)
