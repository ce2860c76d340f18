"""Rule 3: limits of each set-point, and of the change from one to the next."""

import math
from collections.abc import Callable, Sequence

from hw.sim.judge.bounds import ZERO, RuleBounds
from landerd.geometry import Vec3, horizontal

_TOLERANCE = 1.02  # factor on every limit: set-points travel as 32-bit floats
# Added to the limits of acceleration and jerk. Rounding makes 1e-5 m/s^2 and 5e-4 m/s^3 of
# set-points of 5 m/s 25 ms apart; chosen well above that and well below any sensible limit.
_ACCELERATION_MARGIN_MPS2, _JERK_MARGIN_MPS3 = 0.02, 0.2
# A vehicle that was ordered to stop has not stopped yet: set-points may go on from its velocity, as
# to begin at zero would brake it for nothing. They must then be within the first value of that
# velocity (faults make its report wrong by 2 m/s), and nearer to it than to zero, but for bias and
# delay of the EKF's (0.15 m/s on a day of the field world).
_AS_FLOWN_MPS, _FLOWN_ERROR_MPS = 2.5, 0.2
# How well the heading is known when a set-point is sent in the body's frame, rad: it is turned by
# this error, and the next one by another. On days of the field world up to 0.1 degrees at 8 m/s,
# and 0.5 as a turn ended: nothing can be told of the jerk then.
_HEADING_ERROR = math.radians(0.15)
_GAP_S = 0.5  # after a longer gap without set-points the next one counts as the first


class SetpointLimits:
    """Judges set-points one after another.

    Attributes:
        last_t: when the last set-point came, s; None: none yet, or levelled since.
    """

    def __init__(self, bounds: RuleBounds, broken: Callable[[float, str], None]) -> None:
        """Make one; broken: called with the time (s) and the rule that is broken."""
        self.last_t: float | None = None
        self._b = bounds
        self._broken = broken
        self._velocity: Vec3 = (0.0, 0.0, 0.0)
        self._acceleration: Vec3 | None = None  # None: not known, so no jerk either
        self._stopped = (False, False)  # the last set-point: horizontally, vertically

    def check(
        self,
        t: float,
        velocity: Vec3,
        yaw_rate: float,
        *,
        waves_off: bool = False,
        flown: Vec3 | None = None,
        in_body_frame: bool = False,
    ) -> None:
        """Judge a set-point.

        Args:
            t: when it comes, s.
            velocity: that it asks for, local NED, m/s.
            yaw_rate: likewise, rad/s.
            waves_off: it climbs from just over the pad, which may begin at once.
            flown: true velocity of the vehicle, m/s; None: not known.
            in_body_frame: it was sent in the body's frame.
        """
        self._check_size(t, velocity, yaw_rate)
        goes_on = (
            all(self._stopped)
            and flown is not None
            and _is_as_flown(velocity[:2], flown[:2])
            and (waves_off or _is_as_flown(velocity[2:], flown[2:]))
        )
        if self.last_t is None or t - self.last_t > _GAP_S or goes_on:
            self._acceleration, self._stopped = None, _stops(velocity)
        elif t > self.last_t:
            self._check_change(
                t, t - self.last_t, velocity, waves_off=waves_off, in_body_frame=in_body_frame
            )
        self.last_t, self._velocity = t, velocity

    def levelled(self) -> None:
        """Note an order to stand level in place of a set-point.

        After it the autopilot starts from the vehicle's own velocity, and the next set-point counts
        as the first: on a pad that moves it must go with the pad at once (rule 4).
        """
        self.last_t = None

    def _check_size(self, t: float, velocity: Vec3, yaw_rate: float) -> None:
        b = self._b
        if horizontal(velocity) > b.speed_mps * _TOLERANCE:
            self._broken(t, "3: too fast")
        if not -b.climb_mps * _TOLERANCE <= velocity[2] <= b.descent_mps * _TOLERANCE:
            self._broken(t, "3: climbing or sinking too fast")
        if abs(yaw_rate) > b.yaw_rate * _TOLERANCE:
            self._broken(t, "3: turning too fast")

    def _check_change(
        self, t: float, dt: float, velocity: Vec3, *, waves_off: bool, in_body_frame: bool
    ) -> None:
        b, before = self._b, self._velocity
        a = (
            (velocity[0] - before[0]) / dt,
            (velocity[1] - before[1]) / dt,
            (velocity[2] - before[2]) / dt,
        )
        was = self._acceleration or a
        stops = _stops(velocity)
        # Set-points may be missing, as on a link that was cut, and one may have been an order to
        # stop. The acceleration is a mean over the gap then, which says nothing of the jerk.
        gap = dt > 1.5 * b.control_period_s
        was = a if gap else was
        if not stops[0]:
            change = math.hypot(a[0] - was[0], a[1] - was[1])
            jerk = (min(change, horizontal(a)) if self._stopped[0] else change) / dt
            size = min(horizontal(a), horizontal(velocity) / dt) if gap else horizontal(a)
            if in_body_frame:
                size, jerk = size - 2.0 * _HEADING_ERROR * horizontal(velocity) / dt, 0.0
            self._check_axes("horizontal", t, dt, size, jerk, b.acceleration_mps2)
        if not (stops[1] or waves_off):
            change = abs(a[2] - was[2])
            jerk = (min(change, abs(a[2])) if self._stopped[1] else change) / dt
            size = min(abs(a[2]), abs(velocity[2]) / dt) if gap else abs(a[2])
            self._check_axes("vertical", t, dt, size, jerk, b.vertical_acceleration_mps2)
        # After an order to stop the next may start afresh, or go on if zero was only passed.
        self._acceleration, self._stopped = None if gap else a, stops

    def _check_axes(
        self, axes: str, t: float, dt: float, acceleration: float, jerk: float, limit: float
    ) -> None:
        """Judge a change within dt (s); limit: of the acceleration, m/s^2."""
        # Allowance for the jitter of the wall's clock in the differences.
        loose = 2.0 * self._b.jitter_s / dt
        wobble = 2.0 * loose / dt
        if acceleration > limit * (_TOLERANCE + loose) + _ACCELERATION_MARGIN_MPS2:
            self._broken(t, f"3: {axes} acceleration")
        if jerk > self._b.jerk_mps3 * _TOLERANCE + wobble * limit + _JERK_MARGIN_MPS3:
            self._broken(t, f"3: {axes} jerk")


def _is_as_flown(velocity: Sequence[float], flown: Sequence[float]) -> bool:
    """Tell whether an ordered velocity goes on from the flown one, m/s; the same axes of both."""
    most = min(_AS_FLOWN_MPS, math.hypot(*flown) + _FLOWN_ERROR_MPS)
    return math.dist(velocity, flown) < most


def _stops(velocity: Vec3) -> tuple[bool, bool]:
    """Tell whether a velocity (m/s) is an order to stop, horizontally and vertically."""
    return horizontal(velocity) < ZERO, abs(velocity[2]) < ZERO
