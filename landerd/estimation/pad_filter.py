"""The pad in local NED: which of a frame's poses to accept, and what follows from all of them.

Each sighting is taken at its exposure time, so a late picture corrects the state it belongs to and
the state is predicted from there to now. Of two solutions the likelier is taken: by the picture, by
where the pad should be, and by how it lay before.

Constants below without another origin were chosen by trial in the simulator: with them every row of
`landerd campaign guidance` reaches what config/campaigns/guidance.yaml asks of it, consistent
innovations (`nis_deviation`) included.
"""

import math
from dataclasses import dataclass, replace

from landerd.config.models import EstimationSection
from landerd.estimation.bias_linearisation import (
    RANGE_TIME_CONSTANT_S,
    BiasLinearisation,
    shown_by,
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
    matadd,
    matscale,
    norm,
    outer,
    scale,
    sub,
)

# ---- when a pad is known -----------------------------------------------------------------------
# Consistent sightings before a pad counts: one false alarm must not fly. And for so long, s, that
# the camera has turned to what it saw at the edge of a picture: there a ring cannot be told from
# another one by what lies beside it.
SIGHTINGS_TO_CONFIRM, CONFIRM_S = 3, 0.4
# Between those, s. With 2 s, one false alarm and the pad made a pad that flew at 3 to 6 m/s.
MAX_CONFIRM_GAP_S = 0.3
MAX_GAP_S = 2.0  # without a sighting for so long the old state says nothing about the new one
REJECTIONS_TO_RESTART = 5  # in a row and together: the pad is there, and not where it was thought
# How far a sighting may jump from the last one and be of the same thing: the fastest pad, seen from
# a vehicle that does not know its speed.
FASTEST_PAD_MPS = 15.0
# Steps of the autopilot's position are smaller (GPS glitches that its EKF takes are), and rare.
MAX_STEP_M, STEP_GAP_S = 0.5, 1.0
MAX_SIGMA_HEADING = math.radians(5.0)  # rad; a heading less certain than this is not known

# ---- what is assumed of pads -------------------------------------------------------------------
SIGMA_INITIAL_VELOCITY_MPS = (8.0, 8.0, 1.0)  # of a new pad, local NED: `moving-15` is 2 sigma
MAX_TILT = math.radians(25.0)  # rad; what lies steeper is no pad, whatever it looks like

# ---- what is assumed of the measurement --------------------------------------------------------
SIGMA_GIMBAL_CLOCK_S = 0.015  # of the gimbal's angles against the pictures, beside the autopilot's
SIGMA_HEADING = math.radians(2.0)  # rad, of the autopilot's heading
BIAS_TIME_CONSTANT_S = 120.0  # of the Gauss-Markov errors of lens direction and gimbal's clock
# Of the pictures' clock, which stays as it is for a flight. With 120 s it was known at 15 m, and
# forgotten low over the pad for whatever moved like it there (bench/sensor_errors.py).
CLOCK_TIME_CONSTANT_S = 1200.0
# What shows the pad aside for a while (a gimbal's backlash, a position that wanders) the vehicle
# flies after, and so it goes with the vehicle's own motion, as what a late clock shows does: low
# over the pad, where that moves little, it was taken for a clock 8 ms later on average, and that to
# 3 ms. Of white noise that tells as little of the clock; chosen on 30 days of the field world. With
# 0.005 m a clock that was known was moved by 25 ms within 10 s of hovering 1 m over a pad.
COLOURED_RAD, COLOURED_M = 0.003, 0.015  # of the range, and beside it


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
    coupling: float = 1.0  # of the turn rate, what the velocity turns with: 0 to 1

    def moved(self, now: float) -> "PadEstimate":
        """Return the pad at another time if it goes on as it did."""
        return replace(self, t=now, position=add(self.position, scale(self.velocity, now - self.t)))

    @property
    def sigma_m(self) -> float:
        """Root of the largest variance along an axis, m."""
        c = self.covariance
        return math.sqrt(max(c[0][0], c[1][1], c[2][2]))


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """What is wrong about camera and gimbal in all frames alike, as far as it is known.

    An error of the camera's clock cannot be told from one of TIMESYNC, nor one of the mounting from
    one of the gimbal's angles: these are their sums.
    """

    clock_s: float  # pictures are stamped so much late
    sigma_clock_s: float
    gimbal_clock_s: float  # the gimbal's angles are stamped so much earlier than the attitude
    sigma_gimbal_clock_s: float
    up: float  # the lens looks so much higher than is said, rad
    right: float  # and so much farther to the right
    sigma_up: float
    sigma_right: float


class PadFilter:
    """One pad's state. Call `update` with every frame's observations in the order of exposure.

    Attributes:
        rejected: sightings refused so far.
        nis: normalised innovation squared of the last update, refused or not: chi-square of 3
            degrees of freedom, 3 on average; NaN where there was nothing to compare with.
        inconsistency: whether the newest sightings were farther off than noise explains.
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
        self._accepted = 0  # sightings since the filter began; 0: nothing is known
        self._accepted_t = -math.inf
        self._first_t = -math.inf  # of the sightings that are to confirm it
        self._rejections = 0  # in a row, lying together
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
        """The clocks as far as they are known."""
        (_, _, pictures), (gimbal, _, _) = self._motion.biases
        return Clocks(pictures, gimbal)

    @property
    def sensor_errors(self) -> SensorErrors:
        """What the biases are, of the clock's beside what pictures were put right by."""
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

    def shown(self, B: Jacobian) -> Vec3:
        """Return how far from where it is the errors common to all frames show the pad, m."""
        return shown_by(self._motion, B)

    def reset(self) -> None:
        """Forget the pad, and what is known of the sensors' errors."""
        self._accepted = 0
        self._heading.reset()
        self._motion.forget_bias()

    def on_clock(self, uncertainty_s: float) -> None:
        """Take how well the autopilot's clock is known: the pictures' is known no better, s."""
        self._motion.assume_clock(math.hypot(self._sigma_clock, uncertainty_s))

    def update(self, observations: list[PadObservation]) -> bool:
        """Take the likeliest observation of one frame in; tell whether it was accepted.

        Args:
            observations: of the same frame's pose solutions, one or two.
        """
        self.nis = math.nan
        possible = [o for o in observations if o.tilt < MAX_TILT + 2.0 * o.sigma_tilt]
        if not possible:
            return False
        t = possible[0].t
        max_gap = MAX_GAP_S if self._is_confirmed else MAX_CONFIRM_GAP_S
        if self._accepted == 0 or t - self._accepted_t > max_gap:
            self._first_t = t
            self._start(min(possible, key=cost_by_level))
            return False
        if t <= self._motion.t:
            return False
        dt = t - self._motion.t
        self._tilt.predict(dt)
        self._motion.predict(t)
        best, innovation = self._likeliest(possible)
        if innovation.nis < 0.0:
            # What should be a covariance is none, and nothing that hangs on it is to be flown on.
            self.reset()
            return False
        self._biases.average(best, dt, self._motion.position[2])
        self.nis = innovation.nis
        self._noise.adapt(best, innovation, self._motion)
        is_likely = self.nis <= self._nis_limit  # NaN is not
        # Telemetry that steps for a moment is noise for this moment, and no reason to be blind.
        tolerant = innovation if is_likely else innovation.with_noise(best.hiccup)
        is_near = tolerant.nis <= self._nis_limit
        if is_likely:
            self.inconsistency.end(t)
        else:
            B = self._biases.jacobian(best, self._motion)
            self.inconsistency.look(self._motion.course, B, innovation, near=is_near)
            if self._follow(best, innovation):
                tolerant, is_near = self._innovation(best), True
        if not is_near:
            return self._reject(best, tolerant)
        self._accept(best, tolerant)
        return self._is_confirmed

    @property
    def _is_confirmed(self) -> bool:
        lasts_s = self._accepted_t - self._first_t
        return self._accepted >= SIGHTINGS_TO_CONFIRM and lasts_s >= CONFIRM_S

    def _follow(self, seen: PadObservation, innovation: Innovation) -> bool:
        """Tell whether the pad moves otherwise than it did, and know its motion the less."""
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
        """Return what an estimate would be of a pad that is seen, but not confirmed yet, else None.

        It is taken to stand, until sightings say otherwise. Seen longer ago than `within_s`: None.
        """
        is_tried = self._accepted > 0 and not self._is_confirmed
        return self._at(now) if is_tried and now - self._accepted_t <= within_s else None

    def _at(self, now: float) -> PadEstimate:
        position, velocity, covariance = self._motion.at(max(0.0, now - self._motion.t))
        heading, sigma_heading = self._heading.at(now) if self._heading.known else (0.0, math.inf)
        known = sigma_heading < MAX_SIGMA_HEADING
        return PadEstimate(
            t=now,
            position=position,
            velocity=velocity,
            covariance=covariance,
            sigma_velocity=self._motion.sigma_velocity(max(0.0, now - self._motion.t)),
            heading=heading if known else None,
            sigma_heading=sigma_heading,
            turn_rate=self._heading.sure_turn_rate if known else 0.0,
            normal=self._tilt.normal,
            coupling=self._motion.coupling,
        )

    def _start(self, seen: PadObservation) -> None:
        """Begin anew from one observation; the biases are kept."""
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
        # A pad that the vehicle goes along with hides the clock's error.
        motion = self._motion
        v = motion.velocity
        (a, b, c), by_gimbal = self._biases.jacobian(seen, motion)
        by_lens = (
            (a[0], a[1], a[2] - v[0]),
            (b[0], b[1], b[2] - v[1]),
            (c[0], c[1], c[2] - v[2]),
        )
        # While neither the pad's velocity nor the clock is known, one says nothing of the other:
        # the second-order term of their product.
        unknown = matscale(motion.Pvv, motion.Pbb[2][2])
        noise = matadd(self._noise.white(seen), matadd(seen.telemetry_noise, unknown))
        return motion.innovation(seen.position, noise, (by_lens, by_gimbal))

    def _reject(self, seen: PadObservation, innovation: Innovation) -> bool:
        """Refuse it; tell whether it was accepted after all, as evidence of a step.

        Sightings refused in a row that lie together say that the pad is there. A little aside it is
        the same pad, and position or time of the telemetry have stepped: the position is known less
        well, all else is kept. Farther away, or soon after a step, it is another one.
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
                self._first_t = seen.t
            self._start(seen)
            return False
        self._stepped_t = seen.t
        self._motion.loosen(step, ZERO)
        self._accept(seen, innovation.with_noise(outer(step, step)))
        return True

    def _gate(self, innovation: Innovation) -> float:
        """Return how far aside an innovation may be at most by its covariance, m."""
        S = innovation.S
        return math.sqrt(self._nis_limit * max(S[0][0], S[1][1], S[2][2]))

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
