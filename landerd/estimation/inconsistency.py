"""Runs of sightings that are farther off than noise explains, and what their trend says.

A step of the telemetry's time or position makes the pad appear elsewhere at once and stay there. A
pad that brakes, or a deck that begins to heave, moves away from its prediction frame by frame (a
manoeuvre, found in the innovations: Bar-Shalom, Li and Kirubarajan 2001, 11.2). The trend is
measured against the state at the start of the run, extrapolated: the current state has already
followed the sightings in part, which hides it.
"""

import math

from landerd.estimation.motion_filter import Innovation, Jacobian, MotionState
from landerd.geometry import (
    ZERO,
    Mat3,
    Vec3,
    add,
    add_diagonal,
    dot,
    inverse,
    norm,
    rotate,
    scale,
    sub,
)

TREND_SIGHTINGS = 3  # least number that makes a trend: two may be outliers

# A pad that was seen this far from its prediction, this often, and then not at all has left the
# picture; one that was where it should be was only too close to be seen whole.
GONE_M = 0.1
GONE_SIGHTINGS = 2


class Inconsistency:
    """A run of unlikely innovations; it begins with one and ends with a likely one.

    Attributes:
        lasts_s: duration of the run, with the time that the pad is out of the picture after it, s.
        off_m: length of the run's newest innovation, m; 0 outside of a run.
    """

    def __init__(self) -> None:
        self.end(math.inf)

    def end(self, t: float) -> None:
        """End the run: the sighting at time t (s) was likely; infinity: none was so far."""
        self.lasts_s = self.off_m = 0.0
        self._likely_t = t
        self._count = 0
        self._is_near = False
        # The first sighting's innovation, and how far the last two are from the pad's state at the
        # start of the run, extrapolated, m.
        self._first = self._last = self._newest = ZERO
        # That state, and the covariance of its innovation, m^2.
        self._began: tuple[MotionState, Mat3] | None = None

    def look(
        self,
        state: MotionState,
        B: Jacobian,
        innovation: Innovation,
        *,
        near: bool,
    ) -> None:
        """Take the innovation of a sighting that is farther off than noise explains.

        Args:
            state: of the pad, predicted to the sighting's exposure.
            B: the sighting's Jacobian with respect to the biases.
            innovation: of the sighting.
            near: a short step of the telemetry would explain it.
        """
        t = state.t
        if self._began is None:
            self._began = state, innovation.S
            self._first, self._is_near = innovation.vector, near
        self._likely_t = min(self._likely_t, t)
        self._count += 1
        north, east, _ = sub(state.measured_at(t, B), self._began[0].measured_at(t, B))
        # A heaving deck never goes straight on up or down: vertically only the innovation counts.
        learned = (north, east, 0.0)
        self._last, self._newest = self._newest, add(innovation.vector, learned)
        self.lasts_s, self.off_m = t - self._likely_t, norm(innovation.vector)

    def unseen(self, t: float) -> None:
        """Note a picture, exposed at time t (s), that does not show the pad."""
        if self._count >= GONE_SIGHTINGS and self.off_m > GONE_M:
            self.lasts_s = max(self.lasts_s, t - self._likely_t)

    def trend(self, t: float, swing_m: float, limit: float) -> Vec3 | None:
        """Return how fast sightings move away from the prediction, m/s; None: they do not.

        Call it after `look`. A run that did not begin near the prediction is another pad, and one
        that does not move on by more than noise explains is a step.

        Args:
            t: exposure of the newest sighting, s.
            swing_m: apparent motion of a standing pad as the airframe swings, 1 sigma, m.
            limit: NIS up to which noise explains a displacement.
        """
        if self._began is None or self._count < TREND_SIGHTINGS or not self._is_near:
            return None
        moved = sub(self._newest, self._first)
        goes_on = dot(sub(self._newest, self._last), moved) > 0.0
        if not goes_on or dot(moved, self._first) <= 0.0:
            return None
        # The noise at the start of the run, since the run itself has inflated the adapted noise;
        # twice the limit, since both ends of the displacement are noisy.
        swing = swing_m * swing_m
        state, S = self._began
        noise = add_diagonal(S, (swing, swing, swing))
        if dot(moved, rotate(inverse(noise), moved)) <= 2.0 * limit:
            return None
        # A braking pad does not heave: with a looser vertical estimate contact would count as
        # possible at once, and the pad could no longer be seen to be missed.
        north, east, down = moved
        if down * down <= 2.0 * limit * noise[2][2]:
            moved = (north, east, 0.0)
        return scale(moved, 1.0 / (t - state.t))
