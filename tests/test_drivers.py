"""Every line of the table leads to a driver with what landerd.ports asks of it."""

from pathlib import Path

import pytest

from hw.autopilots.mavlink import MavlinkAutopilot
from landerd.config.files import Loaded, config_dir
from landerd.devices import SetUpError, make_devices
from landerd.drivers import (
    DRIVERS,
    Driver,
    gimbal_speaks_over,
    import_named,
    options_models,
    read_configuration,
)
from landerd.ports import AutopilotFactory, CameraOptions, GimbalOptions, LinkOptions

AUTOPILOT: AutopilotFactory = MavlinkAutopilot  # checked by mypy

ALL = [
    pytest.param(section, name, driver, id=f"{section}.{name}")
    for section, drivers in DRIVERS.items()
    for name, driver in drivers.items()
]


@pytest.mark.parametrize(("section", "name", "driver"), ALL)
def test_every_drivers_factory_model_and_options_exist(
    section: str, name: str, driver: Driver
) -> None:
    for path in (driver.factory, driver.model):
        assert path is None or callable(import_named(path))
    assert (driver.options is not None) == (f"{section}.{name}" in options_models())


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (("exposure=pad", "driver=gstreamer"), "camera.exposure: .*gstreamer cannot be ordered"),
        (
            ("exposure=auto", "driver=v4l2", "v4l2.exposure_s=0.004"),
            "camera.exposure: auto, but camera.v4l2.exposure_s is set; expected null",
        ),
    ],
)
def test_an_exposure_that_a_camera_does_not_have_is_refused(
    overrides: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    with pytest.raises(SetUpError, match=said):
        make_devices(with_camera(*overrides), tmp_path / "overlay.yaml")


@pytest.mark.parametrize("driver", ["v4l2", "gstreamer", "picamera2"])
def test_every_camera_driver_may_be_left_to_its_automatic_exposure(
    driver: str, tmp_path: Path
) -> None:
    make_devices(with_camera("exposure=auto", f"driver={driver}"), tmp_path / "overlay.yaml")


def with_camera(*overrides: str) -> Loaded:
    return read_configuration(
        config_dir() / "default.yaml",
        overrides=[
            *(f"camera.{o}" for o in overrides),
            "gimbal.driver=fixed",
            "autopilot.url=udpin:127.0.0.1:14999",
        ],
    )


@pytest.mark.parametrize(("section", "name", "driver"), ALL)
def test_options_have_what_devices_are_made_of(section: str, name: str, driver: Driver) -> None:
    if driver.options is None:
        return
    options = options_models()[f"{section}.{name}"]()
    kind = {"camera": CameraOptions, "gimbal": GimbalOptions}[section]
    assert isinstance(options, kind)
    if section == "gimbal" and gimbal_speaks_over(name) == "link":
        assert isinstance(options, LinkOptions)
