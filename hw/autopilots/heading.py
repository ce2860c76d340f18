"""The vehicle's heading, low-passed, to turn set-points into its own frame (body_ned)."""

import math

from landerd.geometry import clamp, wrap

# In which it follows the measured heading, s, beside what the rate says at once. The rate is a
# gyro's and quiet; half a tenth of a degree of noise in the heading is a jerk of 10 m/s^3 at 5 m/s.
TIME_CONSTANT_S = 0.5
SLEW = 0.025  # rad/s of that at most: no gyro drifts so fast, and noise of degrees is as bad
GAP_S = 0.3  # after so long without a measurement the next one is taken as it is
# One so far off, rad, is taken when it has been off by as much for so long, s: the autopilot's
# filter has begun anew then. Until nothing was off for so long the rate alone is gone by: spikes
# turned the velocities of a fast vehicle with them.
STEP, STEP_S = math.radians(5.0), 0.2
AHEAD_S = 0.2  # how far a turn is carried on from the last attitude


class Heading:
    """Complementary filter of heading and yaw rate."""

    def __init__(self) -> None:
        self._t = -math.inf
        self._yaw: float | None = None  # rad
        self._rate = 0.0  # rad/s
        self._off, self._off_t = 0.0, -math.inf  # the last step off, rad, and since when, s
        self._sound_t = -math.inf  # since when nothing is a step off, s

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
