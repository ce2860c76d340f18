"""The noises that the pad filter assumes, adapted to its innovations (Mehra 1970).

Constants without another origin were chosen as those of `pad_filter`.
"""

import math

from landerd.estimation.motion_filter import Innovation, MotionFilter
from landerd.estimation.observation import PadObservation
from landerd.geometry import (
    ZERO,
    Mat3,
    clamp,
    diagonal,
    dot,
    matadd,
    matscale,
    outer,
    rotate,
    rotate_covariance,
)

MIN_ACCELERATION_MPS2, MAX_ACCELERATION_MPS2 = 0.05, 2.0  # bounds of the adapted root of q
# A deck that surely went up or down at v (m/s) turns about within seconds: q is no less than this
# part (1/s) of v^2, and so for a while, s. Between its turns nothing tells so, and seen worse for a
# moment (by its tag alone, 7 % of the range unsure) it was taken to go straight on: it came up at
# 0.1 m/s while it was said to sink at 0.16, with a sigma of 0.06. From farther away than this, m,
# ranges err as decks heave.
HEAVE_SHARE, HEAVE_KEPT_S, HEAVE_SEEN_M = 0.25, 20.0, 5.0
# How fast the assumed noises follow the innovations, per s, and per frame at least and at most: in
# a landing of 15 s a camera of 15 frames a second learned half of what one of 30 did, and its
# innovations stayed a quarter smaller than expected.
ADAPTATION_PER_S, ADAPTATION_PER_FRAME = 1.5, (0.05, 0.1)
OF_EXPECTED_SHARE = 0.1  # of the newest innovation in the mean of how large they are
NOISE_SCALE_RANGE = (0.01, 100.0)  # of the white noise's variance, times what is said of it
OUTLIER_FACTOR = 4.0  # an innovation beyond the NIS limit by this tells nothing of the noise
# Swing of the lens's direction with the airframe (gimbal or clock a little late), 1 sigma, rad: it
# is alike from frame to frame and yet no motion of the pad. Without it a vehicle in calm air
# leaned 5 degrees to and fro after its own swinging. The faster airframe and gimbal turn the more
# it is: by so many of the standard deviations that the times of their angles are said to have. A
# nimble vehicle over a pad at 1 m/s, its gimbal's clock known to 6 ms, took that for a pad of
# 2 m/s^2, and the clocks, of which nothing tells then, went astray by 25 ms.
SIGMA_SWING, SWING_LATE_SIGMAS = 0.001, 2.0


class NoiseAdaptation:
    """Adapts the white noise of sightings, and the pad's process noise."""

    def __init__(self, nis_limit: float) -> None:
        """Make one; innovations beyond such a NIS are refused by the filter."""
        self._nis_limit = nis_limit
        self.start(-math.inf)

    def start(self, t: float) -> None:
        """Begin anew at time t, s."""
        # White noise's variance over what it is said to be: across the line of sight, and along it.
        self._noise_scale = (1.0, 1.0)
        self._last_t = t
        self._last_innovation = ZERO  # the position's, m
        self._of_expected = (1.0, 1.0)  # innovations' variance over the expected, level and down
        self._heave_squared = 0.0  # of the fastest surely seen lately, m^2/s^2

    def white(self, seen: PadObservation) -> Mat3:
        """Return what is new in every frame as it was learned, m^2.

        Errors, not covariances, are stretched: where range and place err together the sum of two
        scaled parts would be no covariance.
        """
        across, along = (math.sqrt(scale) for scale in self._noise_scale)
        d = seen.sight
        stretch = matadd(diagonal(across, across, across), matscale(outer(d, d), along - across))
        return rotate_covariance(stretch, seen.covariance)

    def adapt(self, seen: PadObservation, innovation: Innovation, motion: MotionFilter) -> None:
        """Let the assumed noises follow the innovations (Mehra 1970).

        They should be as large as their covariance says, or the frames' noise is another one; and
        not like the one before, or the pad moves otherwise than assumed. What comes of a swinging
        airframe (a gimbal or a clock a little late) is alike from frame to frame too. Taken for
        the pad's motion it would be flown after, and so keep the airframe swinging.

        Args:
            seen: the likeliest observation of a frame.
            innovation: of it.
            motion: whose process noise it adapts.
        """
        if not innovation.nis <= OUTLIER_FACTOR * self._nis_limit:  # so that NaN is outside
            return
        dt, self._last_t = seen.t - self._last_t, seen.t
        rate = clamp(ADAPTATION_PER_S * dt, *ADAPTATION_PER_FRAME)
        self._adapt_noise(seen, innovation, rate)
        x, y, z = innovation.vector
        u, v, w = self._last_innovation
        self._last_innovation = innovation.vector
        S, R = innovation.S, self.white(seen)
        expected = S[0][0] + S[1][1]
        late = seen.telemetry_noise
        by_swing = 2.0 * (SIGMA_SWING * seen.range_m) ** 2
        by_swing += SWING_LATE_SIGMAS**2 * (late[0][0] + late[1][1])
        horizontal = (x * u + y * v - min(expected, by_swing)) / expected
        level, down = self._of_expected
        level += OF_EXPECTED_SHARE * ((x * x + y * y) / expected - level)
        down += OF_EXPECTED_SHARE * (z * z / S[2][2] - down)
        self._of_expected = (level, down)
        horizontal += _too_wide(level, (R[0][0] + R[1][1]) / expected)
        vertical = z * w / S[2][2] + _too_wide(down, R[2][2] / S[2][2])
        q_north, _, q_down = motion.q
        q_north = _adapted(q_north, horizontal, rate)
        q_down = _adapted(q_down, vertical, rate)
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
            _scaled(across, 0.5 * max(0.0, nis - in_range), rate),
            _scaled(along, min(in_range, self._nis_limit), rate),
        )


def _scaled(noise_scale: float, nis: float, rate: float) -> float:
    """Return the scale of a variance after an innovation of this NIS for each degree of freedom."""
    return clamp(noise_scale * math.exp(rate * (nis - 1.0)), *NOISE_SCALE_RANGE)


def _too_wide(of_expected: float, noise_share: float) -> float:
    """Return what process noise falls by because innovations are smaller than expected, at most 0.

    Where it is far larger than the sightings' noise, every sighting is taken as it is: successive
    innovations do not tell then that it is too large, and it stayed so for minutes.

    Args:
        of_expected: innovations' variance lately, over the expected one.
        noise_share: of the expected one, what is the sightings' noise.
    """
    return 2.0 * min(0.0, of_expected - 0.5) * max(0.0, 1.0 - noise_share)


def _adapted(q: float, correlation: float, rate: float) -> float:
    """Return the process noise q (m^2/s^3) after two innovations that correlate so.

    The correlation is in units of their expected variance: 0 on average where q is right.
    """
    changed = q * math.exp(rate * clamp(correlation, -3.0, 3.0))
    return clamp(changed, MIN_ACCELERATION_MPS2**2, MAX_ACCELERATION_MPS2**2)
