"""Whether a pad's velocity turns with its heading, told by the innovations of a Kalman filter.

A pad on a vehicle drives where it looks: its velocity turns as its heading does. A barge turns
about itself and drifts straight on. The coupling is the share of the heading's turn rate that the
velocity turns with. It is estimated beside the filter's state, whose error by a wrong coupling is
followed through every step (separate bias estimation: Friedland 1969, "Treatment of bias in
recursive filtering", IEEE Trans. Automatic Control 14).
"""

from landerd.geometry import Mat3, Vec3, add, clamp, dot, rotate, scale

# What is assumed of a new pad: that it drives where it looks, as vehicles do. And how the coupling
# may change, per sqrt(s): one that drives may begin to turn about itself.
INITIAL, SIGMA_INITIAL, RANDOM_WALK = 1.0, 0.5, 0.2

ZERO: Vec3 = (0.0, 0.0, 0.0)
# Position (m), velocity (m/s) and both blocks of biases, or changes of them.
State = tuple[Vec3, Vec3, Vec3, Vec3]


class Coupling:
    """The coupling of one pad and its variance.

    Attributes:
        value: of the heading's turn rate, what the velocity turns with, 0 to 1.
        variance: of it.
        by: derivative of the filter's state by it.
    """

    def __init__(self) -> None:
        """Assume it of a new pad, whose velocity is not known: no error is due to it yet."""
        self.value, self.variance = INITIAL, SIGMA_INITIAL * SIGMA_INITIAL
        self.by: State = (ZERO, ZERO, ZERO, ZERO)

    def predict(self, dt: float, turn_rate: float, velocity: Vec3) -> None:
        """Go on by dt, s, of a pad of this turn rate (rad/s) and velocity (m/s)."""
        north, east, _ = velocity
        acceleration = (-turn_rate * east, turn_rate * north, 0.0)
        p, v, b, g = self.by
        p = add(add(p, scale(v, dt)), scale(acceleration, 0.5 * dt * dt))
        self.by = (p, add(v, scale(acceleration, dt)), b, g)
        self.variance += RANDOM_WALK * RANDOM_WALK * dt

    def correct(self, innovation: Vec3, by_coupling: Vec3, S_inverse: Mat3, by: State) -> State:
        """Take an innovation in and return how the state changes by what is learned of it.

        Args:
            innovation: m.
            by_coupling: derivative by the coupling of what was expected, m.
            S_inverse: of the innovation's covariance as it is if the coupling is right, 1/m^2.
            by: derivative of the state by it, after the state was corrected.
        """
        told = rotate(S_inverse, by_coupling)
        self.variance /= 1.0 + self.variance * dot(by_coupling, told)
        value = clamp(self.value + self.variance * dot(told, innovation), 0.0, 1.0)
        change, self.value, self.by = value - self.value, value, by
        p, v, b, g = by
        return scale(p, change), scale(v, change), scale(b, change), scale(g, change)
