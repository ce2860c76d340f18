"""Does a pad's velocity turn with its heading? Estimated from the motion filter's innovations.

A pad on a vehicle drives the way it points: its velocity vector turns at the rate of its heading.
A barge yaws about its own axis and drifts straight on. The coupling is the share of the heading's
turn rate that the velocity turns at, and is either 1 or 0.

It is estimated beside the filter's state: the sensitivity of that state to a wrong coupling is
carried through every predict and correct step (separate bias estimation: Friedland 1969, "Treatment
of bias in recursive filtering", IEEE Trans. Automatic Control 14). The raw estimate is noisy and
may come out as 0.8 or 1.2; the filter turns the velocity by the probability, by Bayes' rule, that
the true value is 1.
"""

import math

from landerd.geometry import ZERO, Mat3, Vec3, add, clamp, dot, rotate, scale, turned

# Prior probability that the velocity of a turning pad turns with its heading.
PRIOR_COUPLED = 0.95
# Largest sigma of the estimate, and its random walk per sqrt(s): a pad that drives may begin to
# turn on the spot. By trial: a pad that yaws at 8 deg/s while it drifts straight at 1.5 m/s is
# recognised within 5 to 10 s, and 44 field days with circling pads end as they did without.
SIGMA, RANDOM_WALK = 1.0, 0.1
# Smallest sigma in Bayes' rule: the decision is never sharper than this, as a few pads do
# something between the two.
LEAST_SIGMA = 0.2

# The blocks p, v, b and g of estimation.motion_filter, or a change of them.
FilterState = tuple[Vec3, Vec3, Vec3, Vec3]


class TurnCoupling:
    """The coupling of one pad.

    Attributes:
        value: probability that the coupling is 1; the filter turns the velocity by it.
        estimate: from the innovations alone, ignoring that the true value is 0 or 1.
        variance: of the estimate.
        sensitivity: derivative of the filter's state with respect to the coupling.
    """

    def __init__(self) -> None:
        """Begin for a new pad: no error of its state is due to the coupling yet."""
        self.value = PRIOR_COUPLED
        self.estimate, self.variance = 0.5, SIGMA * SIGMA
        self.sensitivity: FilterState = (ZERO, ZERO, ZERO, ZERO)

    def predict(self, dt: float, turn_rate: float, velocity: Vec3) -> None:
        """Predict over dt (s) for a pad with this turn rate (rad/s) and velocity (local, m/s)."""
        north, east, _ = velocity
        acceleration = (-turn_rate * east, turn_rate * north, 0.0)
        p, v, b, g = self.sensitivity
        p = add(add(p, scale(v, dt)), scale(acceleration, 0.5 * dt * dt))
        v = turned(v, self.value * turn_rate * dt)
        self.sensitivity = (p, add(v, scale(acceleration, dt)), b, g)
        self.variance = min(self.variance + RANDOM_WALK * RANDOM_WALK * dt, SIGMA * SIGMA)

    def correct(
        self, innovation: Vec3, jacobian: Vec3, S_inverse: Mat3, sensitivity: FilterState
    ) -> FilterState:
        """Take an innovation in; return the change that the new coupling makes to the filter state.

        Args:
            innovation: m.
            jacobian: derivative of the predicted measurement with respect to the coupling, m.
            S_inverse: inverse of the innovation's covariance for the right coupling, 1/m^2.
            sensitivity: of the state to the coupling, after this measurement's correction.
        """
        weighted = rotate(S_inverse, jacobian)
        information = dot(jacobian, weighted)
        self.variance /= 1.0 + self.variance * information
        residual = dot(weighted, innovation) - information * (self.estimate - self.value)
        self.estimate += self.variance * residual
        value = self._probability()
        change, self.value, self.sensitivity = value - self.value, value, sensitivity
        p, v, b, g = sensitivity
        return scale(p, change), scale(v, change), scale(b, change), scale(g, change)

    def _probability(self) -> float:
        """Return the probability that the coupling is 1 and not 0, by Bayes' rule."""
        log_odds = (self.estimate - 0.5) / max(self.variance, LEAST_SIGMA * LEAST_SIGMA)
        prior = PRIOR_COUPLED / (1.0 - PRIOR_COUPLED)
        return 1.0 / (1.0 + math.exp(clamp(-log_odds, -50.0, 50.0)) / prior)
