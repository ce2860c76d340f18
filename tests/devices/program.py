"""landerd, with a camera that gets its pictures from `tests.devices.outside`."""

from typing import cast

from landerd.cli import entry_point
from landerd.drivers import DRIVERS, Driver

if __name__ == "__main__":
    cameras = cast(dict[str, Driver], DRIVERS["camera"])
    module = "tests.devices.outside"
    cameras["sim"] = Driver(f"{module}:SocketCamera", f"{module}:SocketCameraOptions")
    entry_point()
