"""Adapts the configuration to the angle limits and the accuracy of the chosen gimbal."""

import math

from landerd.config.models import Config
from landerd.ports import GimbalTraits


def within_reach(config: Config, traits: GimbalTraits) -> tuple[Config, list[str]]:
    """Return the configuration with the gimbal's limits reduced to what the gimbal reaches.

    The standard deviation of its angles (`estimation.gimbal_sigma_deg`) is raised to the driver's,
    if that is larger: some gimbals do not measure their angles.

    Args:
        config: the configuration.
        traits: limits and accuracy of the gimbal, from its driver; angles in rad.

    Returns:
        The adapted configuration, and a line for each range that was reduced.

    Raises:
        ValueError: a configured range lies wholly outside the gimbal's.
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
        if limits != wanted and low < high:  # that an axis does not turn needs no remark
            lines.append(f"gimbal.{key}: {wanted[0]:g} to {wanted[1]:g} is cut: {reaches}")
    sigma_deg = max(config.estimation.gimbal_sigma_deg, math.degrees(traits.sigma))
    gimbal = config.gimbal.model_copy(update=cut)
    estimation = config.estimation.model_copy(update={"gimbal_sigma_deg": sigma_deg})
    return config.model_copy(update={"gimbal": gimbal, "estimation": estimation}), lines
