"""Kalman filter of the pad's heading and turn rate."""

import math

from landerd.geometry import wrap

# Chosen by trial in the simulator: the row `turning` of `landerd campaign guidance`.
TURN_RATE_RANDOM_WALK = math.radians(2.0)  # rad/s per sqrt(s): how a pad's turn rate may change
SIGMA_INITIAL_TURN_RATE = math.radians(10.0)  # rad/s, of a new pad
# A turn rate less certain than this, rad/s, is not used to turn the pad's velocity. A filter that
# restarted from two pictures as the gimbal went silent estimated 14 +- 9 deg/s, and turned the
# velocity by that for as long as nothing was seen.
MAX_SIGMA_TURN_RATE = math.radians(5.0)
# Least sigma of a heading from one picture, rad, however well it was fitted: gimbal, clock and
# airframe each add a little. In the field world headings erred by 0.2 to 0.9 degrees where vision
# stated 0.06 to 0.15 (seeds 800 to 829). On some days one in five was refused; a restart from two
# of these let a standing pad turn at 35 deg/s, and the vehicle turned after it, by more than the
# 5 degrees allowed.
LEAST_SIGMA = math.radians(0.5)


class HeadingFilter:
    """Heading (rad, local) and turn rate (rad/s), driven by white angular acceleration."""

    def __init__(self, max_sigma: float) -> None:
        """Make one; innovations beyond max_sigma standard deviations are refused."""
        self._nis_limit = max_sigma**2
        self.reset()

    def reset(self) -> None:
        """Forget the heading."""
        self.known = False
        self.turn_rate = 0.0
        self._heading = 0.0
        self._t = -math.inf
        self._P = (0.0, 0.0, 0.0)  # covariance: of heading, heading with rate, rate
        self._refused: tuple[float, float, float] | None = None  # the last one: t, heading, sigma

    @property
    def sure_turn_rate(self) -> float:
        """The turn rate, rad/s; 0 while it is less certain than MAX_SIGMA_TURN_RATE."""
        return self.turn_rate if self._P[2] < MAX_SIGMA_TURN_RATE**2 else 0.0

    def at(self, t: float) -> tuple[float, float]:
        """Return heading and its sigma at time t, rad; only while known."""
        dt = t - self._t
        return wrap(self._heading + self.turn_rate * dt), math.sqrt(self._variance_after(dt))

    def update(self, t: float, heading: float, sigma: float) -> None:
        """Take a heading and its sigma (rad), measured at t (s), in the order of time.

        One that is refused may be wrong, or the first of a pad that has begun to turn: if the next
        is refused too, the filter restarts from both.
        """
        self._take(t, heading, math.hypot(sigma, LEAST_SIGMA))

    def _take(self, t: float, heading: float, sigma: float) -> None:
        if not self.known:
            self._start(t, heading, sigma)
            return
        dt = t - self._t
        predicted = wrap(self._heading + self.turn_rate * dt)
        _, c, w = self._P
        q = TURN_RATE_RANDOM_WALK * TURN_RATE_RANDOM_WALK
        h, c, w = self._variance_after(dt), c + dt * w + 0.5 * q * dt * dt, w + q * dt
        innovation = wrap(heading - predicted)
        s = h + sigma * sigma
        if innovation * innovation > self._nis_limit * s:
            self._refuse(t, heading, sigma)
            return
        self._refused = None
        k, k_rate = h / s, c / s
        self._t = t
        self._heading = wrap(predicted + k * innovation)
        self.turn_rate += k_rate * innovation
        self._P = (h - k * h, c - k * c, w - k_rate * c)

    def _refuse(self, t: float, heading: float, sigma: float) -> None:
        """Refuse a measurement; if the one before was refused too, restart from both."""
        refused, self._refused = self._refused, (t, heading, sigma)
        if refused is not None:
            self._start(*refused)
            self._take(t, heading, sigma)

    def _start(self, t: float, heading: float, sigma: float) -> None:
        self.known = True
        self._t, self._heading, self.turn_rate = t, heading, 0.0
        self._P = (sigma * sigma, 0.0, SIGMA_INITIAL_TURN_RATE**2)
        self._refused = None

    def _variance_after(self, dt: float) -> float:
        """Return the heading's variance dt (s) after the last measurement, rad^2."""
        h, c, w = self._P
        q = TURN_RATE_RANDOM_WALK * TURN_RATE_RANDOM_WALK
        return h + dt * (2.0 * c + dt * w) + q * dt**3 / 3.0
