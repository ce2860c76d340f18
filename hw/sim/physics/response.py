"""How an ArduCopter in GUIDED answers velocity and yaw-rate orders.

Fitted to measurements of ArduCopter 4.5.7 in SITL: ArduPilot's own shaper, which limits jerk and
acceleration, then the lag of the inner loops. `bench/step_response.py` prints these measurements
beside the model's step responses.
"""

import math
from collections import deque

from hw.sim.options import ResponseOptions
from landerd.geometry import clamp

STEP_S = 0.0025  # ArduCopter's main loop runs at 400 Hz
MEASURED = ResponseOptions()


class Delay:
    """Delays orders by a fixed number of steps."""

    def __init__(self, delay_s: float, order: tuple[float, ...]) -> None:
        self._orders = deque([order] * round(delay_s / STEP_S))

    def pass_on(self, order: tuple[float, ...]) -> tuple[float, ...]:
        """Take the order of this step and return the one that is due."""
        if not self._orders:
            return order
        self._orders.append(order)
        return self._orders.popleft()


def _sqrt_controller(error: float, gain: float, limit: float) -> float:
    """Return ArduPilot's sqrt_controller: gain * error near 0, beyond it braking at `limit`."""
    knee = limit / (gain * gain)
    if error > knee:
        return math.sqrt(2.0 * limit * (error - 0.5 * knee))
    if error < -knee:
        return -math.sqrt(2.0 * limit * (-error - 0.5 * knee))
    return gain * error


class HorizontalResponse:
    """North and east: ArduPilot's shaper (2.5 m/s^2 and 5 m/s^3), then a second-order lag."""

    _OMEGA = 9.0  # rad/s
    _ZETA = 0.34

    def __init__(self, options: ResponseOptions = MEASURED) -> None:
        """Start at rest."""
        self._acceleration = options.acceleration_mps2
        self._jerk_limit = options.jerk_mps3
        self._gain = self._jerk_limit / self._acceleration
        self._most_change = self._jerk_limit * STEP_S
        omega = options.bandwidth * self._OMEGA
        self._stiffness, self._damping = omega * omega, 2.0 * self._ZETA * omega
        self._delay_s = options.delay_s
        self.settle(0.0, 0.0)

    def settle(self, vn: float, ve: float) -> None:
        """Start from steady flight at this velocity, m/s."""
        self.vn, self.ve = vn, ve
        self._delay = Delay(self._delay_s, (vn, ve))
        self.an = self.ae = 0.0
        self._shaped = (vn, ve, 0.0, 0.0)  # velocity and acceleration as ordered, north and east

    def step(self, order_n: float, order_e: float) -> None:
        """Advance by STEP_S to new vn, ve (m/s) and an, ae (m/s^2) of the vehicle."""
        # Local variables, here as below, as this runs 400 times per second of flight.
        order_n, order_e = self._delay.pass_on((order_n, order_e))
        vn, ve, an, ae = self._shaped
        error_n, error_e = order_n - vn, order_e - ve
        error = math.hypot(error_n, error_e)
        target_n = target_e = 0.0
        if error > 0.0:
            size = _sqrt_controller(error, self._gain, self._jerk_limit)
            k = min(size, self._acceleration) / error
            target_n, target_e = k * error_n, k * error_e
        change_n, change_e = target_n - an, target_e - ae
        change = math.hypot(change_n, change_e)
        if change > self._most_change:
            k = self._most_change / change
            change_n *= k
            change_e *= k
        an, ae = an + change_n, ae + change_e
        vn, ve = vn + an * STEP_S, ve + ae * STEP_S
        self._shaped = (vn, ve, an, ae)

        stiffness, damping = self._stiffness, self._damping
        self.an += (stiffness * (vn - self.vn) - damping * self.an) * STEP_S
        self.ae += (stiffness * (ve - self.ve) - damping * self.ae) * STEP_S
        self.vn += self.an * STEP_S
        self.ve += self.ae * STEP_S


class VerticalResponse:
    """Down: the shaper (1 m/s^2 and 5 m/s^3), a fast lag, and a slow mode that overshoots."""

    _OMEGA, _ZETA = 40.0, 2.09
    _SLOW_OMEGA, _SLOW_ZETA, _SLOW_GAIN_S = 2.13, 0.49, 0.115

    def __init__(self, options: ResponseOptions = MEASURED) -> None:
        """Start at rest."""
        self._acceleration = options.vertical_acceleration_mps2
        self._jerk_limit = options.jerk_mps3
        self._gain = self._jerk_limit / self._acceleration
        self._most_change = self._jerk_limit * STEP_S
        self._omega = options.bandwidth * self._OMEGA
        self._delay_s = options.delay_s
        self.settle(0.0)

    def settle(self, v: float) -> None:
        """Start from steady flight at this velocity, m/s, positive down."""
        self.v = v
        self._delay = Delay(self._delay_s, (v,))
        self.a = 0.0
        self._shaped = self._fast = self._slow = (v, 0.0)  # velocity and acceleration of each

    def step(self, order: float) -> None:
        """Advance by STEP_S to new v (m/s) and a (m/s^2) of the vehicle, positive down."""
        (order,) = self._delay.pass_on((order,))
        v, a = self._shaped
        most, limit = self._most_change, self._acceleration
        target = clamp(_sqrt_controller(order - v, self._gain, self._jerk_limit), -limit, limit)
        a += clamp(target - a, -most, most)
        v += a * STEP_S
        self._shaped = (v, a)

        # [1 / fast] * (1 + gain s / slow)
        fast, slow = self._omega, self._SLOW_OMEGA
        fast_v, fast_a = self._fast
        fast_a += STEP_S * fast * (fast * (v - fast_v) - 2.0 * self._ZETA * fast_a)
        fast_v += fast_a * STEP_S
        self._fast = (fast_v, fast_a)
        slow_v, slow_a = self._slow
        slow_jerk = slow * (slow * (fast_v - slow_v) - 2.0 * self._SLOW_ZETA * slow_a)
        slow_a += slow_jerk * STEP_S
        self._slow = (slow_v + slow_a * STEP_S, slow_a)
        self.v = fast_v + self._SLOW_GAIN_S * slow_a
        self.a = fast_a + self._SLOW_GAIN_S * slow_jerk


class MeasuredYawResponse:
    """Yaw rate as measured: delay, lag, and a second order that overshoots by half."""

    _LIMIT = math.radians(60.0)  # ATC_SLEW_YAW, rad/s
    _DELAY_S = 0.069
    _LAG_S = 0.157
    _LEAD_S = 0.279
    _OMEGA, _ZETA = 5.43, 0.328

    def __init__(self) -> None:
        self.settle(0.0)

    def settle(self, rate: float) -> None:
        """Start from a steady turn, rad/s."""
        self.rate = rate
        self._delayed = deque([rate] * round(self._DELAY_S / STEP_S))
        self._lagged = rate
        self._mode, self._mode_rate = rate, 0.0

    def step(self, order: float) -> None:
        """Go on by STEP_S; rate (rad/s) is the vehicle's then."""
        self._delayed.append(clamp(order, -self._LIMIT, self._LIMIT))
        self._lagged += (self._delayed.popleft() - self._lagged) * (STEP_S / self._LAG_S)
        omega = self._OMEGA
        self._mode_rate += (
            STEP_S
            * omega
            * (omega * (self._lagged - self._mode) - 2.0 * self._ZETA * self._mode_rate)
        )
        self._mode += self._mode_rate * STEP_S
        self.rate = self._mode + self._LEAD_S * self._mode_rate


class DampedYawResponse:
    """Yaw rate of a well-tuned vehicle: the same limit, critically damped within about 0.3 s."""

    _LIMIT = math.radians(60.0)  # rad/s
    _OMEGA = 13.0  # 63 % after 0.17 s, 90 % after 0.3 s

    def __init__(self) -> None:
        self.settle(0.0)

    def settle(self, rate: float) -> None:
        """Start from a steady turn, rad/s."""
        self.rate = rate
        self._acceleration = 0.0

    def step(self, order: float) -> None:
        """Go on by STEP_S; rate (rad/s) is the vehicle's then."""
        error = clamp(order, -self._LIMIT, self._LIMIT) - self.rate
        self._acceleration += (
            STEP_S * self._OMEGA * (self._OMEGA * error - 2.0 * self._acceleration)
        )
        self.rate += self._acceleration * STEP_S


YawResponse = MeasuredYawResponse | DampedYawResponse


class WindResponse:
    """How the autopilot counters disturbances such as wind, on one horizontal axis.

    ArduCopter's position and velocity loops with its gains (PSC_POSXY_P, PSC_VELXY_P and _I; D is
    half of PSC_VELXY_D to fit) and the attitude's lag. Measured in a gust of 5 m/s from calm:
    -0.50 m/s after 0.5 s, 0 at 2 s, +0.18 at 3 s, 0.63 m at most.
    """

    _POSITION_P, _P, _I, _D = 1.0, 2.0, 1.0, 0.25
    _D_SHARE = 1.0 - math.exp(-2.0 * math.pi * 5.0 * STEP_S)  # PSC_VELXY_FLTD, 5 Hz
    _OMEGA, _ZETA = 12.0, 0.7

    def __init__(self, trim: float) -> None:
        """Start in balance with a steady wind that this acceleration (m/s^2) compensates."""
        self.a = trim
        self._jerk = 0.0
        self._position = 0.0
        self._integral = trim
        self._error = self._error_slope = 0.0

    def step(self, drift: float, hold: bool) -> None:
        """Advance by STEP_S to the new acceleration a (m/s^2) against the disturbance.

        Args:
            drift: the vehicle's velocity minus the undisturbed one, m/s
            hold: freeze the integrals, as ArduCopter does at the limit of tilt
        """
        error = -self._POSITION_P * self._position - drift
        if not hold:
            self._position += drift * STEP_S
            self._integral += self._I * error * STEP_S
        slope = (error - self._error) / STEP_S
        self._error = error
        self._error_slope += self._D_SHARE * (slope - self._error_slope)
        demand = self._P * error + self._integral + self._D * self._error_slope
        omega = self._OMEGA
        self._jerk += STEP_S * omega * (omega * (demand - self.a) - 2.0 * self._ZETA * self._jerk)
        self.a += self._jerk * STEP_S
