"""Exposure for the pad in the whole daemon: orders, their effect, and their replay."""

from pathlib import Path

from landerd.commands.replay import config_of
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.flightlog.reader import read_log
from landerd.flightlog.replay import replay, replay_vision
from landerd.messages import ExposureOrder, Sightings
from landerd.runtime.clock import run_virtual
from landerd.simulation.flight import Simulation
from tests.simulated import ABOVE, SEEN

OVERRIDES = (
    *ABOVE,
    SEEN,
    "camera.exposure=pad",
    "sim.render.illumination=3.2",  # the pad's white is 2.5 times over full scale
    "log.images=lossless",
    "log.every_nth=1",
    "log.keep_free_mb=0",
)


def test_a_pad_far_over_full_scale_is_unsaturated_within_a_second_and_the_orders_replay(
    tmp_path: Path,
) -> None:
    loaded = read_configuration(
        config_dir() / "default.yaml",
        overlays=[config_dir() / "scenarios" / "stationary.yaml"],
        overrides=OVERRIDES,
    )
    simulation = Simulation(loaded, 1, log=tmp_path / "a.mcap")
    run_virtual(simulation.run(longest_s=2.4))
    assert simulation.recorder is not None
    simulation.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    seen = [s.message for s in log.steps if isinstance(s.message, Sightings)]
    late = [s.light for s in seen if s.light is not None and s.t > seen[0].t + 1.0]
    assert late
    assert all(light.on_pad and 150.0 < light.level < 250.0 for light in late)
    orders = [c for s in log.steps for c in s.commands if isinstance(c, ExposureOrder)]
    assert 1 < len(orders) < 10
    config = config_of(log, [])[0]
    assert replay(log, config).comparison.identical
    vision = replay_vision(log, config)
    assert not isinstance(vision, str)
    assert vision.comparison.identical
