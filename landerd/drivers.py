"""Which drivers there are: the one place that lists them. A new driver is one line in `DRIVERS`.

Drivers are named by their modules and imported when they are chosen, so that a driver whose
libraries this machine lacks is in nobody's way.
"""

from collections.abc import Collection, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Literal, NamedTuple

from landerd.config.files import Loaded, load
from landerd.section import Section

Carrier = Literal["link", "autopilot"]


class Driver(NamedTuple):
    """Where a driver is, as "module:name"."""

    factory: str | None  # None: the simulated world makes it
    options: str | None = None  # model of its block of the configuration, as camera.v4l2
    over: Carrier | None = None  # what it is handed to speak through
    model: str | None = None  # what connects it to a modelled device in the simulator


def _gimbal(driver: str, model: str, over: Carrier | None = None) -> Driver:
    """Return the driver at "module:Name" of hw.gimbals with its model of hw.sim.gimbals."""
    path = f"hw.gimbals.{driver}"
    return Driver(f"{path}Gimbal", f"{path}Options", over, f"hw.sim.gimbals.{model}")


DRIVERS: Mapping[str, Mapping[str, Driver]] = {
    "camera": {
        "v4l2": Driver("hw.cameras.v4l2:V4l2Camera", "hw.cameras.v4l2:V4l2Options"),
        "gstreamer": Driver(
            "hw.cameras.gstreamer:GstreamerCamera", "hw.cameras.gstreamer:GstreamerOptions"
        ),
        "picamera2": Driver(
            "hw.cameras.picamera2:Picamera2Camera", "hw.cameras.picamera2:Picamera2Options"
        ),
        "sim": Driver(None),
    },
    "gimbal": {
        "sim": Driver(None),
        "fixed": _gimbal("fixed:Fixed", "fixed:connect"),
        "mavlink": _gimbal("mavlink_v2:Mavlink", "mavlink:connect_v2", "autopilot"),
        "mavlink_mount": _gimbal(
            "mavlink_mount:MavlinkMount", "mavlink:connect_mount", "autopilot"
        ),
        "servo_mavlink": _gimbal(
            "servo_mavlink:ServoMavlink", "servo:connect_mavlink", "autopilot"
        ),
        "servo_pca9685": _gimbal("servo_pca9685:ServoPca9685", "servo:connect_pca9685"),
        "servo_sysfs": _gimbal("servo_sysfs:ServoSysfs", "servo:connect_sysfs"),
        "simplebgc": _gimbal("simplebgc:SimpleBgc", "simplebgc:connect", "link"),
        "siyi": _gimbal("siyi:Siyi", "siyi:connect", "link"),
        "storm32": _gimbal("storm32:Storm32", "storm32:connect", "link"),
    },
    "autopilot": {
        "mavlink": Driver("hw.autopilots.mavlink:MavlinkAutopilot"),
    },
}
SIMULATOR_OPTIONS = "hw.sim.options:SimOptions"


def names() -> Mapping[str, Collection[str]]:
    """Return the names of the drivers by section of the configuration."""
    return {section: drivers.keys() for section, drivers in DRIVERS.items()}


def options_models() -> Mapping[str, type[Section]]:
    """Return the models of all options by section: "sim", "camera.v4l2", ..."""
    models = {"sim": _options_model(SIMULATOR_OPTIONS)}
    for section, drivers in DRIVERS.items():
        for name, driver in drivers.items():
            if driver.options is not None:
                models[f"{section}.{name}"] = _options_model(driver.options)
    return models


def gimbal_speaks_over(name: str) -> Carrier | None:
    """Return what a gimbal's driver is handed to speak through.

    Raises:
        KeyError: there is no such driver.
    """
    return DRIVERS["gimbal"][name].over


def _options_model(path: str) -> type[Section]:
    model = import_named(path)
    assert isinstance(model, type)
    assert issubclass(model, Section)
    return model


def import_named(path: str) -> object:
    """Return what is named as "module:name"."""
    module, _, name = path.partition(":")
    found: object = getattr(import_module(module), name)
    return found


def read_configuration(
    path: Path, *, overlays: Sequence[Path] = (), overrides: Sequence[str] = (), seed: int = 0
) -> Loaded:
    """Read and check a configuration, with the options of all drivers and of the simulator.

    Args:
        path: the file.
        overlays: files laid over the first, as scenarios are.
        overrides: KEY=VALUE, the key dotted, the value in YAML.
        seed: of what the simulated world draws.

    Raises:
        ConfigError: it cannot be used; see `landerd.config.files.load`.
    """
    return load(
        path,
        options_models=options_models(),
        drivers=names(),
        overlays=overlays,
        overrides=overrides,
        seed=seed,
    )
