"""The example configurations of gimbals: each can be read, and names what its driver reaches."""

from pathlib import Path

import pytest

from hw import registry
from hw.gimbals.mounting import MountOptions
from hw.gimbals.servo import ServoOptions
from landerd.config_file import config_dir, load

EXAMPLES = sorted((config_dir() / "gimbals").glob("*.yaml"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example(example: Path) -> None:
    loaded = load(
        config_dir() / "default.yaml",
        options_models=registry.options_models(),
        drivers=registry.names(),
        overlays=[example],
        overrides=[],
    )
    gimbal = loaded.config.gimbal
    options = loaded.options[f"gimbal.{gimbal.driver}"]
    if isinstance(options, MountOptions):
        for ours, reached in (
            (gimbal.yaw_limits_deg, options.yaw_limits_deg),
            (gimbal.pitch_limits_deg, options.pitch_limits_deg),
        ):
            assert reached[0] <= ours[0] <= ours[1] <= reached[1]
    elif isinstance(options, ServoOptions):
        low, high = options.pitch.table[0][0], options.pitch.table[-1][0]
        assert low <= gimbal.pitch_limits_deg[0] <= gimbal.pitch_limits_deg[1] <= high
        assert (gimbal.yaw_limits_deg == (0.0, 0.0)) == (options.yaw is None)


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 7
