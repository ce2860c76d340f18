"""A bolted camera: nothing to talk to."""

from hw.gimbals.fixed import FixedGimbal, FixedOptions
from hw.sim.gimbals.bench import Bench, Connected


def connect(options: FixedOptions, bench: Bench) -> Connected:
    """Return the driver; the camera sits as far from where it should as the gimbal's bias says."""
    driver = FixedGimbal(options)
    bench.mount.bolt(driver.traits.yaw_limits[0], driver.traits.pitch_limits[0])
    return driver, None
