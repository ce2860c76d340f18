"""Pad and vehicle relative to each other, as the guidance sees them."""

import math

from landerd.geometry import Vec3
from landerd.guidance.relative_state import RelativeState


def situation(
    distance: float = 0.0,
    height: float = 10.0,
    *,
    error: Vec3 | None = None,
    rate: Vec3 = (0.0, 0.0, 0.0),
    heading_deg: float | None = 0.0,
    sigma_m: float = 0.0,
    yaw_rate: float = 0.0,
    pad_velocity: Vec3 = (0.0, 0.0, 0.0),
) -> RelativeState:
    """The pad `distance` to the north and `height` below the feet."""
    return RelativeState(
        error=error if error is not None else (distance, 0.0, height),
        error_rate=rate,
        pad_velocity=pad_velocity,
        sigma_m=sigma_m,
        heading_error=None if heading_deg is None else math.radians(heading_deg),
        yaw_rate=yaw_rate,
    )
