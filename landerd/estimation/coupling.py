"""Whether a pad's velocity turns with its heading, told by the innovations of a Kalman filter.

A pad on a vehicle drives where it looks: its velocity turns as its heading does. A barge turns
about itself and drifts straight on. The coupling is the part of the heading's turn rate that the
velocity turns with: 1 or 0. It is estimated beside the filter's state, whose error by a wrong
coupling is followed through every step (separate bias estimation: Friedland 1969, "Treatment of
bias in recursive filtering", IEEE Trans. Automatic Control 14). The velocity is turned with the
expectation of the two by Bayes' rule: what noise makes of a vehicle's coupling, 0.8 or 1.2, turns
it no less.
"""

import math

from landerd.geometry import ZERO, Mat3, Vec3, add, clamp, dot, rot_z, rotate, scale

# Of pads that turn, so many drive where they look as long as nothing is seen of it.
DRIVE_WHERE_THEY_LOOK = 0.95
# Of the estimate, at most, and how the coupling may change, per sqrt(s): one that drives may begin
# to turn about itself. By trial: one that turns by 8 degrees a second and drives straight at
# 1.5 m/s is told within 5 to 10 s; 44 field days of pads that circle end as they did without.
SIGMA, RANDOM_WALK = 1.0, 0.1
# How sharply the two are told apart at best: few pads do something between them.
LEAST_SIGMA = 0.2

# Position (m), velocity (m/s) and both blocks of biases, or changes of them.
State = tuple[Vec3, Vec3, Vec3, Vec3]


class Coupling:
    """The coupling of one pad.

    Attributes:
        value: its expectation, 0 to 1: by it the filter turns the velocity.
        estimate: by innovations alone, without knowing that it is 0 or 1.
        variance: of the estimate.
        by: derivative of the filter's state by the coupling.
    """

    def __init__(self) -> None:
        """Assume it of a new pad, whose velocity is not known: no error is due to it yet."""
        self.value = DRIVE_WHERE_THEY_LOOK
        self.estimate, self.variance = 0.5, SIGMA * SIGMA
        self.by: State = (ZERO, ZERO, ZERO, ZERO)

    def predict(self, dt: float, turn_rate: float, velocity: Vec3) -> None:
        """Go on by dt, s, of a pad of this turn rate (rad/s) and velocity (m/s)."""
        north, east, _ = velocity
        acceleration = (-turn_rate * east, turn_rate * north, 0.0)
        p, v, b, g = self.by
        p = add(add(p, scale(v, dt)), scale(acceleration, 0.5 * dt * dt))
        v = rotate(rot_z(self.value * turn_rate * dt), v)
        self.by = (p, add(v, scale(acceleration, dt)), b, g)
        self.variance = min(self.variance + RANDOM_WALK * RANDOM_WALK * dt, SIGMA * SIGMA)

    def correct(self, innovation: Vec3, by_coupling: Vec3, S_inverse: Mat3, by: State) -> State:
        """Take an innovation in and return how the state changes by what is learned of it.

        Args:
            innovation: m.
            by_coupling: derivative by the coupling of what was expected, m.
            S_inverse: of the innovation's covariance as it is if the coupling is right, 1/m^2.
            by: derivative of the state by it, after the state was corrected.
        """
        told = rotate(S_inverse, by_coupling)
        information = dot(by_coupling, told)
        self.variance /= 1.0 + self.variance * information
        off = dot(told, innovation) - information * (self.estimate - self.value)
        self.estimate += self.variance * off
        value = self._expectation()
        change, self.value, self.by = value - self.value, value, by
        p, v, b, g = by
        return scale(p, change), scale(v, change), scale(b, change), scale(g, change)

    def _expectation(self) -> float:
        """Return the probability of 1 where else it is 0, by the estimate and Bayes' rule."""
        log_odds = (self.estimate - 0.5) / max(self.variance, LEAST_SIGMA * LEAST_SIGMA)
        prior = DRIVE_WHERE_THEY_LOOK / (1.0 - DRIVE_WHERE_THEY_LOOK)
        return 1.0 / (1.0 + math.exp(clamp(-log_odds, -50.0, 50.0)) / prior)
