"""The pad in local NED: which of a frame's poses to believe, and what follows from all of them.

Each sighting is taken at its exposure time, so a late picture corrects the state it belongs to and
the state is predicted from there to now. Of two solutions the likelier is taken: by the picture, by
where the pad should be, and by how it lay before.
"""

import math
from dataclasses import dataclass, replace

from landerd.config.models import EstimationSection
from landerd.estimation.heading_filter import HeadingFilter
from landerd.estimation.motion_filter import Innovation, MotionFilter
from landerd.estimation.placement import PlacedPad
from landerd.geometry import Mat3, Vec3, add, clamp, matscale, scale, unit

CONFIRM = 3  # consistent sightings before a pad is believed: one false alarm must not fly
REJECTIONS = 5  # sightings in a row outside the gate before the filter starts again from them
CONFIRM_GAP_S = 0.3  # between them: over a longer gap a false alarm and the pad make a fast pad
MAX_GAP_S = 2.0  # without a sighting for so long the old state says nothing about the new one
INITIAL_SPEED_MPS = (8.0, 8.0, 1.0)  # 1 sigma of a new pad's velocity, local NED
MAX_TILT = math.radians(25.0)  # what lies steeper is no pad, whatever it looks like
SIGMA_TILT = math.radians(6.0)  # how far from level pads usually lie
TILT_WALK = math.radians(2.0)  # rad per sqrt(s): how decks roll
COMMON_S = 120.0  # correlation time of the gimbal's and the clock's errors
ADAPT = 0.05  # a frame: how fast the assumed noises follow what the innovations show
NOISE_RANGE = (0.05, 100.0)  # of the frames' variance, times what vision and configuration say
OUTLIER = 4.0  # an innovation beyond the gate by this factor tells nothing of the noise
CALMEST_MPS2, WILDEST_MPS2 = 0.05, 2.0  # how little and how much acceleration of a pad is assumed
SWINGING = 0.001  # rad: so far off is the lens's direction that swings as the airframe does

MAX_SIGMA_HEADING = math.radians(5.0)  # a heading less certain than this is not known


@dataclass(frozen=True, slots=True)
class PadEstimate:
    """The pad at one time, local NED."""

    t: float
    position: Vec3  # landing point, m
    velocity: Vec3  # m/s
    covariance: Mat3  # of position, m^2
    sigma_velocity: Vec3  # m/s
    heading: float | None  # rad; None: not known well enough
    sigma_heading: float  # rad
    turn_rate: float  # rad/s; 0 without heading
    normal: Vec3  # unit vector into the pad
    sighting_t: float  # exposure of the last sighting accepted, s

    def moved(self, now: float) -> "PadEstimate":
        """Return the pad at another time if it goes on as it did."""
        return replace(self, t=now, position=add(self.position, scale(self.velocity, now - self.t)))

    @property
    def sigma_m(self) -> float:
        """Root of the largest variance along an axis, m."""
        c = self.covariance
        return math.sqrt(max(c[0][0], c[1][1], c[2][2]))


class PadFilter:
    """One pad's state. Call `update` with every placed sighting in the order of exposure."""

    def __init__(self, options: EstimationSection) -> None:
        bearing = math.radians(options.gimbal_sigma_deg)
        self._motion = MotionFilter((bearing, bearing, options.clock_sigma_s), COMMON_S)
        self._q = options.pad_acceleration_mps2**2
        self._heading = HeadingFilter(options.gate_sigma)
        self._bearing = bearing
        self._gate = options.gate_sigma**2
        self._hits = 0
        self._rejections = 0
        self._lean = (0.0, 0.0)  # of the normal from gravity, local north and east, rad
        self._lean_variance = SIGMA_TILT**2
        self._noise = 1.0  # variance of what is new in a frame, times what it is said to be
        self._last_vector: Vec3 = (0.0, 0.0, 0.0)  # innovation before this
        self.rejected = 0  # sightings refused so far
        # Of the last update's innovation, refused or not: chi-square of 3, 3 on average; NaN where
        # there was nothing to compare with.
        self.nis = math.nan

    @property
    def common(self) -> Vec3:
        """Errors common to all frames: lens about camera x and y (rad), clock (s)."""
        return self._motion.common

    def reset(self) -> None:
        """Forget the pad, and all that is known of the gimbal."""
        self._hits = 0
        self._heading.reset()
        self._motion.forget_common()

    def shift(self, by: Vec3) -> None:
        """The autopilot's local frame jumped: what was at x is now at x + by, m."""
        self._motion.shift(by)

    def update(self, candidates: list[PlacedPad]) -> bool:
        """Take the likeliest candidate of one frame in; tell whether it was accepted.

        Args:
            candidates: the same frame's pose solutions, one or two, in local NED.
        """
        self.nis = math.nan
        candidates = [c for c in candidates if c.tilt < MAX_TILT + 2.0 * c.sigma_tilt]
        if not candidates:
            return False
        t = candidates[0].t
        motion = self._motion
        gap = MAX_GAP_S if self._hits >= CONFIRM else CONFIRM_GAP_S
        if self._hits == 0 or t - motion.t > gap:
            self._start(min(candidates, key=_image_and_level))
            return False
        if t <= motion.t:
            return False
        self._lean_variance += TILT_WALK**2 * (t - motion.t)
        motion.predict(t)
        innovations = [self._innovation(c) for c in candidates]
        costs = [
            self._image_and_lean(c) + i.distance
            for c, i in zip(candidates, innovations, strict=True)
        ]
        chosen = costs.index(min(costs))
        best, innovation = candidates[chosen], innovations[chosen]
        self.nis = innovation.distance
        self._adapt(best, innovation)
        if not self.nis <= self._gate:  # so that NaN is outside
            self.rejected += 1
            self._rejections += 1
            if self._rejections >= REJECTIONS:
                self._start(best)
            return False
        self._rejections = 0
        self._hits += 1
        motion.correct(innovation)
        self._correct_lean(best)
        if best.heading is not None:
            self._heading.update(t, best.heading, best.sigma_heading)
            motion.turn_rate = self._heading.turn_rate
        return self._hits >= CONFIRM

    def estimate(self, now: float, sighting_t: float) -> PadEstimate | None:
        """Return the state predicted to now, or None while no pad is confirmed."""
        if self._hits < CONFIRM:
            return None
        position, velocity, covariance = self._motion.at(max(0.0, now - self._motion.t))
        heading, sigma_heading = self._heading.at(now) if self._heading.known else (0.0, math.inf)
        known = sigma_heading < MAX_SIGMA_HEADING
        return PadEstimate(
            t=now,
            position=position,
            velocity=velocity,
            covariance=covariance,
            sigma_velocity=self._motion.sigma_velocity,
            heading=heading if known else None,
            sigma_heading=sigma_heading,
            turn_rate=self._heading.turn_rate if known else 0.0,
            normal=unit((*self._lean, 1.0)),
            sighting_t=sighting_t,
        )

    def _start(self, seen: PlacedPad) -> None:
        self._hits = 1
        self._rejections = 0
        self._motion.q = (self._q, self._q, self._q)
        self._last_vector = (0.0, 0.0, 0.0)
        self._noise = 1.0
        self._motion.start(seen.t, seen.position, seen.covariance, seen.common, INITIAL_SPEED_MPS)
        self._lean = (0.0, 0.0)
        self._lean_variance = SIGMA_TILT**2
        self._correct_lean(seen)
        self._heading.reset()
        self._motion.turn_rate = 0.0
        if seen.heading is not None:
            self._heading.update(seen.t, seen.heading, seen.sigma_heading)

    def _innovation(self, seen: PlacedPad) -> Innovation:
        # A pad that the vehicle goes along with hides the clock's error.
        v = self._motion.velocity
        a, b, c = seen.common
        common = (
            (a[0], a[1], a[2] - v[0]),
            (b[0], b[1], b[2] - v[1]),
            (c[0], c[1], c[2] - v[2]),
        )
        return self._motion.innovation(
            seen.position, matscale(seen.covariance, self._noise), common
        )

    def _adapt(self, seen: PlacedPad, innovation: Innovation) -> None:
        """Let the assumed noises follow the innovations (Mehra 1970).

        They should be as large as their covariance says, or the frames' noise is another one; and
        not like the one before, or the pad moves otherwise than assumed. What comes of a swinging
        airframe (a gimbal or a clock a little late) is alike from frame to frame too. Taken for
        the pad's motion it would be flown after, and so keep the airframe swinging.
        """
        if not self.nis <= OUTLIER * self._gate:  # so that NaN is outside
            return
        distance = min(self.nis, self._gate)
        noise = self._noise * math.exp(ADAPT * (distance / 3.0 - 1.0))
        self._noise = clamp(noise, *NOISE_RANGE)
        x, y, z = innovation.vector
        u, v, w = self._last_vector
        self._last_vector = innovation.vector
        S = innovation.S
        expected = S[0][0] + S[1][1]
        swinging = min(expected, 2.0 * (SWINGING * seen.range_m) ** 2)
        level = (x * u + y * v - swinging) / expected
        q_north, _, q_down = self._motion.q
        q_north = _drifted(q_north, level)
        self._motion.q = (q_north, q_north, _drifted(q_down, z * w / S[2][2]))

    def _image_and_lean(self, c: PlacedPad) -> float:
        """Chi-square of a pose: what the picture says, and how the pad lay before."""
        north, east = c.normal[0] - self._lean[0], c.normal[1] - self._lean[1]
        variance = self._lean_variance + c.sigma_tilt**2 + self._bearing**2
        return c.cost + (north * north + east * east) / variance

    def _correct_lean(self, seen: PlacedPad) -> None:
        s = self._lean_variance + seen.sigma_tilt**2 + self._bearing**2
        k = self._lean_variance / s
        north, east = self._lean
        self._lean = (
            north + k * (seen.normal[0] - north),
            east + k * (seen.normal[1] - east),
        )
        self._lean_variance *= 1.0 - k


def _drifted(q: float, likeness: float) -> float:
    """Return the process noise after an innovation that is so much like the one before."""
    changed = q * math.exp(ADAPT * clamp(likeness, -3.0, 3.0))
    return clamp(changed, CALMEST_MPS2**2, WILDEST_MPS2**2)


def _image_and_level(c: PlacedPad) -> float:
    """Chi-square of a pose: what the picture says, and that pads lie nearly level."""
    return c.cost + (c.tilt / math.hypot(SIGMA_TILT, c.sigma_tilt)) ** 2
