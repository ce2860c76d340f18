"""Modelled sight: flights without pictures, and what is seen in them against the truth."""

import asyncio
import math
from functools import cache

import numpy as np
import pytest

from hw.sim.picture.numbered import NumberedPictures
from landerd.devices import sim_options
from landerd.messages import Frame, Prior, Sightings
from landerd.runtime.clock import run_virtual
from landerd.runtime.observer import Observer
from landerd.simulation.flight import Simulation
from landerd.simulation.sight.world_view import WorldView
from tests.simulated import ABOVE, Script, configured

pytestmark = pytest.mark.long

OPTIONS = sim_options(configured(()))  # of the true print and lens, without errors
CHI2_95 = 7.815  # three degrees of freedom


def numbered(simulation: Simulation) -> NumberedPictures:
    pictures = simulation.camera.pictures
    assert isinstance(pictures, NumberedPictures)
    return pictures


class Watcher(Observer):
    """Keeps what was seen, with the frames."""

    def __init__(self) -> None:
        self.frames: list[tuple[Frame, Sightings]] = []

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        self.frames.append((frame, sightings))


def watched(
    *overrides: str, longest_s: float = 30.0, script: Script | None = None, seed: int = 1
) -> tuple[Simulation, Watcher]:
    """Fly with modelled sight; return the flight and what was seen."""
    loaded = configured((*ABOVE, *overrides))
    simulation, watcher = Simulation(loaded, seed), Watcher()
    simulation.daemon._observers += (watcher,)
    run_virtual(simulation.run(longest_s=longest_s, script=script))
    return simulation, watcher


def test_a_flight_without_pictures_lands_and_is_the_same_to_the_bit_again() -> None:
    first, again = watched()[0], watched(longest_s=4.0)[0]
    assert first.score.contact is not None
    assert first.flown().lander.outcome == "landed"
    assert not first.rules.broken
    samples, nis = again.recording.samples, again.recording.nis
    assert len(samples) > 30
    assert len(nis) > 50
    assert first.recording.samples[: len(samples)] == samples
    assert first.recording.nis[: len(nis)] == nis


def test_no_picture_of_the_scene_is_made() -> None:
    simulation, _ = watched(longest_s=2.0)
    assert numbered(simulation)
    assert not simulation.recording.views


@cache
def from_six_metres() -> tuple[Simulation, Watcher]:
    return watched("sim.start.altitude_m=6.0", longest_s=9.0)


@pytest.mark.parametrize("kind", ["whycon", "apriltag"])
def test_errors_lie_within_the_stated_ones(kind: str) -> None:
    simulation, watcher = from_six_metres()
    truth = WorldView(simulation.layout, simulation.camera_model, OPTIONS)
    number = [m.kind for m in simulation.layout.markers].index(kind)  # type: ignore[arg-type]
    inside = []
    for frame, sightings in watcher.frames:
        view = numbered(simulation).view_of(frame.image)
        seen = None if view is None else truth.seen(frame.image, view, number)
        for marker in sightings.markers:
            if marker.kind == kind and seen is not None:
                error = np.array(marker.solutions[0].position) - seen.pose.t
                square = error @ np.linalg.solve(np.array(marker.solutions[0].covariance), error)
                inside.append(float(square) < CHI2_95)
    assert len(inside) > 40
    assert 0.85 < np.mean(inside) <= 1.0


def test_a_covered_pad_is_not_seen() -> None:
    async def cover(simulation: Simulation) -> None:
        await asyncio.sleep(1.0)
        simulation.camera.faults.pad_covered = True

    _, watcher = watched(longest_s=3.0, script=cover)
    assert any(s.markers for f, s in watcher.frames if f.t < 0.9)
    assert not any(s.markers for f, s in watcher.frames if f.t > 1.1)


def test_with_modelled_sight_black_areas_of_a_picture_hide_markers() -> None:
    simulation, watcher = watched(longest_s=2.0)
    frame, sightings = watcher.frames[-1]
    assert sightings.pad
    detectors = simulation.daemon._detectors
    assert detectors is not None
    black = np.zeros_like(frame.image)
    assert detectors.find_rings(black, simulation.layout.rings[0]) == []
    hidden = frame.image.copy()
    outline = np.array(sightings.markers[0].outline_px)
    (x0, y0), (x1, y1) = np.clip(outline.min(axis=0), 0, None), outline.max(axis=0)
    hidden[int(y0) : int(y1) + 1, int(x0) : int(0.5 * (x0 + x1)) + 1] = 0
    for marker in simulation.layout.rings:
        assert detectors.find_rings(hidden, marker) == []


@pytest.mark.parametrize(
    ("error", "farther"),
    [("sim.camera.calibration_error={focal: 0.02}", -0.02), ("sim.pad.print_scale=1.03", -0.03)],
)
def test_lens_and_print_act_as_in_pictures(error: str, farther: float) -> None:
    """What looks larger than the file says seems so much nearer."""
    simulation, watcher = watched(error, longest_s=2.5)
    truth = WorldView(simulation.layout, simulation.camera_model, OPTIONS)
    ratios = []
    for frame, sightings in watcher.frames:
        view = numbered(simulation).view_of(frame.image)
        for marker in sightings.markers:
            seen = None if view is None else truth.seen(frame.image, view, 0)
            if marker.kind == "whycon" and seen is not None:
                ratios.append(
                    math.hypot(*marker.solutions[0].position) / float(np.linalg.norm(seen.pose.t))
                )
    assert len(ratios) > 5
    assert np.median(ratios) - 1.0 == pytest.approx(farther, abs=0.006)


def test_frozen_pictures_are_noticed() -> None:
    async def freeze(simulation: Simulation) -> None:
        await asyncio.sleep(1.5)
        simulation.camera.faults.frozen_fresh = True

    simulation, _ = watched(longest_s=3.0, script=freeze)
    assert simulation.daemon.faults["camera repeats itself"] > 10
