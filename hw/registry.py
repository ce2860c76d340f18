"""Which drivers there are: the one place that lists them. A new driver is one line here.

Drivers are named by their modules and imported when they are chosen, so that a driver whose
libraries this machine lacks is in nobody's way.
"""

from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from typing import Any, NamedTuple

from pydantic import BaseModel


class Driver(NamedTuple):
    """Where a driver is, as "module:name"."""

    factory: str | None  # None: the simulated world makes it
    options: str | None = None  # model of its block of the configuration, as camera.v4l2


DRIVERS: Mapping[str, Mapping[str, Driver]] = {
    "camera": {
        "v4l2": Driver("hw.cameras.v4l2:V4l2Camera", "hw.cameras.v4l2:V4l2Options"),
        "sim": Driver(None),
    },
    "gimbal": {
        "sim": Driver(None),
    },
    "autopilot": {
        "mavlink": Driver("hw.autopilots.mavlink:MavlinkAutopilot"),
    },
}
SIMULATOR_OPTIONS = "hw.sim.options:SimOptions"


def names() -> Mapping[str, Collection[str]]:
    """Return the names of the drivers by section of the configuration."""
    return {section: drivers.keys() for section, drivers in DRIVERS.items()}


def options_models() -> Mapping[str, type[BaseModel]]:
    """Return the models of all options by section: "sim", "camera.v4l2", ..."""
    models: dict[str, type[BaseModel]] = {"sim": _import(SIMULATOR_OPTIONS)}
    for section, drivers in DRIVERS.items():
        for name, driver in drivers.items():
            if driver.options is not None:
                models[f"{section}.{name}"] = _import(driver.options)
    return models


def factory(section: str, name: str) -> Callable[..., Any] | None:
    """Return what makes the device; None for one that only the simulated world has.

    Raises:
        KeyError: there is no such driver.
    """
    path = DRIVERS[section][name].factory
    return None if path is None else _import(path)


def _import(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
