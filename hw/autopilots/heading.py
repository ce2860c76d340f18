"""The vehicle's heading, low-passed, to turn set-points into its own frame (body_ned)."""

import math

from landerd.geometry import clamp, wrap

# Time constant in which the integrated yaw rate follows the measured heading, s. The rate is a
# gyro's and quiet; 0.05 degrees of noise in the heading are a jerk of 10 m/s^3 at 5 m/s.
TIME_CONSTANT_S = 0.5
SLEW = 0.025  # fastest correction, rad/s: no gyro drifts so fast, and noise may be of degrees
GAP_S = 0.3  # after a longer gap the next measurement is taken as it is
# A heading that is off by more than STEP, rad, is taken once it has been off by the same for
# STEP_S: then the autopilot has reset its filter. Until no heading was off for STEP_S the rate
# alone is integrated: spikes turned the velocities of a fast vehicle.
STEP, STEP_S = math.radians(5.0), 0.2
AHEAD_S = 0.2  # longest extrapolation from the last attitude


class Heading:
    """Complementary filter of heading and yaw rate."""

    def __init__(self) -> None:
        self._t = -math.inf
        self._yaw: float | None = None  # rad
        self._rate = 0.0  # rad/s
        self._off, self._off_t = 0.0, -math.inf  # the last step, rad, and since when, s
        self._sound_t = -math.inf  # since when no heading has been a step off, s

    def measured(self, t: float, yaw: float, rate: float) -> None:
        """Take heading (rad) and yaw rate (rad/s) of time t, s."""
        dt = t - self._t
        expected = yaw
        if self._yaw is not None and 0.0 <= dt < GAP_S:
            expected = self._yaw + 0.5 * (self._rate + rate) * dt
        off = wrap(yaw - expected)
        change = 0.0
        if abs(off) <= STEP:
            self._off_t = math.inf
            if t - self._sound_t >= STEP_S:
                change = clamp(off * min(1.0, dt / TIME_CONSTANT_S), -SLEW * dt, SLEW * dt)
        elif self._off_t > t or abs(off - self._off) > STEP:
            self._off, self._off_t, self._sound_t = off, t, t
        else:
            self._sound_t = t
            if t - self._off_t >= STEP_S:
                change, self._sound_t = off, -math.inf
        self._t, self._yaw, self._rate = t, wrap(expected + change), rate

    def at(self, now: float) -> float | None:
        """Return the heading at time now (s), rad; None before the first measurement."""
        if self._yaw is None:
            return None
        return self._yaw + self._rate * min(max(now - self._t, 0.0), AHEAD_S)
