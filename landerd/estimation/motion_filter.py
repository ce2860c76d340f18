"""Kalman filter of a moving point seen through biases, errors that all frames have in common.

State: position and velocity of the point (local NED), and three biases of what shows it: the
lens's direction about the camera's x and y (rad), and the clock of the pictures (s). Constant
velocity that turns with the pad's heading, driven by white acceleration; the biases are
Gauss-Markov. A 9x9 covariance as six 3x3 blocks in plain floats: the same bits on every machine.
"""

import math
from dataclasses import dataclass

from landerd.geometry import (
    Mat3,
    Vec3,
    add,
    diagonal,
    dot,
    inverse,
    matadd,
    matmul,
    matscale,
    rot_z,
    rotate,
    scale,
    sub,
    transpose,
)

ZERO: Vec3 = (0.0, 0.0, 0.0)
ZEROS: Mat3 = (ZERO, ZERO, ZERO)


@dataclass(frozen=True, slots=True)
class Innovation:
    """Measured minus expected, and what the measurement would change."""

    vector: Vec3  # m
    S: Mat3  # its covariance, m^2
    S_inverse: Mat3
    PHt: tuple[Mat3, Mat3, Mat3]  # P H^T by blocks: position, velocity, biases

    @property
    def nis(self) -> float:
        """Normalised innovation squared, its squared Mahalanobis distance: chi-square of 3."""
        return dot(self.vector, rotate(self.S_inverse, self.vector))


class MotionFilter:
    """Measured is position + B bias + noise; the 3x3 Jacobian B comes with every measurement."""

    def __init__(self, sigma_bias: Vec3, bias_time_constant_s: float) -> None:
        """Make a filter that knows nothing; call `start` first, after setting `q`.

        Args:
            sigma_bias: of the biases while nothing is known of them: rad, rad, s.
            bias_time_constant_s: their correlation time.
        """
        self.q: Vec3 = ZERO  # spectral density of the acceleration along local axes, m^2/s^3
        self._initial_Pbb = diagonal(*(sigma * sigma for sigma in sigma_bias))
        self._bias_time_constant_s = bias_time_constant_s
        self.t = -math.inf
        self.turn_rate = 0.0  # of the velocity, rad/s
        self.position = self.velocity = ZERO
        self.Ppp = self.Ppv = self.Pvv = ZEROS
        self._Ppb = self._Pvb = ZEROS
        self.forget_bias()

    def forget_bias(self) -> None:
        """Take the biases back to what is assumed of them."""
        self.bias = ZERO
        self.Pbb = self._initial_Pbb

    def start(self, t: float, measured: Vec3, R: Mat3, B: Mat3, sigma_velocity: Vec3) -> None:
        """Begin from one measurement; what is known of the biases is kept.

        Args:
            t: s.
            measured: m.
            R: its white noise's covariance, m^2.
            B: its Jacobian by the biases: m/rad, m/rad, m/s.
            sigma_velocity: of a velocity that is not known, along the axes, m/s.
        """
        self.t = t
        BP = matmul(B, self.Pbb)
        self.position = sub(measured, rotate(B, self.bias))
        self.velocity = ZERO
        self.Ppp = matadd(R, matmul(BP, transpose(B)))
        self.Ppv = self._Pvb = ZEROS
        self.Pvv = diagonal(*(sigma * sigma for sigma in sigma_velocity))
        self._Ppb = matscale(BP, -1.0)

    @property
    def sigma_velocity(self) -> Vec3:
        """Standard deviation of the velocity along the axes, m/s."""
        P = self.Pvv
        return (math.sqrt(P[0][0]), math.sqrt(P[1][1]), math.sqrt(P[2][2]))

    def shift(self, by: Vec3) -> None:
        """The local frame jumped: what was at x is now at x + by."""
        self.position = add(self.position, by)

    def at(self, dt: float) -> tuple[Vec3, Vec3, Mat3]:
        """Return position, velocity and the position's covariance dt after the last step."""
        velocity = self.velocity
        middle = velocity
        if self.turn_rate != 0.0:
            middle = rotate(rot_z(0.5 * self.turn_rate * dt), velocity)
            velocity = rotate(rot_z(self.turn_rate * dt), velocity)
        return add(self.position, scale(middle, dt)), velocity, self._position_covariance_after(dt)

    def predict(self, t: float) -> None:
        """Go on to time t."""
        dt = t - self.t
        self.t = t
        self.position, self.velocity, self.Ppp = self.at(dt)
        keep = math.exp(-dt / self._bias_time_constant_s)
        self._Ppb = matscale(matadd(self._Ppb, matscale(self._Pvb, dt)), keep)
        self._Pvb = matscale(self._Pvb, keep)
        self.Ppv = matadd(
            matadd(self.Ppv, matscale(self.Pvv, dt)), diagonal(*scale(self.q, 0.5 * dt * dt))
        )
        self.Pvv = matadd(self.Pvv, diagonal(*scale(self.q, dt)))
        self.bias = scale(self.bias, keep)
        keep *= keep
        self.Pbb = matadd(matscale(self.Pbb, keep), matscale(self._initial_Pbb, 1.0 - keep))

    def innovation(self, measured: Vec3, R: Mat3, B: Mat3) -> Innovation:
        """Return what a measurement at the filter's own time, with covariance R, would change."""
        Bt = transpose(B)
        Up = matadd(self.Ppp, matmul(self._Ppb, Bt))
        Uv = matadd(transpose(self.Ppv), matmul(self._Pvb, Bt))
        Ub = matadd(transpose(self._Ppb), matmul(self.Pbb, Bt))
        S = matadd(matadd(Up, matmul(B, Ub)), R)
        vector = sub(sub(measured, self.position), rotate(B, self.bias))
        return Innovation(vector, S, inverse(S), (Up, Uv, Ub))

    def correct(self, innovation: Innovation) -> None:
        """Take a measurement in."""
        vector, S_inverse = innovation.vector, innovation.S_inverse
        Up, Uv, Ub = innovation.PHt
        Kp, Kv, Kb = matmul(Up, S_inverse), matmul(Uv, S_inverse), matmul(Ub, S_inverse)
        self.position = add(self.position, rotate(Kp, vector))
        self.velocity = add(self.velocity, rotate(Kv, vector))
        self.bias = add(self.bias, rotate(Kb, vector))
        Up, Uv, Ub = transpose(Up), transpose(Uv), transpose(Ub)
        self.Ppp = _symmetric(_minus(self.Ppp, matmul(Kp, Up)))
        self.Ppv = _minus(self.Ppv, matmul(Kp, Uv))
        self.Pvv = _symmetric(_minus(self.Pvv, matmul(Kv, Uv)))
        self._Ppb = _minus(self._Ppb, matmul(Kp, Ub))
        self._Pvb = _minus(self._Pvb, matmul(Kv, Ub))
        self.Pbb = _symmetric(_minus(self.Pbb, matmul(Kb, Ub)))

    def _position_covariance_after(self, dt: float) -> Mat3:
        cross = matadd(self.Ppv, transpose(self.Ppv))
        grown = matadd(matadd(self.Ppp, matscale(cross, dt)), matscale(self.Pvv, dt * dt))
        return matadd(grown, diagonal(*scale(self.q, dt**3 / 3.0)))


def _minus(a: Mat3, b: Mat3) -> Mat3:
    return (sub(a[0], b[0]), sub(a[1], b[1]), sub(a[2], b[2]))


def _symmetric(m: Mat3) -> Mat3:
    """Average with the transpose: rounding would otherwise pull the two halves apart."""
    return matscale(matadd(m, transpose(m)), 0.5)
