"""Reports on one flight or several, each a single HTML file: `landerd report`.

Plots need matplotlib, which is not part of the flight install (`pip install matplotlib`).
"""

import base64
import html
import importlib.util
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.analysis import flights_table, picture, sighting_errors
from landerd.analysis.flight import Flight, sentences
from landerd.analysis.page import drawing, html_of, page
from landerd.analysis.picture import COLOURS
from landerd.estimation.health import NIS_EXPECTED
from landerd.files import as_bytes, write_whole
from landerd.flightlog.reader import read_images
from landerd.geometry import Vec3
from landerd.messages import Frame, Sightings
from landerd.vision.draw import draw

NO_PLOTS = "Without plots: they need matplotlib (pip install matplotlib)."
# Largest time between a change of phase and the recorded picture that is shown for it.
NEAR_S = 1.0
_WIDTH_IN = 10.0  # width of all plots, inches


class _Plot(NamedTuple):
    """A plot of a report."""

    title: str
    caption: str
    height_in: float
    draw: Callable[[Any, Flight], None]  # draws onto a matplotlib figure
    is_there: Callable[[Flight], bool]  # tells whether a flight has what the plot shows


def report(flights: list[Flight]) -> str:
    """Return the HTML page; it has no plots if matplotlib is not installed."""
    blocks = flights_table.section(flights) if len(flights) > 1 else []
    parts = [html_of(block) for block in blocks]
    parts += [_section(flight) for flight in flights]
    parts += [html_of(block) for block in sighting_errors.section(flights)]
    names = ", ".join(flight.title for flight in flights)
    return page(f"landerd: {names}", "\n".join(parts))


def _section(flight: Flight) -> str:
    """Return the HTML of one flight."""
    log = flight.log
    out = [f"<h1>{html.escape(flight.title)}</h1>"]
    out += [f'<p class="note">{html.escape(note)}</p>' for note in _notes(flight)]
    out += ["<h2>What happened</h2>", "<ol>"]
    out += [f"<li>{html.escape(text)}</li>" for text in sentences(flight)]
    out.append("</ol>")
    out += _views(flight)
    if importlib.util.find_spec("matplotlib") is None:
        out.append(f'<p class="note">{NO_PLOTS}</p>')
    else:
        for plot in _PLOTS:
            if plot.is_there(flight):
                out += _figure(plot, flight)
    versions = "".join(
        f"<tr><td>{html.escape(k)}</td><td>{html.escape(v)}</td></tr>"
        for k, v in log.versions.items()
    )
    out += ["<h2>Recorded by</h2>", f'<table class="small">{versions}</table>']
    return "\n".join(out)


def _notes(flight: Flight) -> list[str]:
    """Return remarks on the log: defects, and what was not recorded."""
    notes = list(flight.log.notes)
    dropped = flight.log.dropped
    if dropped is not None:
        notes.append(
            f"Not recorded: {dropped.images} images, {dropped.detail} details, "
            f"{dropped.messages} messages of the core; {dropped.errors} could not be written."
        )
    return notes


def _figure(plot: _Plot, flight: Flight) -> list[str]:
    """Return the HTML of a plot."""
    drawn = drawing(_WIDTH_IN, plot.height_in, lambda figure: plot.draw(figure, flight))
    return [
        f"<h2>{html.escape(plot.title)}</h2>",
        f"<figure>{drawn}<figcaption>{html.escape(plot.caption)}</figcaption></figure>",
    ]


# ---- pictures at the changes of phase ----------------------------------------------------------


def _views(flight: Flight) -> list[str]:
    """Return the HTML of recorded pictures near changes of phase, with sightings drawn in."""
    log = flight.log
    seen = {s.seq: s for s in flight.sightings}
    wanted = flight.changes
    nearest: list[tuple[float, Frame] | None] = [None] * len(wanted)
    for frame, _ in read_images(log.path):
        t = frame.t - log.wall_offset_s - flight.zero
        for i, (change_t, _) in enumerate(wanted):
            away = abs(t - change_t)
            best = nearest[i]
            if away < NEAR_S and (best is None or away < best[0]):
                nearest[i] = (away, frame)
    views = []
    for (t, change), found in zip(wanted, nearest, strict=True):
        if found is None:
            continue
        frame = found[1]
        nothing = Sightings(frame.t, frame.seq, (), ())
        image = draw(frame.image, seen.get(frame.seq, nothing), log.camera, log.layout)
        caption = f"{t:.1f} s: {change.phase.value}, {change.reason}"
        views.append(
            f"<figure>{_image(image)}<figcaption>{html.escape(caption)}</figcaption></figure>"
        )
    if not views:
        return []
    return ["<h2>Where the phases changed</h2>", '<div class="views">', *views, "</div>"]


def _image(image: NDArray[np.uint8]) -> str:
    """Return the HTML of a picture, which contains it as a JPEG."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 70])
    text = base64.b64encode(data.tobytes()).decode()
    return f'<img alt="" src="data:image/jpeg;base64,{text}">'


# ---- plots -------------------------------------------------------------------------------------


def _way(figure: Any, flight: Flight) -> None:
    """Draw the trajectory from the side, in the direction of the start, and from above."""
    samples = flight.samples()
    left, right = figure.subplots(1, 2)
    pad = samples[-1].pad
    north, east = (samples[0].vehicle[i] - pad[i] for i in (0, 1))
    length = math.hypot(north, east) or 1.0

    def out(p: Vec3) -> float:
        return ((p[0] - pad[0]) * north + (p[1] - pad[1]) * east) / length

    for phase, run in picture.runs(samples):
        way = [(out(s.vehicle), s.vehicle[2]) for s in run]
        left.plot([w[0] for w in way], [w[1] for w in way], color=COLOURS[phase])
    left.plot([out(s.pad) for s in samples], [s.pad[2] for s in samples], color="black", lw=3)
    left.set(xlabel="towards where it came from (m)", ylabel="up (m)", title="from the side")
    left.grid(alpha=0.3)
    picture.above(right, samples)


def _has_way(flight: Flight) -> bool:
    """Tell whether there is a trajectory."""
    return len(flight.samples()) > 1


def _over_time(figure: Any, flight: Flight) -> None:
    """Draw height, distance and phases over time."""
    picture.over_time(figure.add_subplot(), flight.samples())


def _errors(figure: Any, flight: Flight) -> None:
    """Draw the estimated position of the pad, its sigma, and the error of the heading."""
    above, middle, below = figure.subplots(3, 1, sharex=True)
    states = [s for s in flight.log.states if s.relative is not None]
    t = [s.t - flight.zero for s in states]
    relatives = [s.relative for s in states if s.relative is not None]
    for axis, name, colour in ((0, "north", "tab:red"), (1, "east", "tab:green")):
        values = np.array([r.error[axis] for r in relatives])
        sigma = np.array([r.sigma_m for r in relatives])
        above.plot(t, values, color=colour, label=name)
        above.fill_between(t, values - sigma, values + sigma, color=colour, alpha=0.2, lw=0)
    above.set(ylabel="error (m)")
    above.set_yscale("symlog", linthresh=0.5)
    above.set_yticks([-10, -1, -0.3, 0, 0.3, 1, 10], ["-10", "-1", "-.3", "0", ".3", "1", "10"])
    above.legend(loc="upper right", fontsize=8)
    middle.semilogy(t, [max(r.sigma_m, 1e-3) for r in relatives], color="black")
    middle.set(ylabel="sigma (m)")
    headings = [
        (at, math.degrees(r.heading_error))
        for at, r in zip(t, relatives, strict=True)
        if r.heading_error is not None
    ]
    below.plot([h[0] for h in headings], [h[1] for h in headings], color="tab:purple")
    below.set(ylabel="heading error (deg)")
    _finish(figure, flight)


def _pointing(figure: Any, flight: Flight) -> None:
    """Draw the pad's position in the camera frame."""
    poses = [(s.t - flight.zero, s.pad[0].position) for s in flight.sightings if s.pad]
    for axes, i, name in zip(figure.subplots(3, 1, sharex=True), range(3), "xyz", strict=True):
        axes.plot([t for t, _ in poses], [p[i] for _, p in poses], lw=1)
        axes.set(ylabel=f"{name} (m)")
        if i < 2:
            axes.axhline(0.0, color="black", lw=0.6)
    _finish(figure, flight)


def _velocities(figure: Any, flight: Flight) -> None:
    """Draw flown velocities and set-points."""
    flown_t = [t for t, _ in flight.positions]
    asked_t = [t for t, _ in flight.setpoints]
    names = ("north", "east", "down")
    for axes, i, name in zip(figure.subplots(3, 1, sharex=True), range(3), names, strict=True):
        axes.plot(flown_t, [p.velocity[i] for _, p in flight.positions], label="flown")
        asked = [s.velocity[i] for _, s in flight.setpoints]
        axes.plot(*_broken(asked_t, asked), "--", color="tab:orange", label="asked")
        axes.set(ylabel=f"{name} (m/s)")
    axes.legend(loc="upper right", fontsize=8)
    _finish(figure, flight)


def _broken(t: list[float], values: list[float]) -> tuple[list[float], list[float]]:
    """Return a line over time with a gap wherever nothing was sent for half a second."""
    times, parts = list[float](), list[float]()
    for at, value in zip(t, values, strict=True):
        if times and at - times[-1] > 0.5:
            times.append(times[-1])
            parts.append(math.nan)
        times.append(at)
        parts.append(value)
    return times, parts


def _health(figure: Any, flight: Flight) -> None:
    """Draw innovations, refused sightings, ages of pictures, and errors of clock and lens."""
    fit, refused, ages, clock, lens = figure.subplots(5, 1, sharex=True)
    known = [(s.t - flight.zero, s.health) for s in flight.log.states if s.health is not None]
    t = [at for at, _ in known]
    fit.plot(t, [h.nis for _, h in known], color="black")
    fit.axhline(NIS_EXPECTED, color="black", lw=0.6, ls="--")
    fit.set(ylabel="NIS")
    refused.plot(t, [100.0 * h.refused for _, h in known], color="tab:red")
    refused.set(ylabel="refused (%)")
    if flight.budgets:
        at, *parts, _ = zip(*flight.budgets, strict=True)
        stacked = [[1e3 * x for x in part] for part in parts]
        ages.stackplot(at, *stacked, labels=["camera, transport", "vision", "wait"])
        ages.legend(loc="upper right", fontsize=8)
    ages.set(ylabel="age (ms)")
    found = [(s.t - flight.zero, s.sensors) for s in flight.log.states if s.sensors is not None]
    t = [at for at, _ in found]
    late = [1e3 * s.clock_s for _, s in found]
    _band(clock, t, late, [1e3 * s.sigma_clock_s for _, s in found], "tab:blue")
    clock.set(ylabel="late (ms)")
    up = [math.degrees(s.up) for _, s in found]
    _band(lens, t, up, [math.degrees(s.sigma_up) for _, s in found], "tab:green", "up")
    right = [math.degrees(s.right) for _, s in found]
    _band(lens, t, right, [math.degrees(s.sigma_right) for _, s in found], "tab:purple", "right")
    lens.set(ylabel="lens (deg)")
    lens.legend(loc="upper right", fontsize=8)
    _finish(figure, flight)


def _band(
    axes: Any, t: list[float], values: list[float], sigma: list[float], colour: str, name: str = ""
) -> None:
    """Draw values over time with a band of one sigma."""
    axes.plot(t, values, color=colour, label=name)
    low = [v - s for v, s in zip(values, sigma, strict=True)]
    high = [v + s for v, s in zip(values, sigma, strict=True)]
    axes.fill_between(t, low, high, color=colour, alpha=0.2, lw=0)


def _battery(figure: Any, flight: Flight) -> None:
    """Draw the battery's voltage and the energy used."""
    axes = figure.add_subplot()
    t = [b.t - flight.zero for b in flight.batteries]
    axes.plot(t, [b.voltage_v if b.voltage_v is not None else math.nan for b in flight.batteries])
    axes.set(ylabel="V")
    energy = [b.energy_consumed_j for b in flight.batteries]
    if any(e is not None for e in energy):
        other = axes.twinx()
        used = [math.nan if e is None else e / 100.0 for e in energy]
        other.plot(t, used, color="tab:red")
        other.set_ylabel("used (hJ; 36 hJ are 1 Wh)", color="tab:red")
    _finish(figure, flight)


def _finish(figure: Any, flight: Flight) -> None:
    """Give all plots over time the same axis, and phases as background colours."""
    ends = [t for t, _ in flight.changes[1:]] + [flight.end]
    for axes in figure.axes:
        axes.set_xlim(0.0, flight.end)
        axes.grid(alpha=0.3)
        for (start, change), end in zip(flight.changes, ends, strict=False):
            axes.axvspan(start, end, color=COLOURS[change.phase], alpha=0.12, lw=0)
    figure.axes[-1].set_xlabel("time (s)")


_PLOTS = (
    _Plot(
        "Way to the pad",
        "Feet and landing point (black) as landerd believed them to be; colours are phases.",
        3.6,
        _way,
        _has_way,
    ),
    _Plot("Phases, height and distance", "", 3.4, _over_time, _has_way),
    _Plot(
        "Error and uncertainty",
        "Pad minus vehicle; the band is one standard deviation of the estimate.",
        5.2,
        _errors,
        _has_way,
    ),
    _Plot(
        "Pointing of the camera",
        "Where the pad stood in the camera's frame: x right, y down, z away (thesis figures "
        "3.2 to 3.4); 0 in x and y is the middle of the picture.",
        5.2,
        _pointing,
        lambda flight: any(s.pad for s in flight.sightings),
    ),
    _Plot(
        "Velocities asked and flown",
        "Set-points are dashed; there are none while landerd is silent.",
        5.2,
        _velocities,
        lambda flight: bool(flight.positions),
    ),
    _Plot(
        "Health of the estimate",
        "Over the last two seconds: the sightings' mean normalised innovation squared (3 is "
        "expected) and how many of them were refused. How old pictures were at the control step "
        "that could first fly on them. What was found of the pictures' clock and the lens's "
        "direction; the bands are one standard deviation.",
        7.0,
        _health,
        lambda flight: any(s.health is not None for s in flight.log.states),
    ),
    _Plot("Battery", "", 2.6, _battery, lambda flight: len(flight.batteries) > 1),
)


def write_report(flights: list[Flight], path: Path) -> None:
    """Write the report on flights into a file.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, as_bytes(report(flights)))
