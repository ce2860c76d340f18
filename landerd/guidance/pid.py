"""PID controller with the integral in output units and gains that change without a bump."""

from landerd.config.models import PidGains
from landerd.geometry import clamp

# Over which new gains are faded in, s, so that a change of phase does not step the output.
BLEND_S = 1.0


class Pid:
    """output = kp e + integral + kd de/dt, positive gains (thesis 2.4.3).

    Attributes:
        integral_limit: largest share of the integral in the output.
    """

    def __init__(self, gains: PidGains, *, integral_limit: float) -> None:
        self.integral_limit = integral_limit
        self._from = self._to = (gains.kp, gains.ki, gains.kd)
        self._faded = 1.0
        self._integral = 0.0

    def set_gains(self, gains: PidGains) -> None:
        """Head for these gains, from whatever is in force now."""
        to = (gains.kp, gains.ki, gains.kd)
        if to != self._to:
            self._from = self._gains()
            self._to = to
            self._faded = 0.0

    def reset(self) -> None:
        """Forget the integral and take the newest gains at once."""
        self._integral = 0.0
        self._faded = 1.0

    def step(self, error: float, error_rate: float, dt: float, *, saturated: bool) -> float:
        """Return the output.

        Args:
            error: set-point minus state.
            error_rate: its derivative, measured and not differenced.
            dt: time since the last step, s.
            saturated: the last output was cut: the integral may then only shrink.
        """
        self._faded = min(1.0, self._faded + dt / BLEND_S)
        kp, ki, kd = self._gains()
        change = ki * error * dt
        if not saturated or change * self._integral < 0.0:
            limit = self.integral_limit
            self._integral = clamp(self._integral + change, -limit, limit)
        return kp * error + self._integral + kd * error_rate

    def _gains(self) -> tuple[float, float, float]:
        k = self._faded
        a, b = self._from, self._to
        return (
            a[0] + k * (b[0] - a[0]),
            a[1] + k * (b[1] - a[1]),
            a[2] + k * (b[2] - a[2]),
        )
