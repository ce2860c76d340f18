"""The kernel's test devices in the virtual machine, plugged in as a cable would be."""

from pathlib import Path

from landerd.config.files import Loaded
from landerd.drivers import read_configuration
from tests.devices.bench import sh, wait_for

CAMERA = "/dev/video0"
AUTOPILOT, GIMBAL = "/dev/ttyACM0", "/dev/ttyACM1"


def configuration() -> Loaded:
    return read_configuration(Path("/etc/landerd/landerd.yaml"))


def load_module(command: str) -> None:
    said = sh(command)
    assert not said, said


def plug_in_camera() -> None:
    load_module("modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0 no_error_inj=0")
    wait_for(Path(CAMERA).exists, CAMERA)


def plug_in_serial() -> None:
    """Two USB serial ports; what is at their other ends is /dev/ttyGS0 and /dev/ttyGS1."""
    load_module("modprobe dummy_hcd && modprobe cdc_acm")
    load_module("modprobe g_serial n_ports=2 iManufacturer=ArduPilot iProduct=fakehawk")
    for path in (AUTOPILOT, GIMBAL, "/dev/ttyGS0", "/dev/ttyGS1"):
        wait_for(Path(path).exists, path)
