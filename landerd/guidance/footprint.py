"""Where the feet are on the pad's plate: whether the vehicle will stand, and stood, on it."""

import math

from landerd.config.models import VehicleSection
from landerd.geometry import Vec3, clamp
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.touchdown import MAX_TILT
from landerd.pad import Plate

SLOWEST_SINK_MPS = 0.1  # least sink rate assumed in predicting where the feet will touch
RATE_S = 0.5  # time constant of the feet's velocity across the plate

# Largest angle between the airframe's axis and the plate's normal at which it may touch. In steady
# flight that axis lies along the sum of weight and wind force, so that this is the angle at which
# they pull on the gear once it stands. Until it is levelled ArduCopter's thrust carries half of the
# weight: rubber (friction 1) slides from 26 degrees on. On days of the field world flown without
# this limit, 42 of 52 with 24 to 27 degrees stood, and 10 of 25 with 27 to 31; the others slid off
# the plate or tipped over.
MAX_LEAN = math.radians(27.0)
# Half width over height of a gear, from which up it slides before it tips: MAX_LEAN holds, as for
# the thesis's (0.26 m wide, 0.20 m high). Down from the second value it tips first, in a gust after
# the touch, and may touch only where half of the weight holds it: gears as high as wide tipped or
# slid off 7 times in 12 with 21 degrees allowed, in 8 m/s, and 2 in 8 with 17 degrees, in 6 m/s.
SLIDES_FIRST, TIPS_FIRST = 0.64, 0.5
# How far the lowest foot may be below the feet's centre, as a share of the commit height: lower it
# would touch before commit, when nothing watches for contact.
HANGS_SHARE = 0.85


def most_lean(vehicle: VehicleSection, commit_height_m: float) -> float:
    """Return the lean against the plate with which the vehicle may touch and still stand, rad.

    Args:
        vehicle: its gear; the centre of mass is taken to be at the body frame's origin.
        commit_height_m: height over the pad from which on contact is watched for, m.
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
    """Feet and plate; from contact on the feet are followed across the plate.

    In the air the circle through the feet must fit onto the plate, which leaves room for errors.
    """

    def __init__(self, plate: Plate, footprint_m: tuple[float, float]) -> None:
        """Make one for a plate and the distances between the feet along x and y, m."""
        self._reach_m = 0.5 * math.hypot(*footprint_m)
        self._half_m = 0.5 * footprint_m[0], 0.5 * footprint_m[1]
        # Edges in the pad frame; north and east positive.
        self._north = (-plate.south_m, plate.north_m)
        self._east = (-plate.west_m, plate.east_m)
        self._offset = (0.0, 0.0)  # of the feet's centre from the landing point, local, m
        self._heading: float | None = None  # of the pad, local, rad; None: not known
        self._yaw: float | None = None  # of the vehicle, local, rad; None: not followed yet
        self._feet: tuple[float, Vec3] | None = None  # time of the last `slide`, s; local, m
        self._rate = (0.0, 0.0)  # of the offset, low-passed, m/s
        self._followed_s = 0.0  # time over which the offset was followed by velocity, s
        self._sigma_mps = 0.0  # of the pad's velocity, m/s

    def will_miss(
        self, relative: RelativeState, heading: float | None, sink_rate: float, tolerance_m: float
    ) -> bool:
        """Tell whether a foot will touch beside the plate.

        Args:
            relative: pad relative to the vehicle.
            heading: of the pad, local, rad; None: not known.
            sink_rate: relative to the pad, m/s.
            tolerance_m: distance from the landing point within which every plate is large enough.
        """
        t = max(0.0, relative.height) / max(sink_rate, SLOWEST_SINK_MPS)
        (north, east, _), (v_north, v_east, _) = relative.error, relative.error_rate
        offset = (-north - t * v_north, -east - t * v_east)
        return math.hypot(*offset) > tolerance_m and not self._holds(offset, heading)

    def clearance(self, relative: RelativeState, tilt: float) -> float:
        """Return the height (m) of the lowest foot over the plate for the worst direction of tilt.

        Args:
            relative: pad relative to the vehicle.
            tilt: of the airframe from level, rad.
        """
        plate = math.acos(clamp(relative.normal[2], -1.0, 1.0))
        return relative.height - self._reach_m * math.tan(min(tilt + plate, MAX_TILT))

    def touch(self, relative: RelativeState, heading: float | None) -> None:
        """Note where the feet touch; heading: of the pad, local, rad."""
        self._offset = (-relative.error[0], -relative.error[1])
        self._heading = heading
        self._feet = self._yaw = None
        self._rate, self._followed_s = (0.0, 0.0), 0.0
        self._sigma_mps = relative.sigma_velocity

    def see(self, to_pad: Vec3, heading: float | None) -> None:
        """Take the place of the feet from sight.

        Args:
            to_pad: from the feet's centre to the landing point, local, m.
            heading: of the pad, which may have turned since the touch, local, rad; None: not known.
        """
        self._offset = (-to_pad[0], -to_pad[1])
        self._heading = self._heading if heading is None else heading
        self._rate, self._followed_s = (0.0, 0.0), 0.0

    def slide(
        self, now: float, feet: Vec3, yaw: float, pad_velocity: Vec3, *, stands: bool = False
    ) -> None:
        """Follow the feet across the plate since the last call, however long ago that was.

        Args:
            now: s.
            feet: their centre, local, m. Positions are differenced, since the reported velocity may
                have a constant error.
            yaw: of the vehicle, local, rad.
            pad_velocity: as last seen, local, m/s.
            stands: the feet have not moved across the plate since the last call.
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

        A small error of the pad's velocity looks like a slide that never ends: what 2 sigma of it
        explain is taken out.
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
        """Tell whether the feet fit onto the plate at an offset (local, m) of their centre.

        Args:
            offset: from the landing point.
            heading: of the pad, local, rad; None: it must fit for every heading.
            yaw: of the vehicle, local, rad; None: the circle through the feet must fit.
        """
        north, east = offset
        if heading is None:
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
