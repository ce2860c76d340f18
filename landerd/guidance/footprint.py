"""Where the feet are on the pad's plate: whether the vehicle will stand, and stood, on it."""

import math

from landerd.config.models import VehicleSection
from landerd.geometry import Vec3, clamp
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.touchdown import MAX_TILT
from landerd.pad import Plate

SLOWEST_SINK_MPS = 0.1  # at least so fast it is taken to sink, to tell where it will touch
RATE_S = 0.5  # over which it is told how fast the feet move across the plate

# In steady flight the airframe hangs along what wind and weight come to: its angle to the plate's
# normal is that at which they pull on the gear once it stands. Half of the weight is carried by the
# thrust that ArduCopter steers with until it is levelled: rubber (friction 1) slides from 26
# degrees on then. Flown on days of the field world without this limit: 42 of 52 of 24 to 27 degrees
# stood, 10 of 25 of 27 to 31; the others slid off the plate or tipped over.
MAX_LEAN = math.radians(27.0)
# That holds for gears whose half width is at least so much of their height, as the thesis's (0.26
# m wide, 0.20 m high). One as high as wide tips over first, in a gust after the touch: with 21
# degrees allowed, in 8 m/s, 7 of 12 did so or slid off, with 17 degrees, in 6 m/s, 2 of 8. It and
# what is narrower still touches only where half of the weight alone holds it.
SLIDES_FIRST, TIPS_FIRST = 0.64, 0.5
# The lowest foot hangs so far down at most, of the commit height, under the feet's middle: lower it
# would touch before it is committed, and nothing looks for that.
HANGS_SHARE = 0.85


def most_lean(vehicle: VehicleSection, commit_height_m: float) -> float:
    """Return the lean against the plate with which the vehicle may touch and still stand, rad.

    Args:
        vehicle: its gear; the middle of its mass is taken to be the autopilot's.
        commit_height_m: from where on a touch is looked for.
    """
    footprint_m, gear_height_m = vehicle.footprint_m, vehicle.gear_height_m
    hangs = math.atan2(HANGS_SHARE * commit_height_m, 0.5 * math.hypot(*footprint_m))
    half_m = 0.5 * min(footprint_m)
    tips = math.atan2(0.5 * half_m, gear_height_m)
    if half_m >= SLIDES_FIRST * gear_height_m:
        tips = MAX_LEAN
    elif half_m > TIPS_FIRST * gear_height_m:
        wide = (half_m / gear_height_m - TIPS_FIRST) / (SLIDES_FIRST - TIPS_FIRST)
        tips += wide * (MAX_LEAN - tips)
    return min(MAX_LEAN, tips, hangs)


class Footprint:
    """The feet and the plate; where they stand is followed from contact on.

    In the air the circle through the feet is to fit onto the plate: that leaves room for errors.
    """

    def __init__(self, plate: Plate, footprint_m: tuple[float, float]) -> None:
        """Make one for a plate and the distances between the feet along x and y, m."""
        self._reach_m = 0.5 * math.hypot(*footprint_m)
        self._half_m = 0.5 * footprint_m[0], 0.5 * footprint_m[1]
        # Edges in the pad frame; north and east positive.
        self._north = (-plate.south_m, plate.north_m)
        self._east = (-plate.west_m, plate.east_m)
        self._offset = (0.0, 0.0)  # of the feet's centre from the landing point, local, m
        self._heading: float | None = None
        self._yaw: float | None = None  # of the vehicle, local, rad; None: not followed yet
        self._feet: tuple[float, Vec3] | None = None  # when it was last followed, s; local, m
        self._rate = (0.0, 0.0)  # of the offset in the last RATE_S, m/s
        self._followed_s = 0.0  # since contact
        self._sigma_mps = 0.0  # of the pad's velocity

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
        self._feet = self._yaw = None
        self._rate, self._followed_s = (0.0, 0.0), 0.0
        self._sigma_mps = relative.sigma_velocity

    def see(self, to_pad: Vec3, heading: float | None) -> None:
        """Take where the landing point is seen from the feet (local, m): they stand there.

        The pad's heading (local, rad) may have turned since the touch; None: it is not known.
        """
        self._offset = (-to_pad[0], -to_pad[1])
        self._heading = self._heading if heading is None else heading
        self._rate, self._followed_s = (0.0, 0.0), 0.0

    def slide(
        self, now: float, feet: Vec3, yaw: float, pad_velocity: Vec3, *, stands: bool = False
    ) -> None:
        """Follow the feet across the plate since it was called last, however long ago that is.

        Args:
            now: s.
            feet: their centre, local, m; by positions, as a velocity may be off by a constant.
            yaw: of the vehicle, local, rad.
            pad_velocity: as last seen, local, m/s.
            stands: they have not moved across it since.
        """
        last, self._feet, self._yaw = self._feet, (now, feet), yaw
        if last is None or now <= last[0] or stands:
            return
        dt, (north, east, _) = now - last[0], last[1]
        step = (
            feet[0] - north - dt * pad_velocity[0],
            feet[1] - east - dt * pad_velocity[1],
        )
        self._offset = (self._offset[0] + step[0], self._offset[1] + step[1])
        (north, east), k = self._rate, min(1.0, dt / RATE_S)
        self._rate = (north + k * (step[0] / dt - north), east + k * (step[1] / dt - east))
        self._followed_s += dt

    @property
    def on_plate(self) -> bool:
        """Whether all feet are on the plate, as last known.

        A pad's velocity that was seen a little wrong looks like a slide that never ends; one that
        its uncertainty explains was none.
        """
        speed = math.hypot(*self._rate)
        k = min(1.0, 2.0 * self._sigma_mps / speed) if speed > 0.0 else 0.0
        north, east = self._offset
        gone = k * self._followed_s
        offset = (north - gone * self._rate[0], east - gone * self._rate[1])
        return self._holds(offset, self._heading, self._yaw)

    def _holds(
        self, offset: tuple[float, float], heading: float | None, yaw: float | None = None
    ) -> bool:
        """Tell whether the feet fit onto the plate there; a circle through them without yaw."""
        north, east = offset
        if heading is None:  # the plate may lie any way round: what fits then always fits
            away = math.hypot(north, east)
            nearest = min(-self._north[0], self._north[1], -self._east[0], self._east[1])
            return away + self._reach_m <= nearest
        c, s = math.cos(heading), math.sin(heading)
        x, y = c * north + s * east, c * east - s * north
        ahead = aside = self._reach_m
        if yaw is not None:
            (along, across), turn = self._half_m, yaw - heading
            c, s = abs(math.cos(turn)), abs(math.sin(turn))
            ahead, aside = c * along + s * across, s * along + c * across
        return (
            self._north[0] + ahead <= x <= self._north[1] - ahead
            and self._east[0] + aside <= y <= self._east[1] - aside
        )
