"""Kalman filter of a moving point and of the measurement biases that all frames have in common.

The state has four blocks of three:

    p  position of the point, local NED, m
    v  its velocity, local NED, m/s
    b  errors of the lens's direction about the camera's x and y (rad), clock of the pictures (s)
    g  clock of the gimbal's angles (s), scale of the ranges (in their standard deviations), error
       of the autopilot's heading (rad)

estimation.observation says what each bias does to a measurement. Process model: constant velocity
that turns with the pad's heading as far as estimation.turn_coupling says, driven by white
acceleration; the biases are first-order Gauss-Markov. The 12x12 covariance is kept as 3x3 blocks
named after the two they relate (Ppv, Pbg, ...), in plain floats: the same bits on every machine.
"""

import math
from typing import NamedTuple

from landerd.estimation.turn_coupling import TurnCoupling
from landerd.geometry import (
    ZERO,
    Mat3,
    Vec3,
    add,
    add_diagonal,
    add_transpose,
    diagonal,
    dot,
    horizontal_sigma,
    inverse,
    matadd,
    matadd_scaled,
    matmul,
    matmul_level,
    matmul_transposed,
    matscale,
    outer,
    rot_z,
    rotate,
    scale,
    sub,
    sub_product,
    transpose,
)

ZEROS: Mat3 = (ZERO, ZERO, ZERO)
Biases = tuple[Vec3, Vec3]  # the blocks b and g
Jacobian = tuple[Mat3, Mat3]  # of a measured position with respect to b and g


class Innovation(NamedTuple):
    """Measured minus predicted position, with what a correction by it needs."""

    vector: Vec3  # m
    S: Mat3  # its covariance, m^2
    S_inverse: Mat3
    PHt: tuple[Mat3, Mat3, Mat3, Mat3]  # P H^T for the blocks p, v, b, g
    coupling_jacobian: Vec3  # derivative of the predicted measurement by the coupling, m
    nis: float  # normalised innovation squared (squared Mahalanobis distance): chi-square of 3

    def with_noise(self, more: Mat3) -> "Innovation":
        """Return the innovation of the same measurement with this much more white noise, m^2."""
        S = matadd(self.S, more)
        return _innovation(self.vector, S, self.PHt, self.coupling_jacobian)


class MotionState(NamedTuple):
    """Position (m), velocity (m/s) and biases at one time (s)."""

    t: float
    position: Vec3
    velocity: Vec3
    biases: Biases

    def measured_at(self, t: float, B: Jacobian) -> Vec3:
        """Return the predicted measurement at time t (s) if the point goes straight on, m."""
        ahead = add(self.position, scale(self.velocity, t - self.t))
        return add(ahead, _apparent_shift(B, self.biases))


class MotionFilter:
    """The filter; a measurement is position + B biases + noise, and brings its Jacobian B."""

    def __init__(self, sigma_biases: Biases, time_constants_s: Biases) -> None:
        """Make a filter that knows nothing; call `start` first, after setting `q`.

        Args:
            sigma_biases: stationary standard deviations of b and g, in the units above.
            time_constants_s: correlation times of b and g.
        """
        self.q: Vec3 = ZERO  # spectral density of the acceleration along local axes, m^2/s^3
        b, g = sigma_biases
        self._initial_Pbb = diagonal(b[0] * b[0], b[1] * b[1], b[2] * b[2])
        self._initial_Pgg = diagonal(g[0] * g[0], g[1] * g[1], g[2] * g[2])
        self._time_constants_s = time_constants_s
        self.t = -math.inf
        self.turn_rate = 0.0  # of the heading, rad/s
        self._coupling = TurnCoupling()
        self.position = self.velocity = ZERO
        self.Ppp = self.Ppv = self.Pvv = ZEROS
        self._Ppb = self._Ppg = self._Pvb = self._Pvg = ZEROS
        self.forget_bias()

    def forget_bias(self) -> None:
        """Reset the biases to their stationary distribution."""
        self.biases: Biases = (ZERO, ZERO)
        self.Pbb, self.Pgg, self._Pbg = self._initial_Pbb, self._initial_Pgg, ZEROS

    def assume_clock(self, sigma_s: float) -> None:
        """Set the stationary sigma of the pictures' clock; what was learned of it is kept."""
        P = self._initial_Pbb
        learned = self.Pbb != P
        was, variance = P[2][2], sigma_s * sigma_s
        self._initial_Pbb = diagonal(P[0][0], P[1][1], variance)
        if learned:
            return
        self.Pbb = self._initial_Pbb
        if was > 0.0:
            # Nothing but the initial position has been correlated with the clock yet.
            x, y, z = self._Ppb
            by_clock = scale((x[2], y[2], z[2]), 1.0 / was)
            P = matadd_scaled(self.Ppp, outer(by_clock, by_clock), variance - was)
            self.Ppp = _symmetric(P)
            self._Ppb = _columns(self._Ppb, (1.0, 1.0, variance / was))

    def start(self, t: float, measured: Vec3, R: Mat3, B: Jacobian, sigma_velocity: Vec3) -> None:
        """Start from one measurement; what is known of the biases is kept.

        Args:
            t: time of the measurement, s.
            measured: position, m.
            R: covariance of its white noise, m^2.
            B: its Jacobian with respect to the biases: m per unit of each bias, m/s for a clock.
            sigma_velocity: of the unknown velocity along the axes, m/s.
        """
        self.t = t
        b, g = B
        by_b = matadd(matmul(b, self.Pbb), matmul_transposed(g, self._Pbg))
        by_g = matadd(matmul(b, self._Pbg), matmul(g, self.Pgg))
        self.position = sub(measured, _apparent_shift(B, self.biases))
        self.velocity = ZERO
        self.Ppp = _symmetric(_with_products(R, by_b, b, by_g, g))
        self.Ppv = self._Pvb = self._Pvg = ZEROS
        self.Pvv = diagonal(*(sigma * sigma for sigma in sigma_velocity))
        self._Ppb, self._Ppg = matscale(by_b, -1.0), matscale(by_g, -1.0)
        self._coupling = TurnCoupling()

    def sigma_velocity(self, dt: float) -> tuple[float, float]:
        """Return the velocity's sigma, horizontal (the largest) and vertical, dt (s) after `t`."""
        P = add_diagonal(self.Pvv, scale(self.q, dt))
        return horizontal_sigma(P), math.sqrt(P[2][2])

    @property
    def coupling(self) -> float:
        """Share of the heading's turn rate that the velocity turns at: 0 to 1."""
        return self._coupling.value

    @property
    def is_sound(self) -> bool:
        """Whether no variance is negative, as rounding or understated noise may make it."""
        blocks = (self.Ppp, self.Pvv, self.Pbb, self.Pgg)
        # NaN is not sound.
        return all(P[0][0] >= 0.0 and P[1][1] >= 0.0 and P[2][2] >= 0.0 for P in blocks)

    @property
    def state(self) -> MotionState:
        """The state at `t`."""
        return MotionState(self.t, self.position, self.velocity, self.biases)

    def loosen(self, position: Vec3, velocity: Vec3) -> None:
        """Add the covariance of one unexplained change of position (m) and velocity (m/s).

        A change of position alone is a step: of the pad or of the telemetry, there is no telling.
        """
        self.Ppp = matadd(self.Ppp, outer(position, position))
        self.Ppv = matadd(self.Ppv, outer(position, velocity))
        self.Pvv = matadd(self.Pvv, outer(velocity, velocity))

    def at(self, dt: float) -> tuple[Vec3, Vec3, Mat3]:
        """Return position (m), velocity (m/s) and position covariance (m^2), dt (s) after `t`."""
        return self._moved(dt, *self._transition(dt))

    def predict(self, t: float) -> None:
        """Predict to time t, s."""
        dt = t - self.t
        self.t = t
        self._coupling.predict(dt, self.turn_rate, self.velocity)
        turn, ahead = self._transition(dt)
        self.position, self.velocity, self.Ppp = self._moved(dt, turn, ahead)
        self.Ppv = matmul_transposed(matadd(self.Ppv, matmul_level(ahead, self.Pvv)), turn)
        self.Ppv = add_diagonal(self.Ppv, scale(self.q, 0.5 * dt * dt))
        self.Pvv = add_diagonal(
            matmul_transposed(matmul_level(turn, self.Pvv), turn), scale(self.q, dt)
        )
        self._Ppb = matadd(self._Ppb, matmul_level(ahead, self._Pvb))
        self._Ppg = matadd(self._Ppg, matmul_level(ahead, self._Pvg))
        self._Pvb, self._Pvg = matmul_level(turn, self._Pvb), matmul_level(turn, self._Pvg)
        self._fade_biases(dt)

    def _moved(self, dt: float, turn: Mat3, ahead: Mat3) -> tuple[Vec3, Vec3, Mat3]:
        """Return what `at` does; turn and ahead: the transition over dt (s)."""
        position = add(self.position, rotate(ahead, self.velocity))
        return position, rotate(turn, self.velocity), self._position_covariance_after(dt)

    def _transition(self, dt: float) -> tuple[Mat3, Mat3]:
        """Return the blocks of the transition over dt (s): of v by v, and of p by v (s)."""
        turned = self.coupling * self.turn_rate * dt
        return rot_z(turned), matscale(rot_z(0.5 * turned), dt)

    def _fade_biases(self, dt: float) -> None:
        """Predict the Gauss-Markov biases over dt (s): they decay to their stationary values."""
        b_constants, g_constants = self._time_constants_s
        keep_b, keep_g = _decay(b_constants, dt), _decay(g_constants, dt)
        b, g = self.biases
        self.biases = _times(b, keep_b), _times(g, keep_g)
        self._Ppb, self._Pvb = _columns(self._Ppb, keep_b), _columns(self._Pvb, keep_b)
        self._Ppg, self._Pvg = _columns(self._Ppg, keep_g), _columns(self._Pvg, keep_g)
        self._Pbg = _scaled(self._Pbg, keep_b, keep_g)
        self.Pbb = _faded(self.Pbb, keep_b, self._initial_Pbb)
        self.Pgg = _faded(self.Pgg, keep_g, self._initial_Pgg)

    def innovation(self, measured: Vec3, R: Mat3, B: Jacobian) -> Innovation:
        """Return the innovation of a position (m) measured at `t`, noise covariance R (m^2)."""
        b, g = B
        Up = _with_products(self.Ppp, self._Ppb, b, self._Ppg, g)
        Uv = _with_products(transpose(self.Ppv), self._Pvb, b, self._Pvg, g)
        Ub = _with_products(transpose(self._Ppb), self.Pbb, b, self._Pbg, g)
        Ug = _with_products(transpose(self._Ppg), transpose(self._Pbg), b, self.Pgg, g)
        S = matadd(matadd(Up, matadd(matmul(b, Ub), matmul(g, Ug))), R)
        vector = sub(sub(measured, self.position), _apparent_shift(B, self.biases))
        p, _, by_b, by_g = self._coupling.sensitivity
        coupling_jacobian = add(p, _apparent_shift(B, (by_b, by_g)))
        return _innovation(vector, S, (Up, Uv, Ub, Ug), coupling_jacobian)

    def correct(self, innovation: Innovation, coloured: Mat3) -> None:
        """Correct the state by a measurement.

        Args:
            innovation: of the measurement.
            coloured: covariance added, in the gain of the pictures' clock alone, for noise that is
                correlated from frame to frame, m^2. That clock thus has a suboptimal gain. By
                Joseph's form only its own variance differs from that of the optimal gain.
        """
        vector, S_inverse = innovation.vector, innovation.S_inverse
        Up, Uv, Ub, Ug = innovation.PHt
        Kp, Kv = matmul(Up, S_inverse), matmul(Uv, S_inverse)
        Kb, Kg = matmul(Ub, S_inverse), matmul(Ug, S_inverse)
        self.position = add(self.position, rotate(Kp, vector))
        self.velocity = add(self.velocity, rotate(Kv, vector))
        b, g = self.biases
        K_clock = rotate(inverse(matadd(innovation.S, coloured)), Ub[2])
        clock = b[2] + dot(K_clock, vector)
        clock_variance = self.Pbb[2][2] - dot(K_clock, Ub[2])
        about_x, about_y, _ = add(b, rotate(Kb, vector))
        self.biases = (about_x, about_y, clock), add(g, rotate(Kg, vector))
        self.Ppp = _symmetric(sub_product(self.Ppp, Kp, Up))
        self.Ppv = sub_product(self.Ppv, Kp, Uv)
        self.Pvv = _symmetric(sub_product(self.Pvv, Kv, Uv))
        self._Ppb = sub_product(self._Ppb, Kp, Ub)
        self._Pvb = sub_product(self._Pvb, Kv, Ub)
        x, y, z = _symmetric(sub_product(self.Pbb, Kb, Ub))
        self.Pbb = (x, y, (z[0], z[1], clock_variance))
        self._Ppg = sub_product(self._Ppg, Kp, Ug)
        self._Pvg = sub_product(self._Pvg, Kv, Ug)
        self._Pbg = sub_product(self._Pbg, Kb, Ug)
        self.Pgg = _symmetric(sub_product(self.Pgg, Kg, Ug))
        self._correct_coupling(innovation, (Kp, Kv, (*Kb[:2], K_clock), Kg))

    def _correct_coupling(self, innovation: Innovation, K: tuple[Mat3, Mat3, Mat3, Mat3]) -> None:
        """Correct the coupling and what it changes in the state; K: gains of p, v, b and g."""
        expected = innovation.coupling_jacobian
        p, v, b, g = self._coupling.sensitivity
        Kp, Kv, Kb, Kg = K
        sensitivity = (
            sub(p, rotate(Kp, expected)),
            sub(v, rotate(Kv, expected)),
            sub(b, rotate(Kb, expected)),
            sub(g, rotate(Kg, expected)),
        )
        p, v, b, g = self._coupling.correct(
            innovation.vector, expected, innovation.S_inverse, sensitivity
        )
        self.position, self.velocity = add(self.position, p), add(self.velocity, v)
        self.biases = add(self.biases[0], b), add(self.biases[1], g)

    def _position_covariance_after(self, dt: float) -> Mat3:
        # As of a point that goes straight on: between two pictures it turns by a degree at most.
        by_velocity = matadd_scaled(add_transpose(self.Ppv), self.Pvv, dt)
        grown = matadd_scaled(self.Ppp, by_velocity, dt)
        return add_diagonal(grown, scale(self.q, dt**3 / 3.0))


def _innovation(
    vector: Vec3, S: Mat3, PHt: tuple[Mat3, Mat3, Mat3, Mat3], coupling_jacobian: Vec3
) -> Innovation:
    S_inverse = inverse(S)
    nis = dot(vector, rotate(S_inverse, vector))
    return Innovation(vector, S, S_inverse, PHt, coupling_jacobian, nis)


def _apparent_shift(B: Jacobian, biases: Biases) -> Vec3:
    """Return measured minus true position that the biases cause, m."""
    return add(rotate(B[0], biases[0]), rotate(B[1], biases[1]))


def _decay(time_constants_s: Vec3, dt: float) -> Vec3:
    """Return exp(-dt / T) for each time constant T (s)."""
    x, y, z = time_constants_s
    return (math.exp(-dt / x), math.exp(-dt / y), math.exp(-dt / z))


def _times(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


def _columns(m: Mat3, k: Vec3) -> Mat3:
    """Return m diag(k)."""
    (a, b, c), (d, e, f), (g, h, i) = m
    x, y, z = k
    return ((x * a, y * b, z * c), (x * d, y * e, z * f), (x * g, y * h, z * i))


def _scaled(m: Mat3, rows: Vec3, columns: Vec3) -> Mat3:
    """Return diag(rows) m diag(columns)."""
    (x, y, z), (u, v, w), (p, q, r) = m
    (a, b, c), (d, e, f) = rows, columns
    return (
        (x * (a * d), y * (a * e), z * (a * f)),
        (u * (b * d), v * (b * e), w * (b * f)),
        (p * (c * d), q * (c * e), r * (c * f)),
    )


def _faded(P: Mat3, keep: Vec3, initial: Mat3) -> Mat3:
    """Return the predicted covariance of Gauss-Markov errors.

    Args:
        P: covariance before.
        keep: the decay factor of each error.
        initial: their stationary covariance, which is diagonal.
    """
    x, y, z = keep
    driven = (
        (1.0 - x * x) * initial[0][0],
        (1.0 - y * y) * initial[1][1],
        (1.0 - z * z) * initial[2][2],
    )
    return add_diagonal(_scaled(P, keep, keep), driven)


def _with_products(P: Mat3, a: Mat3, b: Mat3, c: Mat3, d: Mat3) -> Mat3:
    """Return P + a b^T + c d^T."""
    return matadd(P, matadd(matmul_transposed(a, b), matmul_transposed(c, d)))


def _symmetric(m: Mat3) -> Mat3:
    """Average with the transpose: rounding would otherwise pull the two halves apart."""
    (a, b, c), (d, e, f), (g, h, i) = m
    b, c, f = 0.5 * (b + d), 0.5 * (c + g), 0.5 * (f + h)
    return ((a, b, c), (b, e, f), (c, f, i))
