"""Sightings in a row that are farther off than noise explains, and what their trend says.

A step of the telemetry's time or position shows a pad that is elsewhere at once and stays there. A
pad that brakes, or whose deck begins to heave, moves on from where it should be (a change of the
process noise, found in the innovations: Bar-Shalom, Li and Kirubarajan 2001, 11.2): from where it
would be by what was known when that began, for what has been made of the sightings since hides it.
"""

import math

from landerd.estimation.motion_filter import Course, Innovation, Jacobian
from landerd.geometry import (
    ZERO,
    Mat3,
    Vec3,
    add,
    diagonal,
    dot,
    inverse,
    matadd,
    norm,
    rotate,
    scale,
    sub,
)

TREND_SIGHTINGS = 3  # in a row at least tell a trend: two may be outliers

# A pad that was seen this far from where it should be, this often, and then no more has left the
# picture; one that was where it should be was only too near to be seen whole.
GONE_M = 0.1
GONE_SIGHTINGS = 2


class Inconsistency:
    """Looks at unlikely innovations; it begins with one and ends with a likely one.

    Attributes:
        lasts_s: for how long every sighting was farther off than noise explains, or the pad was
            gone after such, s.
        off_m: how far off the newest of these was, m; 0: it was none of them.
    """

    def __init__(self) -> None:
        self.end(math.inf)

    def end(self, t: float) -> None:
        """Begin with none at time t, s; infinity: no sighting was likely yet."""
        self.lasts_s = self.off_m = 0.0
        self._likely_t = t
        self._count = 0
        self._is_near = False
        self._first = self._last = self._newest = ZERO  # from where it should be, m
        # The pad's course when it began, and the innovation's covariance then, m^2.
        self._began: tuple[Course, Mat3] | None = None

    def look(
        self,
        course: Course,
        B: Jacobian,
        innovation: Innovation,
        *,
        near: bool,
    ) -> None:
        """Take the innovation of a sighting that is farther off than noise explains.

        Args:
            course: of the pad at its exposure, as expected.
            B: the sighting's Jacobian by the biases.
            innovation: of the position.
            near: a short step of the telemetry explains it.
        """
        t = course.t
        if self._began is None:
            self._began = course, innovation.S
            self._first, self._is_near = innovation.vector, near
        self._likely_t = min(self._likely_t, t)
        self._count += 1
        north, east, _ = sub(course.shown(t, B), self._began[0].shown(t, B))
        # A deck that heaves never goes straight on up or down: there only what surprises counts.
        learned = (north, east, 0.0)
        self._last, self._newest = self._newest, add(innovation.vector, learned)
        self.lasts_s, self.off_m = t - self._likely_t, norm(innovation.vector)

    def unseen(self, t: float) -> None:
        """Take a picture exposed at time t, s, that does not show the pad."""
        if self._count >= GONE_SIGHTINGS and self.off_m > GONE_M:
            self.lasts_s = max(self.lasts_s, t - self._likely_t)

    def trend(self, t: float, swing_m: float, limit: float) -> Vec3 | None:
        """Return how fast what is seen moves on from where it should be, m/s; None: it does not.

        Called after `look`. It began near, else it is another pad; and goes on by more than noise
        explains, else it is a step.

        Args:
            t: of the newest sighting, s.
            swing_m: what a swinging airframe makes of a pad that stands, 1 sigma.
            limit: on the normalised square of what is no noise.
        """
        if self._began is None or self._count < TREND_SIGHTINGS or not self._is_near:
            return None
        moved = sub(self._newest, self._first)
        goes_on = dot(sub(self._newest, self._last), moved) > 0.0
        if not goes_on or dot(moved, self._first) <= 0.0:
            return None
        # As noisy as it was: noise is learned from what cannot be explained, too. Both ends are.
        swing = swing_m * swing_m
        course, S = self._began
        noise = matadd(S, diagonal(swing, swing, swing))
        if dot(moved, rotate(inverse(noise), moved)) <= 2.0 * limit:
            return None
        # A pad that brakes does not heave for that: known less well up and down, it may be as near
        # as contact, and nothing is missed any more.
        north, east, down = moved
        if down * down <= 2.0 * limit * noise[2][2]:
            moved = (north, east, 0.0)
        return scale(moved, 1.0 / (t - course.t))
