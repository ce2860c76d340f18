"""Compares modelled sight to vision on the same flights: detection rate, errors, stated sigmas.

    python -m bench.sight --scenarios stationary wind-8 --seeds 1 2   # the table
    python -m bench.sight --scenarios field --seeds 1 2 3 4

Flights use pictures. For each picture a second Vision gets what `sim.sight: modelled` would have
made of it, with the same prior. There is a row for each kind of marker and size in the image: in
what share of the pictures that show it either found it, median stated sigmas and errors of its
position along the line of sight and across, of its tilt, the share of errors within the stated 95 %
region, and how often the first solution is the wrong one. The constants of
`landerd/simulation/sight/statistics.py` are set by this table.
"""

import argparse
import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hw.sim.picture.lens import true_camera
from hw.sim.picture.levels import Sensitivity
from hw.sim.picture.numbered import NumberedPictures, View
from hw.sim.picture.pad_print import printed
from landerd.config.files import Loaded, config_dir
from landerd.devices import sim_options
from landerd.drivers import read_configuration
from landerd.messages import Frame, MarkerSighting, Prior, Sightings
from landerd.pad import size_m
from landerd.runtime.clock import run_virtual
from landerd.runtime.observer import Observer
from landerd.simulation.flight import Simulation
from landerd.simulation.sight.detectors import ModelledDetectors
from landerd.simulation.sight.world_view import Seen, WorldView
from landerd.vision import Vision
from landerd.vision.arrays import Image

# Lower limits of the bins of sizes.
SIZES_PX = (0, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 30, 50, 80, 120, 200, 400, 4000)
LONGEST_S = 40.0  # longest flight
CHI2_95 = 7.815  # 95 % quantile of chi-square with three degrees of freedom
# A normal with a larger error is that of the other solution of the planar ambiguity.
FLIPPED = math.cos(math.radians(15.0))


@dataclass
class Cell:
    """What vision or modelled sight saw of one kind of marker at one size."""

    found: int = 0  # number of sightings
    inside: int = 0  # those whose position's error is within the stated 95 % region
    flipped: int = 0  # those with the other solution first
    # Errors along the line of sight (absolute, and signed) and across, m, and of tilt, rad.
    along_m: list[float] = field(default_factory=list)
    signed_m: list[float] = field(default_factory=list)
    across_m: list[float] = field(default_factory=list)
    tilt: list[float] = field(default_factory=list)
    # Stated sigmas of the same, m and rad.
    sigma_along: list[float] = field(default_factory=list)
    sigma_across: list[float] = field(default_factory=list)
    sigma_tilt: list[float] = field(default_factory=list)

    def add(self, marker: MarkerSighting, seen: Seen) -> None:
        """Add one sighting of a marker, with its truth."""
        best = marker.solutions[0]
        sight = seen.pose.t / np.linalg.norm(seen.pose.t)
        error, C = np.array(best.position) - seen.pose.t, np.array(best.covariance)
        self.found += 1
        self.inside += float(error @ np.linalg.solve(C, error)) < CHI2_95
        cosine = float(np.array(best.normal) @ seen.pose.normal)
        self.flipped += cosine < FLIPPED
        along = float(error @ sight)
        self.along_m.append(abs(along))
        self.signed_m.append(along)
        self.across_m.append(float(np.linalg.norm(error - along * sight)))
        self.tilt.append(math.acos(min(cosine, 1.0)))
        self.sigma_along.append(float(sight @ C @ sight) ** 0.5)
        self.sigma_across.append(float(np.trace(C) - sight @ C @ sight) ** 0.5)
        self.sigma_tilt.append(best.sigma_tilt)

    def line(self, shown: int) -> str:
        """Return the columns; `shown` is the number of pictures that show such a marker."""

        def middle(values: list[float], unit: float = 1e3) -> str:
            return f"{unit * float(np.median(values)):7.2f}" if values else "      -"

        found = max(self.found, 1)
        return (
            f"{100 * self.found / shown:6.1f} {middle(self.sigma_along)} {middle(self.along_m)}"
            f" {middle(self.sigma_across)} {middle(self.across_m)}"
            f" {middle(self.sigma_tilt, 57.3)} {middle(self.tilt, 57.3)}"
            f" {middle(self.signed_m)} {100 * self.inside / found:5.0f}"
            f" {100 * self.flipped / found:5.1f}"
        )


class Beside(Observer):
    """An observer that gives each picture to modelled sight as well, and compares both."""

    def __init__(self, simulation: Simulation, loaded: Loaded, seed: int, table: "Table") -> None:
        """Prepare for a flight, and replace its renderer's `render`."""
        options = sim_options(loaded)
        layout, believed = simulation.layout, simulation.camera_model
        pad = printed(layout, options.pad, seed)
        lens = true_camera(believed, options.camera.calibration_error)
        sensitivity = Sensitivity(options.render, options.camera, options.pad)
        self._numbered = NumberedPictures(lens, layout.plate, sensitivity)
        self._world = WorldView(pad, lens, options)
        detectors = ModelledDetectors(layout, pad, believed, lens, options, self._numbered, seed)
        self._vision = Vision(layout, believed, loaded.config.vision, detectors=detectors)
        self._layout, self._focal, self._table = layout, believed.fx, table
        self._newest: dict[int, Image] = {}
        pictures = simulation.camera.pictures
        render = pictures.render

        def both(seq: int, *args: Any) -> Image:
            self._newest = {seq: self._numbered.render(seq, *args)}
            return render(seq, *args)

        pictures.render = both  # type: ignore[method-assign, assignment]

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Compare what both saw in a picture."""
        image = self._newest.get(frame.seq)
        view: View | None = None if image is None else self._numbered.view_of(image)
        if image is None or view is None:
            return
        modelled = self._vision.process(Frame(frame.t, frame.seq, image), prior)
        for number, marker in enumerate(self._layout.markers):
            seen = self._world.seen(image, view, number)
            if seen is None or seen.shown.mean() < 0.5:
                continue
            slant = float(seen.pose.normal @ seen.pose.t) / float(np.linalg.norm(seen.pose.t))
            size = self._focal * size_m(marker) * slant / float(seen.pose.t[2])
            wanted = getattr(marker, "id", None)
            both = [
                next((m for m in s.markers if m.kind == marker.kind and m.id == wanted), None)
                for s in (sightings, modelled)
            ]
            self._table.add(marker.kind, size, float(seen.shown.mean()), both, seen)


class Table:
    """All comparisons, by kind of marker and bin of size."""

    def __init__(self) -> None:
        self.shown: dict[tuple[str, int], int] = defaultdict(int)
        self.cells: dict[tuple[str, int], tuple[Cell, Cell]] = defaultdict(lambda: (Cell(), Cell()))

    def add(
        self,
        kind: str,
        size: float,
        share: float,
        both: list[MarkerSighting | None],
        seen: Seen,
    ) -> None:
        """Add one marker in one picture.

        Args:
            kind: of the marker.
            size: in the image, at its narrowest, px.
            share: of its edges in the picture; markers that are cut are counted together.
            both: the sightings by vision and by modelled sight; None: not found.
            seen: the truth.
        """
        bins = SIZES_PX if share > 0.99 else ()
        name = kind if share > 0.99 else f"{kind} cut"
        key = name, sum(size >= s for s in bins)
        self.shown[key] += 1
        for cell, marker in zip(self.cells[key], both, strict=True):
            if marker is not None:
                cell.add(marker, seen)

    def show(self) -> None:
        """Print the table, with each row of vision above that of modelled sight."""
        head = "found%  s_along e_along mm s_acr e_acr s_tilt e_tilt deg  bias mm in95 flip%"
        print(f"{'':24}shown {head}")
        for key in sorted(self.shown):
            kind, size = key
            least = SIZES_PX[size - 1] if size else 0
            for name, cell in zip(("vision", "model"), self.cells[key], strict=True):
                print(
                    f"{kind:14} {least:4} {name:6} {self.shown[key]:5} {cell.line(self.shown[key])}"
                )


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=["stationary", "wind-8"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    table = Table()
    for scenario in args.scenarios:
        for seed in args.seeds:
            overlay = config_dir() / "scenarios" / f"{scenario}.yaml"
            loaded = read_configuration(
                config_dir() / "default.yaml", overlays=[overlay], overrides=args.set, seed=seed
            )
            simulation = Simulation(loaded, seed)
            simulation.daemon._observers += (Beside(simulation, loaded, seed, table),)
            run_virtual(simulation.run(longest_s=LONGEST_S))
    table.show()


if __name__ == "__main__":
    main()
