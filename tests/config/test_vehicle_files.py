"""The commented examples in config/vehicles must be sound, and the drivers they name made."""

from pathlib import Path

import pytest

from landerd.config.files import config_dir
from landerd.devices import fitting_camera, make_devices
from landerd.drivers import read_configuration
from landerd.pad import load_pad

FILES = sorted((config_dir() / "vehicles").glob("*.yaml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_example_is_sound_and_its_devices_can_be_made(path: Path, tmp_path: Path) -> None:
    loaded = read_configuration(path)
    camera = fitting_camera(loaded)
    driver = loaded.config.camera.driver
    options = loaded.options[f"camera.{driver}"]
    assert (camera.width, camera.height) == (options.width, options.height)  # type: ignore[attr-defined]
    assert load_pad(loaded.config.pad.layout).markers
    devices = make_devices(loaded, tmp_path / "saved.yaml")
    assert not type(devices.camera).__module__.startswith("hw.sim")
    assert not type(devices.gimbal).__module__.startswith("hw.sim")


def test_every_board_that_install_knows_has_an_example_configuration() -> None:
    assert {path.stem for path in FILES} >= {"pixhawk-usb", "pixhawk-uart", "jetson", "navio2"}
