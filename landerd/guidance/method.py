"""The landing controllers to choose from."""

from typing import Protocol

from landerd.config.models import Config
from landerd.geometry import Vec3
from landerd.guidance.pid_method import PidMethod
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.tracking_method import TrackingMethod
from landerd.messages import Phase


class Method(Protocol):
    """Turns the relative state into velocities; guidance.limits keeps them within the limits."""

    def configure(self, config: Config) -> None:
        """Take new gains and limits, also those that the autopilot has reported of itself."""

    def restart(self) -> None:
        """Begin a landing."""

    def step(
        self,
        phase: Phase,
        relative: RelativeState,
        floor_m: float,
        dt: float,
        *,
        widening: float = 1.0,
    ) -> tuple[Vec3, float]:
        """Return velocity (local NED, m/s) and yaw rate (rad/s).

        Args:
            phase: of the landing.
            relative: pad relative to vehicle.
            floor_m: height over the pad to come down to, m.
            dt: time since the last step, s.
            widening: factor on the descent region's radius.
        """


def make_method(config: Config) -> Method:
    """Return the configured controller."""
    tracks = config.guidance.method == "tracking"
    return TrackingMethod(config) if tracks else PidMethod(config)
