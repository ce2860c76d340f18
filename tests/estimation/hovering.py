"""What an estimator hears of a vehicle that hovers 5 m over a pad."""

import math
from collections.abc import Callable

from landerd.estimation.estimator import Estimator
from landerd.geometry import IDENTITY, matscale
from landerd.messages import (
    Attitude,
    GimbalState,
    LocalPosition,
    PoseSolution,
    Reference,
    Sightings,
)

BELOW = PoseSolution(
    position=(0.0, 0.0, 5.0),
    normal=(0.0, 0.0, 1.0),
    north=(0.0, -1.0, 0.0),
    covariance=matscale(IDENTITY, 1e-4),
    sigma_yaw=0.01,
    sigma_tilt=0.02,
    cost=1.0,
)
TELEMETRY: dict[str, Callable[[float], LocalPosition | Attitude | GimbalState]] = {
    "position": lambda t: LocalPosition(t, (0.0, 0.0, -5.0), (0.0, 0.0, 0.0)),
    "attitude": lambda t: Attitude(t, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)),
    "gimbal": lambda t: GimbalState(t, 0.0, math.radians(-90.0), 0.0, Reference.BODY),
}


def hear(estimator: Estimator, t: float, *sources: str) -> None:
    for source in sources or TELEMETRY:
        estimator.on_telemetry(TELEMETRY[source](t))


def shown(t: float, *solutions: PoseSolution) -> Sightings:
    return Sightings(t, 0, (), solutions)
