"""Kalman filter for the pad's position, velocity and heading in local NED.

Constant velocity driven by white acceleration; each sighting is taken at its exposure time, so a
late picture corrects the state it belongs to and the state is predicted from there to now. Plain
floats and explicit 3x3 blocks: the same bits on every machine.
"""

import math
from dataclasses import dataclass

from landerd.config import EstimationSection
from landerd.estimation.placement import PlacedPad
from landerd.geometry import (
    IDENTITY,
    Mat3,
    Vec3,
    add,
    dot,
    inverse,
    matadd,
    matmul,
    matscale,
    rotate,
    scale,
    sub,
    transpose,
    wrap,
)

CONFIRM = 3  # consistent sightings before a pad is believed: one false alarm must not fly
REJECTIONS = 5  # sightings in a row outside the gate before the filter starts again from them
CONFIRM_GAP_S = 0.3  # between them: over a longer gap a false alarm and the pad make a fast pad
MAX_GAP_S = 2.0  # without a sighting for so long the old state says nothing about the new one
INITIAL_SPEED_MPS = 5.0  # 1 sigma of a new pad's velocity
MAX_TILT = math.radians(25.0)  # what lies steeper is no pad, whatever it looks like
SIGMA_TILT = math.radians(5.0)  # how far from level pads usually lie
HEADING_WALK = math.radians(3.0)  # rad per sqrt(s): how a pad's heading may change

MAX_SIGMA_HEADING = math.radians(5.0)  # a heading less certain than this is not known


@dataclass(frozen=True, slots=True)
class PadEstimate:
    """The pad at one time, local NED."""

    t: float
    position: Vec3  # landing point, m
    velocity: Vec3  # m/s
    covariance: Mat3  # of position, m^2
    heading: float | None  # rad; None: not known well enough
    sigma_heading: float  # rad
    sighting_t: float  # exposure of the last sighting accepted, s

    @property
    def sigma_m(self) -> float:
        """Root of the largest variance along an axis, m."""
        c = self.covariance
        return math.sqrt(max(c[0][0], c[1][1], c[2][2]))


class PadFilter:
    """One pad's state. Call `update` with every placed sighting in the order of exposure."""

    def __init__(self, options: EstimationSection) -> None:
        self._q = options.pad_acceleration_mps2**2  # spectral density over a correlation of 1 s
        self._gate = options.gate_sigma**2
        self._hits = 0
        self._rejections = 0
        self.rejected = 0  # sightings refused so far
        self._t = -math.inf
        self._position: Vec3 = (0.0, 0.0, 0.0)
        self._velocity: Vec3 = (0.0, 0.0, 0.0)
        self._Ppp: Mat3 = IDENTITY
        self._Ppv: Mat3 = IDENTITY  # covariance of position with velocity
        self._Pvv: Mat3 = IDENTITY
        self._heading: float | None = None
        self._heading_variance = 0.0
        self._heading_rejections = 0

    def reset(self) -> None:
        """Forget the pad."""
        self._hits = 0
        self._heading = None

    def update(self, candidates: list[PlacedPad]) -> bool:
        """Take the likeliest candidate of one frame in; tell whether it was accepted.

        Args:
            candidates: the same frame's pose solutions, one or two, in local NED.
        """
        candidates = [c for c in candidates if c.tilt < MAX_TILT + 2.0 * c.sigma_tilt]
        if not candidates:
            return False
        t = candidates[0].t
        gap = MAX_GAP_S if self._hits >= CONFIRM else CONFIRM_GAP_S
        if self._hits == 0 or t - self._t > gap:
            self._start(min(candidates, key=_image_and_level))
            return False
        if t <= self._t:
            return False
        self._predict(t)
        best = min(candidates, key=lambda c: _image_and_level(c) + self._distance(c))
        if not self._distance(best) <= self._gate:  # so that NaN is outside
            self.rejected += 1
            self._rejections += 1
            if self._rejections >= REJECTIONS:
                self._start(best)
            return False
        self._rejections = 0
        self._hits += 1
        self._correct(best)
        return self._hits >= CONFIRM

    def estimate(self, now: float, sighting_t: float) -> PadEstimate | None:
        """Return the state predicted to now, or None while no pad is confirmed."""
        if self._hits < CONFIRM:
            return None
        dt = max(0.0, now - self._t)
        sigma_heading = math.sqrt(self._heading_variance + HEADING_WALK**2 * dt)
        return PadEstimate(
            t=now,
            position=add(self._position, scale(self._velocity, dt)),
            velocity=self._velocity,
            covariance=self._predicted_position_covariance(dt),
            heading=self._heading if sigma_heading < MAX_SIGMA_HEADING else None,
            sigma_heading=sigma_heading,
            sighting_t=sighting_t,
        )

    def _start(self, seen: PlacedPad) -> None:
        self._t = seen.t
        self._hits = 1
        self._rejections = 0
        self._position = seen.position
        self._velocity = (0.0, 0.0, 0.0)
        self._Ppp = seen.covariance
        self._Ppv = matscale(IDENTITY, 0.0)
        self._Pvv = matscale(IDENTITY, INITIAL_SPEED_MPS**2)
        self._heading = seen.heading
        self._heading_variance = seen.sigma_heading**2 if seen.heading is not None else 0.0
        self._heading_rejections = 0

    def _predicted_position_covariance(self, dt: float) -> Mat3:
        cross = matadd(self._Ppv, transpose(self._Ppv))
        grown = matadd(matadd(self._Ppp, matscale(cross, dt)), matscale(self._Pvv, dt * dt))
        return matadd(grown, matscale(IDENTITY, self._q * dt**3 / 3.0))

    def _predict(self, t: float) -> None:
        dt = t - self._t
        self._t = t
        self._position = add(self._position, scale(self._velocity, dt))
        self._Ppp = self._predicted_position_covariance(dt)
        self._Ppv = matadd(
            matadd(self._Ppv, matscale(self._Pvv, dt)), matscale(IDENTITY, self._q * dt * dt / 2.0)
        )
        self._Pvv = matadd(self._Pvv, matscale(IDENTITY, self._q * dt))
        self._heading_variance += HEADING_WALK**2 * dt

    def _distance(self, seen: PlacedPad) -> float:
        """Squared Mahalanobis distance of the innovation, to be compared with the gate's."""
        innovation = sub(seen.position, self._position)
        return dot(innovation, rotate(inverse(matadd(self._Ppp, seen.covariance)), innovation))

    def _correct(self, seen: PlacedPad) -> None:
        innovation = sub(seen.position, self._position)
        S_inverse = inverse(matadd(self._Ppp, seen.covariance))
        K_p = matmul(self._Ppp, S_inverse)
        K_v = matmul(transpose(self._Ppv), S_inverse)
        self._position = add(self._position, rotate(K_p, innovation))
        self._velocity = add(self._velocity, rotate(K_v, innovation))
        self._Pvv = _symmetric(matadd(self._Pvv, matscale(matmul(K_v, self._Ppv), -1.0)))
        self._Ppv = matadd(self._Ppv, matscale(matmul(K_p, self._Ppv), -1.0))
        self._Ppp = _symmetric(matadd(self._Ppp, matscale(matmul(K_p, self._Ppp), -1.0)))
        if seen.heading is not None:
            self._correct_heading(seen.heading, seen.sigma_heading**2)

    def _correct_heading(self, heading: float, variance: float) -> None:
        if self._heading is None:
            self._heading, self._heading_variance = heading, variance
            return
        innovation = wrap(heading - self._heading)
        s = self._heading_variance + variance
        if innovation * innovation > self._gate * s:
            self._heading_rejections += 1
            if self._heading_rejections >= REJECTIONS:
                self._heading, self._heading_variance = heading, variance
                self._heading_rejections = 0
            return
        self._heading_rejections = 0
        k = self._heading_variance / s
        self._heading = wrap(self._heading + k * innovation)
        self._heading_variance *= 1.0 - k


def _image_and_level(c: PlacedPad) -> float:
    """Chi-square of a pose: what the picture says, and that pads lie nearly level."""
    return c.cost + (c.tilt / math.hypot(SIGMA_TILT, c.sigma_tilt)) ** 2


def _symmetric(m: Mat3) -> Mat3:
    """Average with the transpose: rounding would otherwise pull the two halves apart."""
    return matscale(matadd(m, transpose(m)), 0.5)
