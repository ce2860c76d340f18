"""landerd, with a camera that gets its pictures from `tests.devices.outside`."""

import sys
from typing import cast

from landerd import devices as registry
from landerd.cli import main

if __name__ == "__main__":
    cameras = cast(dict[str, registry.Driver], registry.DRIVERS["camera"])
    cameras["sim"] = registry.Driver("tests.devices.outside:SocketCamera")
    sys.exit(main())
