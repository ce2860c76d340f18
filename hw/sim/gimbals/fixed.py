"""A camera that is bolted on: there is no device to talk to."""

from hw.gimbals.fixed import FixedGimbal, FixedOptions
from hw.sim.gimbals.bench import Bench, Connected


def connect(options: FixedOptions, bench: Bench) -> Connected:
    """Return the driver; the camera's true angles are off by the simulated gimbal's bias."""
    driver = FixedGimbal(options)
    bench.mount.bolt(driver.traits.yaw_limits[0], driver.traits.pitch_limits[0])
    return driver, None
