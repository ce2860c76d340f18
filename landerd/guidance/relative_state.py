"""The pad relative to the vehicle in one control step: what every controller works on."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import (
    Vec3,
    dot,
    horizontal,
    horizontal_sigma,
    norm,
    sub,
    wrap,
)

# Distance from the landing point up to which the pad's tilt counts in the height, m. The plane of a
# pad tilted by 10 degrees lies 5 m lower 30 m away: there a vehicle took itself to be in the
# descent region.
PAD_REACH_M = 1.0
# 1 sigma of the pad's heave at which half of it is fed forward, m/s; by trial in the simulator.
HALF_KNOWN_HEAVE_MPS = 0.15
# 1 sigma of the camera's place on the airframe, measured with a tape, m. The filter cannot find
# this error: it is the same in every sighting.
CAMERA_PLACE_SIGMA_M = 0.01


@dataclass  # not frozen, though nobody changes one: that takes a third of the time to make
class RelativeState:
    """The pad relative to the vehicle; an error is pad minus vehicle.

    The log records these fields under these names.

    Attributes:
        distance: planar distance d_p (thesis 2.4.5), m.
        height: of the feet over the pad's plane, m; that is level beyond PAD_REACH_M.
    """

    error: Vec3  # landing point minus centre of the feet, local NED, m
    error_rate: Vec3  # pad's velocity minus vehicle's, m/s
    pad_velocity: Vec3  # local NED, m/s
    sigma_m: float  # of the error's horizontal part, m
    heading_error: float | None  # pad's heading minus vehicle's, rad; None: not known
    yaw_rate: float  # vehicle's, rad/s
    pad_turn_rate: float = 0.0  # of its heading, rad/s
    pad_coupling: float = 1.0  # share of that rate at which its velocity turns: 0 to 1
    sigma_heave: float = 0.0  # of the pad's vertical velocity, m/s
    sigma_velocity: float = 0.0  # of its horizontal velocity, m/s
    normal: Vec3 = (0.0, 0.0, 1.0)  # unit vector into the pad, local NED
    sigma_height: float = 0.0  # of the error's vertical part, m

    def __post_init__(self) -> None:
        self.distance = horizontal(self.error)
        north, east, down = self.error
        k = PAD_REACH_M / max(self.distance, PAD_REACH_M)
        self.height = dot((k * north, k * east, down), self.normal)

    @classmethod
    def between(
        cls, vehicle: VehicleState, pad: PadEstimate, sigma_bearing: float
    ) -> "RelativeState":
        """Return pad relative to vehicle, both at the same time.

        Args:
            vehicle: now.
            pad: now.
            sigma_bearing: of the lens's direction, rad. How well the filter knows that error
                depends on the path flown; guidance therefore counts all of it.
        """
        c = pad.covariance
        error = sub(pad.position, vehicle.feet)
        return cls(
            error=error,
            error_rate=sub(pad.velocity, vehicle.velocity),
            pad_velocity=pad.velocity,
            sigma_m=math.hypot(
                horizontal_sigma(c), sigma_bearing * norm(error), CAMERA_PLACE_SIGMA_M
            ),
            heading_error=wrap(pad.heading - vehicle.yaw) if pad.heading is not None else None,
            yaw_rate=vehicle.yaw_rate,
            pad_turn_rate=pad.turn_rate,
            pad_coupling=pad.coupling,
            sigma_heave=pad.sigma_heave,
            sigma_velocity=pad.sigma_velocity,
            normal=pad.normal,
            sigma_height=math.hypot(
                math.sqrt(max(c[2][2], 0.0)), sigma_bearing * horizontal(error)
            ),
        )

    @property
    def vehicle_velocity(self) -> Vec3:
        """Velocity of the vehicle, local NED, m/s."""
        return sub(self.pad_velocity, self.error_rate)

    @property
    def least_height(self) -> float:
        """Height of the feet over the pad minus 2 sigma, m."""
        return self.height - 2.0 * self.sigma_height

    @property
    def heave(self) -> float:
        """Vertical velocity of the pad to feed forward, m/s: the less of it, the less certain."""
        return self.pad_velocity[2] / (1.0 + (self.sigma_heave / HALF_KNOWN_HEAVE_MPS) ** 2)

    @property
    def sure_heave(self) -> float:
        """Vertical velocity of the pad minus 2 sigma, m/s: it sinks no slower than this."""
        return self.pad_velocity[2] - 2.0 * self.sigma_heave

    @property
    def course_rate(self) -> float:
        """Turn rate of the pad's velocity vector, rad/s."""
        return self.pad_coupling * self.pad_turn_rate


class Sight(NamedTuple):
    """The pad in sight in one control step, of a vehicle whose own data are fresh."""

    relative: RelativeState
    age: float  # since the exposure of the last accepted sighting, s
    heading: float | None  # of the pad, local, rad; None: not known
    down: Vec3  # the airframe's down axis, local
    pad_down: float  # local z of the landing point, m
    # The autopilot's height contradicts its climb rate: it does not fly the ordered vertical
    # velocity then, and a standing pad seems to rise or to sink.
    climb_rate_is_wrong: bool
