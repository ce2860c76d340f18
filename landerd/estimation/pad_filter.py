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
from landerd.estimation.heading_filter import HeadingFilter
from landerd.estimation.inconsistency import Inconsistency
from landerd.estimation.motion_filter import Innovation, Jacobian, MotionFilter
from landerd.estimation.observation import BiasModel, Clocks, PadObservation
from landerd.geometry import (
    ZERO,
    Mat3,
    Vec3,
    add,
    clamp,
    diagonal,
    dot,
    matadd,
    matscale,
    norm,
    outer,
    rotate,
    rotate_covariance,
    scale,
    sub,
    unit,
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
MIN_ACCELERATION_MPS2, MAX_ACCELERATION_MPS2 = 0.05, 2.0  # bounds of the adapted root of q
# A deck that surely went up or down at v (m/s) turns about within seconds: q is no less than this
# part (1/s) of v^2, and so for a while, s. Between its turns nothing tells so, and seen worse for a
# moment (by its tag alone, 7 % of the range unsure) it was taken to go straight on: it came up at
# 0.1 m/s while it was said to sink at 0.16, with a sigma of 0.06. From farther away than this, m,
# ranges err as decks heave.
HEAVE_SHARE, HEAVE_KEPT_S, HEAVE_SEEN_M = 0.25, 20.0, 5.0
MAX_TILT = math.radians(25.0)  # rad; what lies steeper is no pad, whatever it looks like
SIGMA_INITIAL_TILT = math.radians(6.0)  # rad, from level
TILT_RANDOM_WALK = math.radians(2.0)  # rad per sqrt(s): how decks roll

# ---- what is assumed of the measurement --------------------------------------------------------
SIGMA_GIMBAL_CLOCK_S = 0.015  # of the gimbal's angles against the pictures, beside the autopilot's
SIGMA_HEADING = math.radians(2.0)  # rad, of the autopilot's heading
RANGE_TIME_CONSTANT_S = 2.0  # of the errors of ranges, which change as the pad comes nearer
ANOTHER_MARKER = 2.0  # by which is seen what says that its range errs by so much more, or less
# Over which the camera's axes are told that the lens errs about, s, while they turn by less than
# this, rad. In the newest frame they are as noisy as what it shows: 1.2 m behind a pad of 1 m/s,
# 6 m up, that taught the filter 0.05 degrees of the lens a second, without end. Axes that lag a
# turn tell of the lens too: with 3 degrees one that was 2 degrees off was taken for 0.4 +- 0.5.
AXES_TIME_CONSTANT_S, AXES_TURN = 0.3, math.radians(0.25)
BIAS_TIME_CONSTANT_S = 120.0  # of the Gauss-Markov errors of lens direction and gimbal's clock
# Of the pictures' clock, which stays as it is for a flight. With 120 s it was known at 15 m, and
# forgotten low over the pad for whatever moved like it there (bench/sensor_errors.py).
CLOCK_TIME_CONSTANT_S = 1200.0
# What shows the pad aside for a while (a gimbal's backlash, a position that wanders) the vehicle
# flies after, and so it goes with the vehicle's own motion, as what a late clock shows does: low
# over the pad, where that moves little, it was taken for a clock 8 ms later on average, and that to
# 3 ms. Of white noise that tells as little of the clock; chosen on 30 days of the field world.
COLOURED_RAD, COLOURED_M = 0.003, 0.005  # of the range, and beside it
ADAPTATION_RATE = 0.05  # per frame: how fast the assumed noises follow the innovations
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
        self._sigma_bearing, self._sigma_clock = bearing, options.clock_sigma_s
        self._nis_limit = options.gate_sigma**2
        self._accepted = 0  # sightings since the filter began; 0: nothing is known
        self._accepted_t = -math.inf
        self._first_t = -math.inf  # of the sightings that are to confirm it
        self._rejections = 0  # in a row, lying together
        self._refused_t = self._stepped_t = -math.inf
        self.inconsistency = Inconsistency()
        self._refused_step = ZERO  # innovation of the last one refused, m
        self._tilt = (0.0, 0.0)  # of the normal from gravity, local north and east, rad
        self._tilt_variance = SIGMA_INITIAL_TILT**2
        # White noise's variance over what it is said to be: across the line of sight, and along it.
        self._noise_scale = (1.0, 1.0)
        self._last_innovation = ZERO  # the position's, m
        self._of_expected = (1.0, 1.0)  # innovations' variance over the expected, level and down
        # On average: how far down the pad is, local, m; what its ranges err by alike, 1 sigma.
        self._down = self._range_share = 0.0
        self._axes: tuple[float, Vec3, Vec3] | None = None  # the camera's x and y: when, local
        self._heave = (-math.inf, 0.0)  # when looked at last, s; squared, m^2/s^2
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
        """Return how far from where it is the errors common to all frames show the pad, m.

        But those of the clocks, which are put right where pictures are placed.
        """
        (x, y, _), (_, range_, heading) = self._motion.biases
        return add(rotate(B[0], (x, y, 0.0)), rotate(B[1], (0.0, range_, heading)))

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
            self._start(min(possible, key=_cost_by_level))
            return False
        if t <= self._motion.t:
            return False
        dt = t - self._motion.t
        self._tilt_variance += TILT_RANDOM_WALK**2 * dt
        self._motion.predict(t)
        best, innovation = self._likeliest(possible)
        if innovation.nis < 0.0:
            # What should be a covariance is none, and nothing that hangs on it is to be flown on.
            self.reset()
            return False
        self._average(best, dt)
        self.nis = innovation.nis
        self._adapt(best, innovation)
        is_likely = self.nis <= self._nis_limit  # NaN is not
        # Telemetry that steps for a moment is noise for this moment, and no reason to be blind.
        tolerant = innovation if is_likely else innovation.with_noise(best.hiccup)
        is_near = tolerant.nis <= self._nis_limit
        if is_likely:
            self.inconsistency.end(t)
        else:
            B = self._bias_jacobian(best)
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
            normal=unit((*self._tilt, 1.0)),
            coupling=self._motion.coupling,
        )

    def _start(self, seen: PadObservation) -> None:
        """Begin anew from one observation; the biases are kept."""
        self.inconsistency.end(seen.t)
        self._accepted = 1
        self._accepted_t = seen.t
        self._rejections = 0
        self._motion.q = (self._q, self._q, self._q)
        self._last_innovation = ZERO
        self._of_expected = (1.0, 1.0)
        self._noise_scale = (1.0, 1.0)
        self._heave = (seen.t, 0.0)
        self._down, self._range_share = seen.position[2], seen.biases.range_share
        self._axes = (seen.t, seen.biases.about_x, seen.biases.about_y)
        self._motion.start(
            seen.t,
            seen.position,
            seen.covariance,
            seen.biases.jacobian(seen.arm, seen.biases.range_share),
            SIGMA_INITIAL_VELOCITY_MPS,
        )
        self._tilt = (0.0, 0.0)
        self._tilt_variance = SIGMA_INITIAL_TILT**2
        self._correct_tilt(seen)
        self._heading.reset()
        self._motion.turn_rate = 0.0
        if seen.heading is not None:
            self._heading.update(seen.t, seen.heading, seen.sigma_heading)

    def _likeliest(self, possible: list[PadObservation]) -> tuple[PadObservation, Innovation]:
        innovations = [self._innovation(o) for o in possible]
        costs = [self._cost_by_tilt(o) + i.nis for o, i in zip(possible, innovations, strict=True)]
        chosen = costs.index(min(costs))
        return possible[chosen], innovations[chosen]

    def _innovation(self, seen: PadObservation) -> Innovation:
        # A pad that the vehicle goes along with hides the clock's error.
        motion = self._motion
        v = motion.velocity
        (a, b, c), by_gimbal = self._bias_jacobian(seen)
        by_lens = (
            (a[0], a[1], a[2] - v[0]),
            (b[0], b[1], b[2] - v[1]),
            (c[0], c[1], c[2] - v[2]),
        )
        # While neither the pad's velocity nor the clock is known, one says nothing of the other:
        # the second-order term of their product.
        unknown = matscale(motion.Pvv, motion.Pbb[2][2])
        noise = matadd(self._white_noise(seen), matadd(seen.telemetry_noise, unknown))
        return motion.innovation(seen.position, noise, (by_lens, by_gimbal))

    def _bias_jacobian(self, seen: PadObservation) -> Jacobian:
        """Return how the biases move what is seen where it should be seen.

        Were it where it is seen, every sighting's noise would tell of the lens: hovering at 2 m,
        of ranges that erred by 2 % from picture to picture, it learned 3 degrees within 10 s. (An
        EKF that linearises where its newest measurement moved it learns what it cannot observe:
        Huang, Mourikis and Roumeliotis 2010.)
        """
        motion, biases = self._motion, self._with_steady_axes(seen)
        camera = sub(seen.position, seen.arm)
        arm = sub((motion.position[0], motion.position[1], self._down), camera)
        shown = self.shown(biases.jacobian(arm, self._range_share))
        return biases.jacobian(add(arm, shown), self._range_share)

    def _with_steady_axes(self, seen: PadObservation) -> BiasModel:
        """Return how the biases move what is seen, about axes that are free of its noise."""
        new = seen.biases
        if self._axes is None:
            return new
        t, x, y = self._axes
        if min(dot(x, new.about_x), dot(y, new.about_y)) < math.cos(AXES_TURN):
            return new
        k = clamp((seen.t - t) / AXES_TIME_CONSTANT_S, 0.0, 1.0)
        x = unit(add(x, scale(sub(new.about_x, x), k)))
        y = unit(add(y, scale(sub(new.about_y, y), k)))
        return new._replace(about_x=x, about_y=y)

    def _average(self, seen: PadObservation, dt: float) -> None:
        """Go on with what the Jacobian goes by, free of one picture's noise.

        Args:
            seen: says what its range may err by alike: that goes up and down with the range as it
                was measured.
            dt: since the last one, s.
        """
        range_share, steady = seen.biases.range_share, self._with_steady_axes(seen)
        self._axes = (seen.t, steady.about_x, steady.about_y)
        ratio = range_share / self._range_share if self._range_share > 0.0 else math.inf
        if not 1.0 / ANOTHER_MARKER < ratio < ANOTHER_MARKER:
            self._range_share = range_share
        newer = min(1.0, dt / RANGE_TIME_CONSTANT_S)
        self._range_share += newer * (range_share - self._range_share)
        self._down += newer * (self._motion.position[2] - self._down)

    def _white_noise(self, seen: PadObservation) -> Mat3:
        """Return what is new in every frame as it was learned, m^2.

        Errors, not covariances, are stretched: where range and place err together the sum of two
        scaled parts would be no covariance.
        """
        across, along = (math.sqrt(scale) for scale in self._noise_scale)
        d = seen.sight
        stretch = matadd(diagonal(across, across, across), matscale(outer(d, d), along - across))
        return rotate_covariance(stretch, seen.covariance)

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
        self._correct_tilt(seen)
        if seen.heading is not None:
            self._heading.update(seen.t, seen.heading, seen.sigma_heading)
            self._motion.turn_rate = self._heading.sure_turn_rate

    def _adapt(self, seen: PadObservation, innovation: Innovation) -> None:
        """Let the assumed noises follow the innovations (Mehra 1970).

        They should be as large as their covariance says, or the frames' noise is another one; and
        not like the one before, or the pad moves otherwise than assumed. What comes of a swinging
        airframe (a gimbal or a clock a little late) is alike from frame to frame too. Taken for
        the pad's motion it would be flown after, and so keep the airframe swinging.
        """
        if not self.nis <= OUTLIER_FACTOR * self._nis_limit:  # so that NaN is outside
            return
        self._adapt_noise(seen, innovation)
        x, y, z = innovation.vector
        u, v, w = self._last_innovation
        self._last_innovation = innovation.vector
        S, R = innovation.S, self._white_noise(seen)
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
        q_north, _, q_down = self._motion.q
        q_north = _adapted(q_north, horizontal)
        q_down = max(_adapted(q_down, vertical), HEAVE_SHARE * self._heave_squared(seen))
        self._motion.q = (q_north, q_north, q_down)

    def _heave_squared(self, seen: PadObservation) -> float:
        """Return the square of the fastest heave surely seen lately, m^2/s^2; called in order."""
        motion = self._motion
        surely = max(0.0, abs(motion.velocity[2]) - 2.0 * math.sqrt(motion.Pvv[2][2]))
        if seen.range_m > HEAVE_SEEN_M:
            surely = 0.0
        t_before, before = self._heave
        kept = before * math.exp((t_before - seen.t) / HEAVE_KEPT_S)
        self._heave = (seen.t, max(kept, surely * surely))
        return self._heave[1]

    def _adapt_noise(self, seen: PadObservation, innovation: Innovation) -> None:
        d = seen.sight
        off = dot(d, innovation.vector)
        in_range = off * off / dot(d, rotate(innovation.S, d))
        nis = min(self.nis, self._nis_limit)
        across, along = self._noise_scale
        self._noise_scale = (
            _scaled(across, 0.5 * max(0.0, nis - in_range)),
            _scaled(along, min(in_range, self._nis_limit)),
        )

    def _cost_by_tilt(self, seen: PadObservation) -> float:
        """Return chi-square of a pose: what the picture says, and how the pad lay before."""
        north, east = seen.normal[0] - self._tilt[0], seen.normal[1] - self._tilt[1]
        variance = self._tilt_variance + seen.sigma_tilt**2 + self._sigma_bearing**2
        return seen.cost + (north * north + east * east) / variance

    def _correct_tilt(self, seen: PadObservation) -> None:
        """Take the normal in by a Kalman filter of one variance, white in both directions."""
        s = self._tilt_variance + seen.sigma_tilt**2 + self._sigma_bearing**2
        k = self._tilt_variance / s
        north, east = self._tilt
        self._tilt = (
            north + k * (seen.normal[0] - north),
            east + k * (seen.normal[1] - east),
        )
        self._tilt_variance *= 1.0 - k


def _scaled(noise_scale: float, nis: float) -> float:
    """Return the scale of a variance after an innovation of this NIS for each degree of freedom."""
    return clamp(noise_scale * math.exp(ADAPTATION_RATE * (nis - 1.0)), *NOISE_SCALE_RANGE)


def _too_wide(of_expected: float, noise_share: float) -> float:
    """Return what process noise falls by because innovations are smaller than expected, at most 0.

    Where it is far larger than the sightings' noise, every sighting is taken as it is: successive
    innovations do not tell then that it is too large, and it stayed so for minutes.

    Args:
        of_expected: innovations' variance lately, over the expected one.
        noise_share: of the expected one, what is the sightings' noise.
    """
    return 2.0 * min(0.0, of_expected - 0.5) * max(0.0, 1.0 - noise_share)


def _adapted(q: float, correlation: float) -> float:
    """Return the process noise q (m^2/s^3) after two innovations that correlate so.

    The correlation is in units of their expected variance: 0 on average where q is right.
    """
    changed = q * math.exp(ADAPTATION_RATE * clamp(correlation, -3.0, 3.0))
    return clamp(changed, MIN_ACCELERATION_MPS2**2, MAX_ACCELERATION_MPS2**2)


def _cost_by_level(seen: PadObservation) -> float:
    """Return chi-square of a pose: what the picture says, and that pads lie nearly level."""
    return seen.cost + (seen.tilt / math.hypot(SIGMA_INITIAL_TILT, seen.sigma_tilt)) ** 2
