"""Adapts the pad filter's measurement and process noise to its innovations (Mehra 1970).

Constants without a stated source were chosen like those of `pad_filter`.
"""

import math

from landerd.estimation.motion_filter import Innovation, MotionFilter
from landerd.estimation.observation import PadObservation
from landerd.geometry import (
    ZERO,
    Mat3,
    axial,
    clamp,
    dot,
    rotate,
    rotate_covariance,
)

MIN_ACCELERATION_MPS2, MAX_ACCELERATION_MPS2 = 0.05, 2.0  # bounds of the adapted root of q
# A deck that certainly heaved at v (m/s) will reverse within seconds: the vertical q stays at least
# HEAVE_SHARE (1/s) times v^2, with v decaying over HEAVE_KEPT_S. Innovations alone lower q between
# two reversals. When the deck was then seen worse for a moment (by its tag alone, range uncertain
# by 7 %), the filter assumed that it went straight on: it rose at 0.1 m/s while the estimate sank
# at 0.16 m/s with a sigma of 0.06. Beyond HEAVE_SEEN_M range errors look like heave.
HEAVE_SHARE, HEAVE_KEPT_S, HEAVE_SEEN_M = 0.25, 20.0, 5.0
# Rate at which the noises follow the innovations, per s, and its bounds per frame. With a rate per
# frame alone a camera of 15 frames/s learned half as much in a landing of 15 s as one of 30, and
# its innovations stayed a quarter smaller than expected.
ADAPTATION_PER_S, ADAPTATION_PER_FRAME = 1.5, (0.05, 0.1)
VARIANCE_RATIO_GAIN = 0.1  # of the exponential mean of squared innovations, per frame
NOISE_SCALE_RANGE = (0.01, 100.0)  # white noise's variance over the one that vision states
OUTLIER_FACTOR = 4.0  # innovations beyond the NIS limit by this factor are left out
# Swing of the lens's direction with the airframe (gimbal or clock a little late), 1 sigma, rad: it
# is correlated from frame to frame without being motion of the pad. Without this allowance a
# vehicle in calm air leaned 5 degrees to and fro, following its own swing. The allowance grows with
# the turn rates of airframe and gimbal: SWING_LATE_SIGMAS times what the jitter of their angles'
# times explains. Without that, a nimble vehicle over a pad at 1 m/s, with the gimbal's clock known
# to 6 ms, saw a pad that accelerated at 2 m/s^2, and the clocks' estimates drifted by 25 ms.
SIGMA_SWING, SWING_LATE_SIGMAS = 0.001, 2.0


class NoiseAdaptation:
    """Adapts the white noise of sightings and the process noise of the pad's motion."""

    def __init__(self, nis_limit: float) -> None:
        """Make one; nis_limit: the NIS beyond which the filter refuses a sighting."""
        self._nis_limit = nis_limit
        self.start(-math.inf)

    def start(self, t: float) -> None:
        """Start afresh at time t, s."""
        # Variance of the white noise over the stated one: across the line of sight, and along it.
        self._noise_scale = (1.0, 1.0)
        self._last_t = t
        self._last_innovation = ZERO  # of the position, m
        # Mean square of the innovations over their expected variance: horizontal, vertical.
        self._variance_ratio = (1.0, 1.0)
        self._heave_squared = 0.0  # of the fastest certain heave lately, m^2/s^2

    def white_noise(self, seen: PadObservation) -> Mat3:
        """Return the adapted covariance of a sighting's white noise, m^2.

        The error vector is scaled, not parts of its covariance: where the errors along and across
        the line of sight are correlated, the sum of two scaled parts might not be a covariance.
        """
        across, along = math.sqrt(self._noise_scale[0]), math.sqrt(self._noise_scale[1])
        stretch = axial(seen.sight, along - across, across)
        return rotate_covariance(stretch, seen.covariance)

    def adapt(self, seen: PadObservation, innovation: Innovation, motion: MotionFilter) -> None:
        """Let measurement and process noise follow the innovations (Mehra 1970).

        Innovations larger or smaller than their covariance says show that the measurement noise is
        another one; innovations correlated with the previous one show that the process noise is.
        The swing of the airframe (gimbal or clock a little late) is correlated too: taken for
        motion of the pad it would be followed, which keeps the airframe swinging.

        Args:
            seen: the likeliest observation of a frame.
            innovation: of that observation.
            motion: the filter whose process noise is adapted.
        """
        if not innovation.nis <= OUTLIER_FACTOR * self._nis_limit:  # so that NaN is outside
            return
        dt, self._last_t = seen.t - self._last_t, seen.t
        rate = clamp(ADAPTATION_PER_S * dt, *ADAPTATION_PER_FRAME)
        self._adapt_noise(seen, innovation, rate)
        x, y, z = innovation.vector
        u, v, w = self._last_innovation
        self._last_innovation = innovation.vector
        S, R = innovation.S, self.white_noise(seen)
        expected = S[0][0] + S[1][1]
        late = seen.telemetry_noise
        by_swing = 2.0 * (SIGMA_SWING * seen.range_m) ** 2
        by_swing += SWING_LATE_SIGMAS**2 * (late[0][0] + late[1][1])
        horizontal = (x * u + y * v - min(expected, by_swing)) / expected
        level, down = self._variance_ratio
        level += VARIANCE_RATIO_GAIN * ((x * x + y * y) / expected - level)
        down += VARIANCE_RATIO_GAIN * (z * z / S[2][2] - down)
        self._variance_ratio = (level, down)
        horizontal += _excess_process_noise(level, (R[0][0] + R[1][1]) / expected)
        vertical = z * w / S[2][2] + _excess_process_noise(down, R[2][2] / S[2][2])
        q_north, _, q_down = motion.q
        q_north = _adapted_process_noise(q_north, horizontal, rate)
        q_down = _adapted_process_noise(q_down, vertical, rate)
        self._watch_heave(seen, motion, dt)
        q_down = max(q_down, HEAVE_SHARE * self._heave_squared)
        motion.q = (q_north, q_north, q_down)

    def _watch_heave(self, seen: PadObservation, motion: MotionFilter, dt: float) -> None:
        surely = max(0.0, abs(motion.velocity[2]) - 2.0 * math.sqrt(motion.Pvv[2][2]))
        if seen.range_m > HEAVE_SEEN_M:
            surely = 0.0
        kept = self._heave_squared * math.exp(-dt / HEAVE_KEPT_S)
        self._heave_squared = max(kept, surely * surely)

    def _adapt_noise(self, seen: PadObservation, innovation: Innovation, rate: float) -> None:
        d = seen.sight
        off = dot(d, innovation.vector)
        in_range = off * off / dot(d, rotate(innovation.S, d))
        nis = min(innovation.nis, self._nis_limit)
        across, along = self._noise_scale
        self._noise_scale = (
            _adapted_noise_scale(across, 0.5 * max(0.0, nis - in_range), rate),
            _adapted_noise_scale(along, min(in_range, self._nis_limit), rate),
        )


def _adapted_noise_scale(noise_scale: float, nis: float, rate: float) -> float:
    """Return the variance's scale after an innovation with this NIS per degree of freedom."""
    return clamp(noise_scale * math.exp(rate * (nis - 1.0)), *NOISE_SCALE_RANGE)


def _excess_process_noise(variance_ratio: float, noise_share: float) -> float:
    """Return a correlation, at most 0, that lowers process noise where innovations are too small.

    Where process noise far exceeds the sightings' noise, the filter just follows each sighting:
    successive innovations are then uncorrelated although it is too large, and it stayed so for
    minutes.

    Args:
        variance_ratio: mean square of the innovations lately, over their expected variance.
        noise_share: share of the sightings' noise in that expected variance.
    """
    return 2.0 * min(0.0, variance_ratio - 0.5) * max(0.0, 1.0 - noise_share)


def _adapted_process_noise(q: float, correlation: float, rate: float) -> float:
    """Return the process noise q (m^2/s^3) after two innovations with this correlation.

    The correlation is over their expected variance: 0 on average where q is right.
    """
    changed = q * math.exp(rate * clamp(correlation, -3.0, 3.0))
    return clamp(changed, MIN_ACCELERATION_MPS2**2, MAX_ACCELERATION_MPS2**2)
