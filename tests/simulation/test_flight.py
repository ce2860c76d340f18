"""How a simulated flight is put together: what the world and the core must not share."""

from pathlib import Path

import pytest

from hw.sim.picture.renderer import Renderer
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.simulation.flight import Simulation
from tests.simulated import ABOVE, fly


def simulation(*overrides: str) -> Simulation:
    loaded = read_configuration(
        config_dir() / "default.yaml",
        overlays=[config_dir() / "scenarios" / "stationary.yaml"],
        overrides=overrides,
    )
    return Simulation(loaded, seed=1)


def test_the_core_believes_the_calibration_and_the_world_has_its_own_lens() -> None:
    errors = "sim.camera.calibration_error={focal: 0.005, principal_px: [3.0, -2.0]}"
    flight = simulation(errors)
    believed = load_camera(flight.config.camera.calibration)
    assert flight.camera_model == believed
    assert isinstance(flight.camera.pictures, Renderer)
    for true in (flight._judge._frustum.camera, flight.camera.pictures._camera):
        assert true.fx == pytest.approx(1.005 * believed.fx)
        assert (true.cx, true.cy) == (believed.cx + 3.0, believed.cy - 2.0)


def test_judge_and_core_share_no_camera_object() -> None:
    flight = simulation()
    assert flight._judge._frustum.camera == flight.camera_model
    assert flight._judge._frustum.camera is not flight.camera_model


def test_flight_in_an_autopilots_mode_is_not_blamed_on_landerd_even_without_heartbeats() -> None:
    unheard = "{fault: heartbeat-lost, at: {phase: DESCENT}}"
    home = "{fault: mode-rtl, at: {phase: DESCENT, after_s: 0.5}}"
    flight = fly(overrides=[*ABOVE, f"sim.faults=[{unheard}, {home}]"], longest_s=8.0)
    assert flight.world.height > 5.0  # it climbs faster than landerd may
    assert flight.monitor.found == {}


def test_a_tag_larger_than_the_picture_is_followed_by_its_cells_and_counts_as_seen(
    tmp_path: Path,
) -> None:
    pad = tmp_path / "large.yaml"
    pad.write_text(
        "name: large\n"
        "markers:\n"
        "  - {kind: apriltag, dictionary: APRILTAG_36h11, id: 3, size_m: 0.8}\n"
        "plate: {north_m: 0.6, south_m: 0.6, east_m: 0.6, west_m: 0.6}\n"
    )
    flight = fly(overrides=[*ABOVE, f"pad.layout={pad}"])
    assert flight.score.landed
    assert flight.rules.broken == {}


@pytest.mark.parametrize("seed", [2, 5, 6])
def test_a_deck_that_slow_pictures_show_late_is_not_sunk_onto_too_fast(seed: int) -> None:
    late = [
        "sim.sight=modelled",
        "sim.pad.heave_m=0.3",
        "sim.pad.heave_hz=0.25",
        "sim.camera.latency_s=0.105",
        "sim.camera.clock_offset_s=-0.017",
        "sim.companion.vision_factor=4.67",
        "sim.companion.stall_s=0.05",
        "sim.companion.stall_every_s=2.3",
        "sim.render.defocus_px=1.6",
        "sim.response.delay_s=0.09",
        "sim.response.vertical_acceleration_mps2=1.27",
    ]
    flight = fly(overrides=late, seed=seed, longest_s=40.0)
    assert flight.score.landed
    assert flight.rules.broken == {}
