"""Kalman filter of a moving point seen through errors that are the same from frame to frame.

State: position and velocity of the point (local NED), and three common errors of what shows it: the
lens's direction about the camera's x and y (rad), and the clock of the pictures (s). Constant
velocity that turns with the pad's heading, driven by white acceleration; the common errors are
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
NOTHING: Mat3 = (ZERO, ZERO, ZERO)


@dataclass(frozen=True, slots=True)
class Innovation:
    """What a measurement would change."""

    vector: Vec3  # measured minus expected, m
    S: Mat3  # its covariance
    S_inverse: Mat3
    PHt: tuple[Mat3, Mat3, Mat3]  # P H^T by blocks: position, velocity, common

    @property
    def distance(self) -> float:
        """Squared Mahalanobis distance: chi-square of 3."""
        return dot(self.vector, rotate(self.S_inverse, self.vector))


class MotionFilter:
    """Measured is position + B common + noise, with B given for every measurement."""

    def __init__(self, common_sigma: Vec3, common_s: float) -> None:
        """Make a filter that knows nothing; call `start` first, after setting `q`.

        Args:
            common_sigma: of the common errors: rad, rad, s.
            common_s: their correlation time.
        """
        self.q: Vec3 = ZERO  # spectral density of the acceleration along local axes, m^2/s^3
        self._common_covariance = diagonal(*(sigma * sigma for sigma in common_sigma))
        self._common_s = common_s
        self.t = -math.inf
        self.turn_rate = 0.0  # of the velocity, rad/s
        self.position = self.velocity = ZERO
        self.Ppp = self.Ppv = self.Pvv = NOTHING
        self._Ppc = self._Pvc = NOTHING
        self.forget_common()

    def forget_common(self) -> None:
        """Take the common errors back to what is assumed of them."""
        self.common = ZERO
        self.Pcc = self._common_covariance

    def start(self, t: float, measured: Vec3, R: Mat3, B: Mat3, sigma_velocity: Vec3) -> None:
        """Begin from one measurement; what is known of the common errors is kept."""
        self.t = t
        BP = matmul(B, self.Pcc)
        self.position = sub(measured, rotate(B, self.common))
        self.velocity = ZERO
        self.Ppp = matadd(R, matmul(BP, transpose(B)))
        self.Ppv = self._Pvc = NOTHING
        self.Pvv = diagonal(*(sigma * sigma for sigma in sigma_velocity))
        self._Ppc = matscale(BP, -1.0)

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
        return add(self.position, scale(middle, dt)), velocity, self._grown(dt)

    def predict(self, t: float) -> None:
        """Go on to time t."""
        dt = t - self.t
        self.t = t
        self.position, self.velocity, self.Ppp = self.at(dt)
        keep = math.exp(-dt / self._common_s)
        self._Ppc = matscale(matadd(self._Ppc, matscale(self._Pvc, dt)), keep)
        self._Pvc = matscale(self._Pvc, keep)
        self.Ppv = matadd(
            matadd(self.Ppv, matscale(self.Pvv, dt)), diagonal(*scale(self.q, 0.5 * dt * dt))
        )
        self.Pvv = matadd(self.Pvv, diagonal(*scale(self.q, dt)))
        self.common = scale(self.common, keep)
        keep *= keep
        self.Pcc = matadd(matscale(self.Pcc, keep), matscale(self._common_covariance, 1.0 - keep))

    def innovation(self, measured: Vec3, R: Mat3, B: Mat3) -> Innovation:
        """Return what a measurement at the filter's own time, with covariance R, would change."""
        Bt = transpose(B)
        Up = matadd(self.Ppp, matmul(self._Ppc, Bt))
        Uv = matadd(transpose(self.Ppv), matmul(self._Pvc, Bt))
        Uc = matadd(transpose(self._Ppc), matmul(self.Pcc, Bt))
        S = matadd(matadd(Up, matmul(B, Uc)), R)
        vector = sub(sub(measured, self.position), rotate(B, self.common))
        return Innovation(vector, S, inverse(S), (Up, Uv, Uc))

    def correct(self, innovation: Innovation) -> None:
        """Take a measurement in."""
        vector, S_inverse = innovation.vector, innovation.S_inverse
        Up, Uv, Uc = innovation.PHt
        Kp, Kv, Kc = matmul(Up, S_inverse), matmul(Uv, S_inverse), matmul(Uc, S_inverse)
        self.position = add(self.position, rotate(Kp, vector))
        self.velocity = add(self.velocity, rotate(Kv, vector))
        self.common = add(self.common, rotate(Kc, vector))
        Up, Uv, Uc = transpose(Up), transpose(Uv), transpose(Uc)
        self.Ppp = _symmetric(_minus(self.Ppp, matmul(Kp, Up)))
        self.Ppv = _minus(self.Ppv, matmul(Kp, Uv))
        self.Pvv = _symmetric(_minus(self.Pvv, matmul(Kv, Uv)))
        self._Ppc = _minus(self._Ppc, matmul(Kp, Uc))
        self._Pvc = _minus(self._Pvc, matmul(Kv, Uc))
        self.Pcc = _symmetric(_minus(self.Pcc, matmul(Kc, Uc)))

    def _grown(self, dt: float) -> Mat3:
        cross = matadd(self.Ppv, transpose(self.Ppv))
        grown = matadd(matadd(self.Ppp, matscale(cross, dt)), matscale(self.Pvv, dt * dt))
        return matadd(grown, diagonal(*scale(self.q, dt**3 / 3.0)))


def _minus(a: Mat3, b: Mat3) -> Mat3:
    return (sub(a[0], b[0]), sub(a[1], b[1]), sub(a[2], b[2]))


def _symmetric(m: Mat3) -> Mat3:
    """Average with the transpose: rounding would otherwise pull the two halves apart."""
    return matscale(matadd(m, transpose(m)), 0.5)
