"""Every line of the table leads to a driver with what landerd.ports asks of it."""

import pytest

from hw.autopilots.mavlink import MavlinkAutopilot
from landerd.drivers import DRIVERS, Driver, gimbal_speaks_over, import_named, options_models
from landerd.ports import AutopilotFactory, CameraOptions, GimbalOptions, LinkOptions

AUTOPILOT: AutopilotFactory = MavlinkAutopilot  # checked by mypy

ALL = [
    pytest.param(section, name, driver, id=f"{section}.{name}")
    for section, drivers in DRIVERS.items()
    for name, driver in drivers.items()
]


@pytest.mark.parametrize(("section", "name", "driver"), ALL)
def test_what_a_driver_names_is_there(section: str, name: str, driver: Driver) -> None:
    for path in (driver.factory, driver.model):
        assert path is None or callable(import_named(path))
    assert (driver.options is not None) == (f"{section}.{name}" in options_models())


@pytest.mark.parametrize(("section", "name", "driver"), ALL)
def test_options_have_what_devices_are_made_of(section: str, name: str, driver: Driver) -> None:
    if driver.options is None:
        return
    options = options_models()[f"{section}.{name}"]()
    kind = {"camera": CameraOptions, "gimbal": GimbalOptions}[section]
    assert isinstance(options, kind)
    if section == "gimbal" and gimbal_speaks_over(name) == "link":
        assert isinstance(options, LinkOptions)
