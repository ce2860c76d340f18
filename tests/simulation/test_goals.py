import pytest

from landerd.config.files import Loaded, config_dir, config_files
from landerd.drivers import read_configuration
from landerd.simulation.goals import simulate_part

pytestmark = pytest.mark.long


LOOKS_DOWN = ("sim.sight=modelled", "sim.camera.fps=15", "aim.idle_pitch_deg=-90")


def test_an_approach_ends_when_the_vehicle_has_stayed_near_the_pad_for_three_seconds() -> None:
    near = (*LOOKS_DOWN, "sim.start={altitude_m: 8, position_m: [-1, 0]}")
    result = simulate_part(_loaded(*near), "approach", "hover", 1)
    assert result["outcome"] == "reached"
    assert 3.0 <= result["time_s"] < 10.0
    assert result["energy_hj"] > 0.0
    assert result["touchdown_error_m"] is None


def test_a_turn_is_judged_by_the_heading_after_ten_seconds() -> None:
    turned = (*LOOKS_DOWN, "sim.start={altitude_m: 5, heading_deg: 90, heading_spread_deg: 0}")
    result = simulate_part(_loaded(*turned), "turn", "hover", 1)
    assert result["outcome"] == "reached"
    assert 2.0 < result["time_s"] < 8.0
    assert abs(result["yaw_error_deg"]) < 5.0


def test_a_vehicle_that_may_not_turn_misses_the_goal() -> None:
    held = (*LOOKS_DOWN, "guidance.method=pid", "guidance.pid.yaw={kp: 0, ki: 0, kd: 0}")
    start = "sim.start={altitude_m: 5, heading_deg: 90, heading_spread_deg: 0}"
    result = simulate_part(_loaded(*held, start), "turn", "hover", 1)
    assert not result["landed"]
    assert result["outcome"] == "turn not reached"
    assert result["time_s"] is None


def _loaded(*overrides: str) -> Loaded:
    path = config_dir() / "default.yaml"
    return read_configuration(
        path, overlays=[config_files("scenarios")["hover"]], overrides=overrides, seed=1
    )
