"""What the chosen gimbal's driver states, taken into the configuration."""

import math

from landerd.config.models import Config
from landerd.ports import GimbalTraits


def within_reach(config: Config, traits: GimbalTraits) -> tuple[Config, list[str]]:
    """Return the configuration cut to what the gimbal reaches, and a line for each cut.

    Angles that nobody measures count as less certain, too (`estimation.gimbal_sigma_deg`).

    Args:
        config: the configuration.
        traits: what the driver states.

    Raises:
        ValueError: a range that is wanted and the gimbal's have nothing in common.
    """
    driver = config.gimbal.driver
    cut, lines = {}, []
    for axis, reach in (("yaw", traits.yaw_limits), ("pitch", traits.pitch_limits)):
        key = f"{axis}_limits_deg"
        wanted = getattr(config.gimbal, key)
        low, high = (round(math.degrees(limit), 3) for limit in reach)
        cut[key] = limits = (max(wanted[0], low), min(wanted[1], high))
        reaches = f"{driver} reaches {low:g} to {high:g}"
        if limits[0] > limits[1]:
            raise ValueError(f"gimbal.{key}: found {wanted[0]:g} to {wanted[1]:g}, but {reaches}")
        if limits != wanted and low < high:  # an axis that does not turn needs no telling
            lines.append(f"gimbal.{key}: {wanted[0]:g} to {wanted[1]:g} is cut: {reaches}")
    sigma_deg = max(config.estimation.gimbal_sigma_deg, math.degrees(traits.sigma))
    gimbal = config.gimbal.model_copy(update=cut)
    estimation = config.estimation.model_copy(update={"gimbal_sigma_deg": sigma_deg})
    return config.model_copy(update={"gimbal": gimbal, "estimation": estimation}), lines
