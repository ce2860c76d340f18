"""A bolted camera: nothing to talk to."""

from hw.gimbals.fixed import FixedGimbal, FixedOptions
from hw.sim.gimbals.bench import Bench, Connected


def connect(options: FixedOptions, bench: Bench) -> Connected:
    """Return the driver; the camera sits as far from where it should as the gimbal's bias says."""
    driver = FixedGimbal(options)
    (yaw, _), (pitch, _) = driver.traits.yaw_limits, driver.traits.pitch_limits
    plant = bench.mount.plant
    plant.yaw.bolt(yaw - bench.mount.yaw_bias)
    plant.pitch.bolt(pitch - bench.mount.pitch_bias)
    return driver, None
