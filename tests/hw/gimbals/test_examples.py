"""The example configurations of gimbals: each can be read, and names what its driver reaches."""

from pathlib import Path

import pytest

from landerd.config.files import config_dir
from landerd.drivers import read_configuration

EXAMPLES = sorted((config_dir() / "gimbals").glob("*.yaml"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_of_a_gimbal_can_be_read_and_has_no_remarks(example: Path) -> None:
    loaded = read_configuration(config_dir() / "default.yaml", overlays=[example], overrides=[])
    assert loaded.remarks == ()
    assert f"gimbal.{loaded.config.gimbal.driver}" in loaded.options


def test_examples_of_gimbals_are_found() -> None:
    assert len(EXAMPLES) >= 7
