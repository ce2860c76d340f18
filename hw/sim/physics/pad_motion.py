"""How the pad moves: still, driving, circling, heaving, swaying, tilted."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from hw.sim.options import PadOptions
from landerd.geometry import (
    Mat3,
    Vec3,
    add,
    cross,
    heading_of,
    matmul,
    rot_y,
    rot_z,
    rotate,
    sub,
    transpose,
)
from landerd.pad import Plate


@dataclass(frozen=True, slots=True)
class PadState:
    """Pose and motion of the pad at one time, local NED."""

    position: Vec3  # of the landing point, m
    R_local_pad: Mat3
    velocity: Vec3  # of the landing point, m/s
    turn_rate: float  # about local down, rad/s
    heading: float  # of the pad's north, seen from above, rad

    def velocity_at(self, point: Vec3) -> Vec3:
        """Return the velocity (m/s) of the plate's material at a point in local."""
        return add(self.velocity, cross((0.0, 0.0, self.turn_rate), sub(point, self.position)))

    def in_pad(self, point: Vec3) -> Vec3:
        """Return a point given in local NED (m) in the pad frame, m."""
        return rotate(transpose(self.R_local_pad), sub(point, self.position))


Disturbance = Callable[[float, PadState], PadState]


class PadMotion:
    """The pad's pose as a function of time since the start.

    Attributes:
        disturbances: changes of the motion by faults, applied in turn; each is a function of the
            time since the start (s) and of the state without it, and returns the state with it.
    """

    def __init__(self, options: PadOptions, plate: Plate, rng: Random) -> None:
        self.plate = plate
        self.disturbances: list[Disturbance] = []
        self._north, self._east = options.position_m
        self._heading = math.radians(options.heading_deg)
        self._course = math.radians(options.course_deg)
        self._speed = options.speed_mps
        self._brake = options.brake_mps2
        self._brake_t = options.brake_after_s
        self._turn_rate = math.radians(options.turn_rate_deg_s)
        self._heave, self._heave_omega = options.heave_m, 2.0 * math.pi * options.heave_hz
        self._sway, self._sway_omega = options.sway_m, 2.0 * math.pi * options.sway_hz
        self._heave_phase = rng.uniform(-math.pi, math.pi)
        self._sway_phase = rng.uniform(-math.pi, math.pi)
        azimuth = options.tilt_azimuth_deg
        downhill = rng.uniform(-math.pi, math.pi) if azimuth is None else math.radians(azimuth)
        self._R_tilt = matmul(
            matmul(rot_z(downhill), rot_y(-math.radians(options.tilt_deg))), rot_z(-downhill)
        )
        self._R_straight = matmul(rot_z(self._heading), self._R_tilt)  # while it does not turn
        # Seen from above, a tilted plate's north differs a little from its configured heading.
        self._north_off = heading_of((self._R_tilt[0][0], self._R_tilt[1][0], 0.0))
        # The plate is raised so that its lowest corner never dips into the ground.
        lowest = max(
            rotate(self._R_tilt, (x, y, 0.0))[2]
            for x in (plate.north_m, -plate.south_m)
            for y in (plate.east_m, -plate.west_m)
        )
        self.mean_height = options.height_m + options.heave_m + lowest
        self.highest = self.mean_height + options.heave_m + lowest  # of any part of the plate, m
        self._last: tuple[float, PadState] | None = None  # kept, as each step needs it repeatedly

    def at(self, t: float) -> PadState:
        """Return pose and motion t seconds after the start."""
        if self._last is None or self._last[0] != t:
            self._last = (t, self._undisturbed(t))
        state = self._last[1]
        for disturbance in self.disturbances:
            state = disturbance(t, state)
        return state

    def _undisturbed(self, t: float) -> PadState:
        rolled_t, v = self._rolled(t)
        turned = self._turn_rate * rolled_t
        course, heading = self._course + turned, self._heading + turned
        turn_rate = self._turn_rate * v / self._speed if self._speed else self._turn_rate
        vn, ve = v * math.cos(course), v * math.sin(course)
        if self._turn_rate:
            radius = self._speed / self._turn_rate
            n = self._north + radius * (math.sin(course) - math.sin(self._course))
            e = self._east - radius * (math.cos(course) - math.cos(self._course))
        else:
            n = self._north + self._speed * math.cos(course) * rolled_t
            e = self._east + self._speed * math.sin(course) * rolled_t
        d, vd = -self.mean_height, 0.0
        if self._heave:
            phase = self._heave_omega * t + self._heave_phase
            d += self._heave * math.sin(phase)
            vd = self._heave * self._heave_omega * math.cos(phase)
        if self._sway:  # to the pad's east
            phase = self._sway_omega * t + self._sway_phase
            aside = self._sway * math.sin(phase)
            along = -turn_rate * aside
            rate = self._sway * self._sway_omega * math.cos(phase)
            c, s = math.cos(heading), math.sin(heading)
            n, e = n - s * aside, e + c * aside
            vn, ve = vn - s * rate + c * along, ve + c * rate + s * along
        R = matmul(rot_z(heading), self._R_tilt) if self._turn_rate else self._R_straight
        return PadState(
            (n, e, d),
            R,
            (vn, ve, vd),
            turn_rate,
            heading + self._north_off,
        )

    def _rolled(self, t: float) -> tuple[float, float]:
        """Return the distance driven by time t over the full speed, s, and the speed then, m/s.

        The pad may brake to a stop; until then the first is t itself.
        """
        braking = t - self._brake_t
        if not (self._brake and self._speed) or braking <= 0.0:
            return t, self._speed
        braking = min(braking, self._speed / self._brake)
        v = self._speed - self._brake * braking
        return self._brake_t + 0.5 * (self._speed + v) * braking / self._speed, v
