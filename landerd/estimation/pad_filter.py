"""The pad's state in local NED, estimated from the poses that are accepted.

The filter stands at the exposure of the newest sighting, and estimates are predicted from there to
now: a late picture thus corrects the state it belongs to. Of a frame's two pose solutions the
likelier is used: by its fit to the picture, its innovation, and the pad's tilt so far.

Constants below without a stated source were chosen by trial in the simulator: with them every row
of `landerd campaign guidance` reaches what config/campaigns/guidance.yaml asks of it, consistent
innovations (`nis_deviation`) included.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from landerd.config.models import EstimationSection
from landerd.estimation.bias_linearisation import (
    RANGE_TIME_CONSTANT_S,
    BiasLinearisation,
    apparent_shift,
)
from landerd.estimation.heading_filter import HeadingFilter
from landerd.estimation.inconsistency import Inconsistency
from landerd.estimation.motion_filter import Innovation, Jacobian, MotionFilter
from landerd.estimation.noise_adaptation import MAX_ACCELERATION_MPS2, SIGMA_SWING, NoiseAdaptation
from landerd.estimation.observation import Clocks, PadObservation
from landerd.estimation.tilt_filter import TiltFilter, cost_by_level
from landerd.geometry import (
    ZERO,
    Mat3,
    Vec3,
    add,
    diagonal,
    largest_sigma,
    matadd,
    matscale,
    norm,
    outer,
    scale,
    sub,
)

# ---- when a pad is known -----------------------------------------------------------------------
# Consistent sightings before a pad counts: nothing is flown after a single false alarm. They span
# this time at least, s, so that the camera has turned to what it saw at the edge of a picture:
# there the surroundings that tell one ring from another may be out of the picture.
SIGHTINGS_TO_CONFIRM, CONFIRM_S = 3, 0.4
# The same as CONFIRM_S if no sighting showed these surroundings: a slow gimbal with a narrow view
# takes longer, and a vehicle that flies past may never get it there.
CONFIRM_UNTOLD_S = 2.0
# Longest gap between them, s. With 2 s a false alarm and the true pad were joined into a pad that
# moved at 3 to 6 m/s.
MAX_CONFIRM_GAP_S = 0.3
MAX_GAP_S = 2.0  # after a longer gap without sightings the filter restarts from the next
REJECTIONS_TO_RESTART = 5  # in a row and close together: the pad is there, the estimate is wrong
# Largest speed at which successive refused sightings may move and still be of one object: the
# fastest pad, seen from a vehicle that does not know its own speed.
FASTEST_PAD_MPS = 15.0
# Steps of the autopilot's position are smaller than this (GPS glitches that its EKF accepts are),
# and not more frequent.
MAX_STEP_M, STEP_GAP_S = 0.5, 1.0
MAX_SIGMA_HEADING = math.radians(5.0)  # rad; a heading less certain than this counts as unknown

# ---- what is assumed of pads -------------------------------------------------------------------
SIGMA_INITIAL_VELOCITY_MPS = (8.0, 8.0, 1.0)  # of a new pad, local NED: `moving-15` is 2 sigma
MAX_TILT = math.radians(25.0)  # rad; nothing steeper is a pad

# ---- what is assumed of the measurement --------------------------------------------------------
SIGMA_GIMBAL_CLOCK_S = 0.015  # of the gimbal's clock against the pictures'
SIGMA_HEADING = math.radians(2.0)  # rad, of the autopilot's heading
BIAS_TIME_CONSTANT_S = 120.0  # of the Gauss-Markov errors of lens direction and gimbal's clock
# Of the pictures' clock, whose offset is constant for a flight. With 120 s it was learned at 15 m
# and then spoiled low over the pad by other errors that look like it (bench/sensor_errors.py).
CLOCK_TIME_CONSTANT_S = 1200.0
# Slowly varying errors (backlash of a gimbal, wander of the position) are followed by the vehicle,
# and so are correlated with its motion, just as the effect of a clock error is. Low over the pad,
# where the vehicle moves little, they were taken for a clock 8 ms later on average, with a stated
# sigma of 3 ms. This white noise is as uninformative about the clock (see `MotionFilter.correct`);
# chosen on 30 days of the field world. With 0.005 m a clock that was known well moved by 25 ms
# within 10 s of hover 1 m over a pad.
COLOURED_RAD, COLOURED_M = 0.003, 0.015  # in proportion to the range, and constant


class PadEstimate(NamedTuple):
    """The pad at one time, local NED."""

    t: float
    position: Vec3  # landing point, m
    velocity: Vec3  # m/s
    covariance: Mat3  # of position, m^2
    sigma_velocity: float  # of its horizontal part, m/s
    sigma_heave: float  # of its vertical part, m/s
    heading: float | None  # rad; None: not known well enough
    sigma_heading: float  # rad
    turn_rate: float  # of the heading, rad/s; 0 without heading
    normal: Vec3  # unit vector into the pad, local NED
    coupling: float = 1.0  # share of the turn rate that the velocity turns at: 0 to 1

    def moved(self, now: float) -> "PadEstimate":
        """Return the pad at another time (s), at constant velocity."""
        ahead = scale(self.velocity, now - self.t)
        return self._replace(t=now, position=add(self.position, ahead))

    @property
    def sigma_m(self) -> float:
        """Largest sigma of the position, horizontal or vertical, m."""
        return largest_sigma(self.covariance)


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Estimated errors of camera and gimbal that all frames have in common.

    An error of the camera's clock cannot be told from one of TIMESYNC, nor one of the mounting from
    one of the gimbal's angles: these are their sums.
    """

    clock_s: float  # how late pictures are stamped, s
    sigma_clock_s: float
    gimbal_clock_s: float  # how much earlier than the attitude gimbal angles are stamped, s
    sigma_gimbal_clock_s: float
    up: float  # how much higher the lens looks than the gimbal's angles say, rad
    right: float  # how much farther to the right, rad
    sigma_up: float  # rad
    sigma_right: float  # rad


class PadFilter:
    """State of one pad. Call `update` with each frame's observations in the order of exposure.

    Attributes:
        rejected: number of sightings refused so far.
        nis: normalised innovation squared of the last update, refused or not: chi-square with 3
            degrees of freedom, 3 on average; NaN where there was nothing to compare with.
        inconsistency: the run of newest sightings that were farther off than noise explains.
    """

    def __init__(self, options: EstimationSection) -> None:
        bearing = math.radians(options.gimbal_sigma_deg)
        self._motion = MotionFilter(
            (
                (bearing, bearing, options.clock_sigma_s),
                (SIGMA_GIMBAL_CLOCK_S, 1.0, SIGMA_HEADING),
            ),
            (
                (BIAS_TIME_CONSTANT_S, BIAS_TIME_CONSTANT_S, CLOCK_TIME_CONSTANT_S),
                (BIAS_TIME_CONSTANT_S, RANGE_TIME_CONSTANT_S, BIAS_TIME_CONSTANT_S),
            ),
        )
        self._q = options.pad_acceleration_mps2**2
        self._heading = HeadingFilter(options.gate_sigma)
        self._sigma_clock = options.clock_sigma_s
        self._nis_limit = options.gate_sigma**2
        self._accepted = 0  # sightings since the filter started; 0: nothing is known
        self._accepted_t = -math.inf
        self._first_t = -math.inf  # first of the sightings that are to confirm the pad
        self._is_told = False  # one of them showed that it is no other
        self._rejections = 0  # in a row and close together
        self._refused_t = self._stepped_t = -math.inf
        self.inconsistency = Inconsistency()
        self._refused_step = ZERO  # innovation of the last one refused, m
        self._tilt = TiltFilter(bearing)
        self._noise = NoiseAdaptation(self._nis_limit)
        self._biases = BiasLinearisation()
        self.rejected = 0
        self.nis = math.nan

    @property
    def clocks(self) -> Clocks:
        """The estimated offsets of the clocks."""
        (_, _, pictures), (gimbal, _, _) = self._motion.biases
        return Clocks(pictures, gimbal)

    @property
    def sensor_errors(self) -> SensorErrors:
        """The estimated biases, with their standard deviations."""
        motion = self._motion
        (about_x, about_y, clock), (gimbal, _, _) = motion.biases
        b, g = motion.Pbb, motion.Pgg
        return SensorErrors(
            clock_s=clock,
            sigma_clock_s=math.sqrt(b[2][2]),
            gimbal_clock_s=gimbal,
            sigma_gimbal_clock_s=math.sqrt(g[0][0]),
            up=about_x,
            right=about_y,
            sigma_up=math.sqrt(b[0][0]),
            sigma_right=math.sqrt(b[1][1]),
        )

    def apparent_shift(self, B: Jacobian) -> Vec3:
        """Return measured minus true position that the biases cause, but for the clocks', m."""
        return apparent_shift(self._motion, B)

    def reset(self) -> None:
        """Forget the pad and the biases."""
        self._accepted = 0
        self._heading.reset()
        self._motion.forget_bias()

    def on_clock(self, uncertainty_s: float) -> None:
        """Take the uncertainty of the autopilot's clock, s: that of the pictures' includes it."""
        self._motion.assume_clock(math.hypot(self._sigma_clock, uncertainty_s))

    def update(self, observations: list[PadObservation], *, may_be_another: bool = False) -> bool:
        """Correct by the likeliest observation of one frame.

        Args:
            observations: of the same frame's pose solutions, none to two.
            may_be_another: whether they may be of another pad, see `Sightings`.

        Returns:
            whether it was accepted, and the pad is confirmed.
        """
        self.nis = math.nan
        possible = [o for o in observations if o.tilt < MAX_TILT + 2.0 * o.sigma_tilt]
        if not possible:
            return False
        t = possible[0].t
        max_gap = MAX_GAP_S if self._is_confirmed else MAX_CONFIRM_GAP_S
        if self._accepted == 0 or t - self._accepted_t > max_gap:
            self._first_t, self._is_told = t, not may_be_another
            self._start(min(possible, key=cost_by_level))
            return False
        if t <= self._motion.t:
            return False
        dt = t - self._motion.t
        self._tilt.predict(dt)
        self._motion.predict(t)
        best, innovation = self._likeliest(possible)
        if innovation.nis < 0.0:
            # The innovation's covariance is not positive: the state is not to be flown on.
            self.reset()
            return False
        self._biases.average(best, dt, self._motion.position[2])
        self.nis = innovation.nis
        self._noise.adapt(best, innovation, self._motion)
        is_likely = self.nis <= self._nis_limit  # NaN is not
        # A momentary step of the telemetry counts as noise: sight must not be lost for it.
        tolerant = innovation if is_likely else innovation.with_noise(best.step_noise)
        is_near = tolerant.nis <= self._nis_limit
        if is_likely:
            self.inconsistency.end(t)
        else:
            B = self._biases.jacobian(best, self._motion)
            self.inconsistency.look(self._motion.state, B, innovation, near=is_near)
            if self._follows_trend(best, innovation):
                tolerant, is_near = self._innovation(best), True
        if not is_near:
            return self._reject(best, tolerant)
        self._accept(best, tolerant)
        self._is_told = self._is_told or not may_be_another
        return self._is_confirmed

    @property
    def _is_confirmed(self) -> bool:
        lasts_s = self._accepted_t - self._first_t
        least_s = CONFIRM_S if self._is_told else CONFIRM_UNTOLD_S
        return self._accepted >= SIGHTINGS_TO_CONFIRM and lasts_s >= least_s

    def _follows_trend(self, seen: PadObservation, innovation: Innovation) -> bool:
        """Loosen the motion where the sightings' trend shows a manoeuvre; tell whether it does."""
        change = self.inconsistency.trend(seen.t, SIGMA_SWING * seen.range_m, self._nis_limit)
        if change is None:
            return False
        self._motion.loosen(innovation.vector, change)
        per_s = 1.0 / self.inconsistency.lasts_s
        north, east, down = (abs(v) * per_s for v in change)
        q_level, _, q_down = self._motion.q
        q_level = max(q_level, min(math.hypot(north, east), MAX_ACCELERATION_MPS2) ** 2)
        q_down = max(q_down, min(down, MAX_ACCELERATION_MPS2) ** 2)
        self._motion.q = (q_level, q_level, q_down)
        self.inconsistency.end(seen.t)
        return True

    def estimate(self, now: float) -> PadEstimate | None:
        """Return the state predicted to now, or None while no pad is confirmed."""
        return self._at(now) if self._is_confirmed else None

    def unconfirmed(self, now: float, within_s: float = MAX_CONFIRM_GAP_S) -> PadEstimate | None:
        """Return the state of a pad that was seen but is not confirmed, predicted to now.

        None without one, or when its last sighting is older than within_s. A new pad is taken to
        stand still until sightings say otherwise.
        """
        is_tried = self._accepted > 0 and not self._is_confirmed
        return self._at(now) if is_tried and now - self._accepted_t <= within_s else None

    def _at(self, now: float) -> PadEstimate:
        ahead_s = max(0.0, now - self._motion.t)
        position, velocity, covariance = self._motion.at(ahead_s)
        heading, sigma_heading = self._heading.at(now) if self._heading.known else (0.0, math.inf)
        known = sigma_heading < MAX_SIGMA_HEADING
        sigma_velocity, sigma_heave = self._motion.sigma_velocity(ahead_s)
        return PadEstimate(
            t=now,
            position=position,
            velocity=velocity,
            covariance=covariance,
            sigma_velocity=sigma_velocity,
            sigma_heave=sigma_heave,
            heading=heading if known else None,
            sigma_heading=sigma_heading,
            turn_rate=self._heading.sure_turn_rate if known else 0.0,
            normal=self._tilt.normal,
            coupling=self._motion.coupling,
        )

    def _start(self, seen: PadObservation) -> None:
        """Restart from one observation; the biases are kept."""
        self.inconsistency.end(seen.t)
        self._accepted = 1
        self._accepted_t = seen.t
        self._rejections = 0
        self._motion.q = (self._q, self._q, self._q)
        self._noise.start(seen.t)
        self._biases.start(seen)
        self._motion.start(
            seen.t,
            seen.position,
            seen.covariance,
            seen.biases.jacobian(seen.arm, seen.biases.range_share),
            SIGMA_INITIAL_VELOCITY_MPS,
        )
        self._tilt.reset()
        self._tilt.update(seen)
        self._heading.reset()
        self._motion.turn_rate = 0.0
        if seen.heading is not None:
            self._heading.update(seen.t, seen.heading, seen.sigma_heading)

    def _likeliest(self, possible: list[PadObservation]) -> tuple[PadObservation, Innovation]:
        innovations = [self._innovation(o) for o in possible]
        costs = [self._tilt.cost(o) + i.nis for o, i in zip(possible, innovations, strict=True)]
        chosen = costs.index(min(costs))
        return possible[chosen], innovations[chosen]

    def _innovation(self, seen: PadObservation) -> Innovation:
        # A clock error shifts the pad by its time times the velocity relative to the pad: flying
        # along with the pad hides it.
        motion = self._motion
        v = motion.velocity
        (a, b, c), by_gimbal = self._biases.jacobian(seen, motion)
        by_lens = (
            (a[0], a[1], a[2] - v[0]),
            (b[0], b[1], b[2] - v[1]),
            (c[0], c[1], c[2] - v[2]),
        )
        # The second-order term of velocity times clock error: while neither is known, the first-
        # order model would learn one from the other.
        unknown = matscale(motion.Pvv, motion.Pbb[2][2])
        noise = matadd(self._noise.white_noise(seen), matadd(seen.telemetry_noise, unknown))
        return motion.innovation(seen.position, noise, (by_lens, by_gimbal))

    def _reject(self, seen: PadObservation, innovation: Innovation) -> bool:
        """Refuse a sighting; tell whether it was accepted after all, as evidence of a step.

        Several refused in a row, close together, show that the pad is there. A little aside it is
        the same pad, and the telemetry's position or time has stepped: only the position's
        covariance grows. Farther away, or soon after another step, it is a new pad: restart.
        """
        self.rejected += 1
        step = innovation.vector
        apart = norm(sub(step, self._refused_step))
        reach = FASTEST_PAD_MPS * (seen.t - self._refused_t) + self._gate(innovation)
        self._rejections = self._rejections + 1 if apart <= reach else 1
        self._refused_step, self._refused_t = step, seen.t
        if self._rejections < REJECTIONS_TO_RESTART:
            return False
        if not (self._is_confirmed and self._is_step(seen.t, step)):
            if not self._is_confirmed:
                self._first_t, self._is_told = seen.t, False
            self._start(seen)
            return False
        self._stepped_t = seen.t
        self._motion.loosen(step, ZERO)
        self._accept(seen, innovation.with_noise(outer(step, step)))
        return True

    def _gate(self, innovation: Innovation) -> float:
        """Return the gate's largest radius for an innovation with this covariance, m."""
        return math.sqrt(self._nis_limit) * largest_sigma(innovation.S)

    def _is_step(self, t: float, step: Vec3) -> bool:
        return norm(step) < MAX_STEP_M and t - self._stepped_t > STEP_GAP_S

    def _accept(self, seen: PadObservation, innovation: Innovation) -> None:
        self._rejections = 0
        self._accepted += 1
        self._accepted_t = seen.t
        aside = (COLOURED_RAD * seen.range_m) ** 2 + COLOURED_M**2
        self._motion.correct(innovation, diagonal(aside, aside, aside))
        if not self._motion.is_sound:
            self._motion.forget_bias()
            self._start(seen)
            return
        self._tilt.update(seen)
        if seen.heading is not None:
            self._heading.update(seen.t, seen.heading, seen.sigma_heading)
            self._motion.turn_rate = self._heading.sure_turn_rate
