"""Where the feet are on the pad's plate: whether the vehicle will stand, and stood, on it."""

import math

from landerd.geometry import Vec3, clamp
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.touchdown import MAX_TILT
from landerd.pad import Plate

SLOWEST_SINK_MPS = 0.1  # at least so fast it is taken to sink, to tell where it will touch


class Foothold:
    """The feet's circle and the plate; where it stood is followed from contact on."""

    def __init__(self, plate: Plate, footprint_m: tuple[float, float]) -> None:
        """Make one for a plate and the distances between the feet along x and y, m."""
        self._reach_m = 0.5 * math.hypot(*footprint_m)
        # Edges in the pad frame; north and east positive.
        self._north = (-plate.south_m, plate.north_m)
        self._east = (-plate.west_m, plate.east_m)
        self._offset = (0.0, 0.0)  # of the feet's centre from the landing point, local, m
        self._heading: float | None = None

    def will_miss(
        self, relative: RelativeState, heading: float | None, sink_rate: float, tolerance_m: float
    ) -> bool:
        """Tell whether a foot will touch beside the plate.

        Args:
            relative: pad relative to the vehicle.
            heading: of the pad, local, rad; None: not known.
            sink_rate: m/s, against the pad.
            tolerance_m: from the landing point, within which no plate is too small.
        """
        t = max(0.0, relative.height) / max(sink_rate, SLOWEST_SINK_MPS)
        (north, east, _), (v_north, v_east, _) = relative.error, relative.error_rate
        offset = (-north - t * v_north, -east - t * v_east)
        return math.hypot(*offset) > tolerance_m and not self._holds(offset, heading)

    def clearance(self, relative: RelativeState, tilt: float) -> float:
        """Return the height (m) of the lowest foot over the plate, were it tilted the worst way.

        Args:
            relative: pad relative to the vehicle.
            tilt: of the airframe from level, rad.
        """
        plate = math.acos(clamp(relative.normal[2], -1.0, 1.0))
        return relative.height - self._reach_m * math.tan(min(tilt + plate, MAX_TILT))

    def touch(self, relative: RelativeState, heading: float | None) -> None:
        """Note where it touches."""
        self._offset = (-relative.error[0], -relative.error[1])
        self._heading = heading

    def slide(self, velocity: Vec3, pad_velocity: Vec3, dt: float) -> None:
        """Follow the vehicle across the plate for dt (s), both velocities local, m/s."""
        north, east = self._offset
        self._offset = (
            north + dt * (velocity[0] - pad_velocity[0]),
            east + dt * (velocity[1] - pad_velocity[1]),
        )

    @property
    def on_plate(self) -> bool:
        """Whether all feet are on the plate, as last known."""
        return self._holds(self._offset, self._heading)

    def _holds(self, offset: tuple[float, float], heading: float | None) -> bool:
        """Tell whether a circle through the feet fits onto the plate there."""
        north, east = offset
        if heading is None:  # the plate may lie any way round: what fits then always fits
            away = math.hypot(north, east)
            nearest = min(-self._north[0], self._north[1], -self._east[0], self._east[1])
            return away + self._reach_m <= nearest
        c, s = math.cos(heading), math.sin(heading)
        x, y = c * north + s * east, c * east - s * north
        reach = self._reach_m
        return (
            self._north[0] + reach <= x <= self._north[1] - reach
            and self._east[0] + reach <= y <= self._east[1] - reach
        )
