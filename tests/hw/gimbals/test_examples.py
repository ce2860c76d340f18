"""The example configurations of gimbals: each can be read, and names what its driver reaches."""

from pathlib import Path

import pytest

from landerd import devices as registry
from landerd.config.files import config_dir, load

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
    assert loaded.remarks == ()
    assert f"gimbal.{loaded.config.gimbal.driver}" in loaded.options


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 7
