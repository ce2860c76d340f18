"""Position control of an axis that takes a speed and reports an angle."""

from typing import Annotated

from pydantic import Field

from landerd.geometry import clamp
from landerd.section import Section


class RateLoopOptions(Section):
    """Gains of a PID controller, angle in and speed out (thesis 3.2 has one on each joint)."""

    kp: Annotated[float, Field(gt=0, le=20)] = 5.0  # rad/s per rad
    ki: Annotated[float, Field(ge=0, le=20)] = 3.0  # against a spring's or a cable's pull
    kd: Annotated[float, Field(ge=0, le=1)] = 0.05  # of the measured speed
    integral_limit_deg_s: Annotated[float, Field(ge=0, le=100)] = 20.0


class RateLoop:
    """PID controller of an axis with end stops: it never takes the short way through them.

    The derivative acts on the measured angle. While the output is at its limit the integral may
    only shrink (anti-windup), so that after a long turn the axis does not overshoot its target.
    """

    def __init__(self, options: RateLoopOptions, limit: float, integral_limit: float) -> None:
        """Make one; limit: of the output, rad/s; integral_limit: of the integral's part, rad/s."""
        self._options, self._limit, self._integral_limit = options, limit, integral_limit
        self.reset()

    def reset(self) -> None:
        """Clear the integral."""
        self._integral = 0.0

    def step(self, target: float, angle: float, rate: float, dt: float) -> float:
        """Return the speed to order, rad/s.

        Args:
            target: angle to turn to, rad.
            angle: measured angle, rad.
            rate: measured turn rate, rad/s.
            dt: time since the last step, s.
        """
        o = self._options
        error = target - angle
        change = o.ki * error * dt
        rest = o.kp * error - o.kd * rate
        if abs(rest + self._integral) < self._limit or change * self._integral < 0.0:
            limit = self._integral_limit
            self._integral = clamp(self._integral + change, -limit, limit)
        return clamp(rest + self._integral, -self._limit, self._limit)
