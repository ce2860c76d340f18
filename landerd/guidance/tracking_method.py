"""Landing controller on the pad filter's state: one set of gains for still and moving pads.

The order is the pad's velocity plus a closing speed, as large as can still be braked: ArduPilot's
own square-root controller, on the error extrapolated to when the vehicle answers. Approach, turn
and descent overlap: the vehicle descends towards the lowest height at which the descent region is
as wide as the error, and turns as soon as the camera keeps the pad in sight at any heading.

Constants without a stated source were chosen by trial in the simulator, like the gains of
guidance.tracking: with them every row of `landerd campaign guidance` reaches what is asked of it.
"""

import math
from typing import NamedTuple

from landerd.config.models import Config, LimitsSection
from landerd.geometry import Vec3, add, clamp, horizontal, turned
from landerd.guidance.limits import flyable_limits
from landerd.guidance.phases import region_height
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.swing import LASTS, Swing
from landerd.messages import Phase

# ---- horizontal --------------------------------------------------------------------------------
MIN_LEAD_S = 0.35  # delay of airframe, link and sight, beside the shaper's lag
# Largest gain times lead; by it SITL's ArduCopter (lag 0.5 s) is flown with a gain of 2.5 per s.
MAX_KP_LEAD = 1.25
# Largest gain per acceleration limit, 1/s per m/s^2: a vehicle with 1.4 m/s^2 oscillated over the
# pad forever at a gain of 1.8, and not at 1.4.
MAX_KP_PER_ACCELERATION = 1.0
# Amplitude, m, up to which an oscillation about the pad stays within the jerk limit. With 1 m
# vehicles with 2 m/s^3 overshot a pad by 1 to 2 m coming from 6 m away, with 2 m by 0.2.
LINEAR_ERROR_M = 2.0
# Time constant of the attitude, s, at which the gain is 1 per s at most; the bound falls with its
# square. The later the attitude follows, the less damped is ArduCopter's own velocity loop: in SITL
# it overshot by 3 % with 0.15 s, ArduPilot's default, and by 21 % with 0.5 s, at 1.7 rad/s. With
# 0.5 s it oscillated over the pad forever at a gain of 2.5, and landed in 14 s at 1.0; with 0.6 s
# it landed in 22 to 45 s at 0.67, and in 17 to 20 s at 0.44.
ATTITUDE_AT_KP_1_S = 0.4
MAX_KI_SHARE = 0.2  # largest integral gain over the square of kp: a faster one oscillates
# Factor by which the gains are lowered when the vehicle oscillates for all that, and its lower
# bound in total. The total belongs to the vehicle, so it is kept from landing to landing.
CALMER, LEAST_CALMED = 0.75, 0.35
MORE = 1.1  # an oscillation has grown by this factor: in gusts it doubled within a step or two
BRAKE_SHARE = 0.6  # share of the acceleration limit counted on for braking
# The integral corrects velocities that are wrong by up to this, m/s: errors larger than it explains
# are still being closed. Run from 1 m on, it was wound up on the way to the pad, overshot by 10 cm,
# and was still 4 cm off at touch-down 6 s later.
INTEGRATED_MPS = 0.5
MAX_INTEGRAL_MPS = 0.5  # largest output of the integral, m/s
# Time constant of the low-pass on the pad's velocity, s, and in leads for slow vehicles.
PAD_VELOCITY_TIME_CONSTANT_S, PAD_VELOCITY_LEADS = 0.7, 1.4
# What that low-pass may take away: no more than noise (1 sigma of the velocity) and a swinging
# airframe explain (this share of the vehicle's fastest speed beside the pad, decaying over
# SWING_KEPT_S), and no more than this, m/s. The rest is acceleration of the pad. It is flown, up to
# MAX_PAD_ACCELERATION_MPS2; above PAD_ACCELERATES_MPS2 an oscillation is the pad's own, and the
# gains are not lowered for it.
MAX_SMOOTHED_MPS, SHOWN_OF_SWING, SWING_KEPT_S = 0.3, 0.15, 1.0
MAX_PAD_ACCELERATION_MPS2, PAD_ACCELERATES_MPS2 = 0.5, 0.25

# ---- vertical ----------------------------------------------------------------------------------
# Lag of the answer to a vertical order, s: its least value, and the part beyond the shaper's lag.
# ArduCopter 4.5.7 in SITL was at one half after 0.43 s, the shaper's lag being 0.2 s
# (bench/step_response.py).
VERTICAL_LAG_S, VERTICAL_LATE_S = 0.35, 0.15
SINK_RATE_KP = 1.5  # m/s per m of height over the floor, near it
SINK_LOOKS_AHEAD_S = 0.5  # longest extrapolation of the error: beyond, velocity noise prevails
# Least height over distance to a pad that drives away. Flatter, it is lost before the vehicle has
# caught up: 20 m away a ring of 1 m is 6 pixels high then, and none is found below 4 or 5.
LEAST_STEEPNESS = 0.3

# ---- heading -----------------------------------------------------------------------------------
# Least height over distance for a turn (the camera looks 50 degrees down then), and the turn, rad,
# that is small enough to keep the pad in the picture in any case.
MIN_TURN_STEEPNESS = 1.2
SMALL_TURN = math.radians(30.0)
# Lag of the answer to a yaw rate, s: ArduCopter 4.5.7 in SITL was at 63 % after 0.26 s.
YAW_LAG_S = 0.3
# Largest yaw gain times that lag. The measured airframe, with orders 0.075 s late, settles with
# 0.42, and oscillates by 7 degrees forever with 0.51: it never landed. A well damped one takes 1.5.
MAX_YAW_KP_LAG = 0.4
TURN_RATE_TIME_CONSTANT_S = 0.7  # of the low-pass on the pad's turn rate, s
YAW_BRAKE = math.radians(30.0)  # rad/s^2 that a turn is braked with: a quarter of the limiter's
# Largest output of the yaw integral, rad/s: a vehicle that turned by 5 deg/s beside its order stood
# 5 degrees off, over the pad, forever.
MAX_INTEGRAL_TURN = math.radians(8.0)
TURN_KI_SHARE = 0.4  # integral gain over the square of the yaw gain


class PadMotion(NamedTuple):
    """Motion of the pad, smoothed."""

    velocity: Vec3  # local NED, m/s
    error_rate: Vec3  # that velocity minus the vehicle's, m/s
    turn_rate: float  # of the heading, rad/s


class TrackingMethod:
    """Velocity and yaw rate that bring the vehicle onto the pad."""

    def __init__(self, config: Config) -> None:
        self._swing = Swing()
        self._calmed_of: tuple[float, float, float] | None = None  # gain, lead and compensation
        self.configure(config)
        self.restart()

    def configure(self, config: Config) -> None:
        """Take new gains and limits, and those of the autopilot's velocity shaper.

        ArduPilot's shaper asks for an acceleration of jerk / acceleration times the missing
        velocity: a first-order lag of acceleration / jerk. Where the jerk limit allows a quicker
        answer, a lead compensator shortens the lag; errors are extrapolated by the lag that is left
        (the lead). The lead bounds the gain, and the gain bounds that of the integral.
        """
        options, vehicle = config.guidance, config.autopilot
        acceleration = flyable_limits(config).acceleration_mps2
        self._gains = options.tracking
        self._yaw_kp = min(options.tracking.yaw_kp, MAX_YAW_KP_LAG / YAW_LAG_S)
        shaper_s = vehicle.shaper_lag_s
        lag_s = min(shaper_s, _quickest_lag(vehicle.jerk_mps3, options.limits, shaper_s))
        self._compensation = shaper_s / lag_s - 1.0
        self._lead_s = max(lag_s, MIN_LEAD_S) + options.tracking.lead_s
        self._kp = min(
            options.tracking.kp,
            MAX_KP_LEAD / self._lead_s,
            MAX_KP_PER_ACCELERATION * acceleration,
            (ATTITUDE_AT_KP_1_S / vehicle.attitude_time_constant_s) ** 2,
        )
        self._ki = min(options.tracking.ki, MAX_KI_SHARE * self._kp * self._kp)
        calmed_of = self._kp, self._lead_s, self._compensation
        if calmed_of != self._calmed_of:
            self._calmed_of = calmed_of
            self._calmed = 1.0  # of the gain; of the integral's its square
        self._vertical_lag_s = max(VERTICAL_LAG_S, vehicle.vertical_shaper_lag_s + VERTICAL_LATE_S)
        self._brake = min(options.tracking.brake_mps2, BRAKE_SHARE * acceleration)
        self._region = options.descent
        self._limits = options.limits
        self._touchdown_mps = options.touchdown_descent_mps

    def restart(self) -> None:
        """Begin a landing."""
        self._swing.restart()
        self._calms = True  # an oscillation lowers the gains
        self._swung_m = math.inf  # size of the last oscillation, m
        self._integral = (0.0, 0.0)  # north and east, m/s
        self._pad_velocity: tuple[float, float] | None = None  # smoothed, north and east, m/s
        self._swung_mps = 0.0  # fastest speed beside the pad lately, m/s
        self._turn_rate: float | None = None  # the pad's, smoothed, rad/s
        self._turn_integral = 0.0  # rad/s

    def step(
        self,
        phase: Phase,
        relative: RelativeState,
        floor_m: float,
        dt: float,
        *,
        widening: float = 1.0,
    ) -> tuple[Vec3, float]:
        """Return velocity (local NED, m/s) and yaw rate (rad/s).

        Args:
            phase: not used: this method turns and descends whenever it may.
            relative: pad relative to vehicle.
            floor_m: height over the pad to come down to, m.
            dt: time since the last step, s.
            widening: factor on the descent region's radius.
        """
        gains = self._gains
        moves = self._smoothed(relative, dt)
        self._calm(relative, moves, dt)
        north, east = _error_ahead(relative, moves, self._lead_s)
        distance = math.hypot(north, east)
        kp = self._calmed * self._kp
        closing = min(_braking_speed(distance, kp, self._brake), gains.approach_mps)
        k = closing / distance if distance > 0.0 else 0.0
        self._integrate(relative, moves, dt)
        course = relative.pad_coupling * moves.turn_rate * self._lead_s
        v = turned(moves.velocity, course)
        velocity = (
            v[0] + k * north + self._integral[0],
            v[1] + k * east + self._integral[1],
            relative.heave + self._sink_rate(relative, moves, floor_m, widening),
        )
        yaw_rate = self._yaw_rate(relative, moves.turn_rate, dt)
        return self._compensated(velocity, relative, moves), yaw_rate

    def _calm(self, relative: RelativeState, moves: PadMotion, dt: float) -> None:
        """Lower the gains of a vehicle that oscillates over the pad: it is slower than configured.

        Where it oscillates more with lower gains, or still with the lowest, gusts are the cause: it
        gets its gains back, and keeps them until it oscillates more with those.
        """
        if not self._swing.step(relative.error, moves.error_rate, self._calmed * self._kp, dt):
            return
        grown = LASTS if self._calmed == LEAST_CALMED else MORE
        if self._swing.size > grown * self._swung_m:
            self._calms = not self._calms
        self._swung_m = self._swing.size
        self._calmed = max(CALMER * self._calmed, LEAST_CALMED) if self._calms else 1.0

    def _compensated(self, velocity: Vec3, relative: RelativeState, moves: PadMotion) -> Vec3:
        """Return the order by which a slow shaper answers like a quick one: a lead compensator.

        It amplifies the missing velocity, but asks for no faster approach than configured.
        """
        north, east, down = velocity
        pad_north, pad_east, _ = moves.velocity
        has = relative.vehicle_velocity
        north += self._compensation * (north - has[0]) - pad_north
        east += self._compensation * (east - has[1]) - pad_east
        most = self._gains.approach_mps + MAX_INTEGRAL_MPS
        k = min(1.0, most / max(math.hypot(north, east), most))
        return pad_north + k * north, pad_east + k * east, down

    def _smoothed(self, relative: RelativeState, dt: float) -> PadMotion:
        """Return the pad's motion with its horizontal velocity and turn rate smoothed.

        A swinging airframe makes the pad seem to move a little (through a small delay of gimbal or
        clock), and following that at once keeps it swinging. A pad that sways by more than that is
        followed, with its velocity extrapolated to when the vehicle answers.
        """
        north, east, down = relative.pad_velocity
        if self._pad_velocity is None:
            self._pad_velocity = (north, east)
        turn_rate = self._smooth_turn_rate(relative, dt)
        course = relative.pad_coupling * turn_rate * dt
        was_north, was_east, _ = turned((*self._pad_velocity, 0.0), course)
        time_s = max(PAD_VELOCITY_TIME_CONSTANT_S, PAD_VELOCITY_LEADS * self._lead_s)
        time_s = max(time_s / self._calmed, dt)
        k = 1.0 - dt / time_s
        off = (k * (was_north - north), k * (was_east - east))
        shown = SHOWN_OF_SWING * self._swings(relative, dt) + relative.sigma_velocity
        size = math.hypot(*off)
        # Bounded, so that an earlier acceleration is soon forgotten once it has ended.
        lags = min(size, shown + time_s * MAX_PAD_ACCELERATION_MPS2)
        kept = lags / size if size > 0.0 else 0.0
        off = (kept * off[0], kept * off[1])
        self._pad_velocity = (north + off[0], east + off[1])
        accelerates = max(0.0, lags - shown) / time_s
        if accelerates > PAD_ACCELERATES_MPS2:
            self._swing.restart()
        by = min(lags, shown, MAX_SMOOTHED_MPS) - self._lead_s * accelerates
        share = by / lags if lags > 0.0 else 0.0
        change = (share * off[0], share * off[1], 0.0)
        return PadMotion(
            velocity=(north + change[0], east + change[1], down),
            error_rate=add(relative.error_rate, change),
            turn_rate=turn_rate,
        )

    def _swings(self, relative: RelativeState, dt: float) -> float:
        """Return the vehicle's fastest horizontal speed relative to the pad lately, m/s."""
        beside = horizontal(relative.error_rate)
        self._swung_mps = max(beside, self._swung_mps * math.exp(-dt / SWING_KEPT_S))
        return self._swung_mps

    def _smooth_turn_rate(self, relative: RelativeState, dt: float) -> float:
        """Return the pad's turn rate, low-passed while its heading is known, rad/s."""
        if relative.heading_error is None:
            self._turn_rate = None
            return relative.pad_turn_rate
        last = relative.pad_turn_rate if self._turn_rate is None else self._turn_rate
        k = min(1.0, dt / TURN_RATE_TIME_CONSTANT_S)
        self._turn_rate = last + k * (relative.pad_turn_rate - last)
        return self._turn_rate

    def _integrate(self, relative: RelativeState, moves: PadMotion, dt: float) -> None:
        """Integrate the part of the error that does not close as fast as the gain asks for."""
        distance = relative.distance
        kp, ki = self._calmed * self._kp, self._calmed * self._calmed * self._ki
        if not 0.0 < distance <= INTEGRATED_MPS * (1.0 / kp + self._lead_s):
            return
        (e_north, e_east, _), (v_north, v_east, _) = relative.error, moves.error_rate
        closing = -(e_north * v_north + e_east * v_east) / distance
        step = ki * dt * _stays(distance, closing, kp)
        north, east = self._integral
        north, east = north + step * e_north, east + step * e_east
        size = math.hypot(north, east)
        k = MAX_INTEGRAL_MPS / size if size > MAX_INTEGRAL_MPS else 1.0
        self._integral = (k * north, k * east)

    def _sink_rate(
        self, relative: RelativeState, moves: PadMotion, floor_m: float, widening: float
    ) -> float:
        """Return the downward speed relative to the pad, m/s; negative to climb."""
        flat_m = self._too_low_m(relative, moves)
        if flat_m > 0.0:
            return -min(SINK_RATE_KP * flat_m, self._limits.climb_mps)
        ahead = math.hypot(*_error_ahead(relative, moves, min(self._lead_s, SINK_LOOKS_AHEAD_S)))
        off = max(ahead, relative.distance) + 2.0 * relative.sigma_m
        floor = max(floor_m, region_height(self._region, off / widening))
        height = relative.height - self._vertical_lag_s * max(0.0, -relative.error_rate[2])
        brake = self._gains.descent_brake_mps2
        if floor > 0.0:
            speed = _braking_speed(max(0.0, height - floor), SINK_RATE_KP, brake)
        else:
            # At touch-down speed from the commit height on: sight may be lost just above it.
            to_go = max(0.0, height - self._region.commit_height_m)
            speed = math.sqrt(self._touchdown_mps**2 + 2.0 * brake * to_go)
        return min(speed, self._limits.descent_mps)

    def _too_low_m(self, relative: RelativeState, moves: PadMotion) -> float:
        """Return how much too low the vehicle is to keep a pad that drives away in sight, m."""
        (north, east, _), (v_north, v_east, _) = relative.error, moves.error_rate
        leaves = north * v_north + east * v_east  # speed away times distance, m^2/s
        if leaves <= 0.0:
            return 0.0
        leaves /= relative.distance
        lags = self._lead_s + 0.5 * leaves / self._limits.acceleration_mps2
        return LEAST_STEEPNESS * (relative.distance + leaves * lags) - relative.height

    def _yaw_rate(self, relative: RelativeState, pad_turn_rate: float, dt: float) -> float:
        """Return the yaw rate, rad/s; pad_turn_rate: of the pad's heading, smoothed, rad/s."""
        if relative.heading_error is None:
            return 0.0
        turns = pad_turn_rate - relative.yaw_rate
        error = relative.heading_error + YAW_LAG_S * turns
        if relative.height < MIN_TURN_STEEPNESS * relative.distance and abs(error) > SMALL_TURN:
            return 0.0
        max_rate = math.radians(self._limits.yaw_rate_deg_s)
        turn = math.copysign(_braking_speed(abs(error), self._yaw_kp, YAW_BRAKE), error)
        self._integrate_turn(relative.heading_error, turns, dt)
        wanted = pad_turn_rate + turn + self._turn_integral
        return clamp(wanted, -max_rate, max_rate)

    def _integrate_turn(self, error: float, error_rate: float, dt: float) -> None:
        kp = self._yaw_kp
        if not 0.0 < abs(error) <= MAX_INTEGRAL_TURN / kp:
            return
        closing = -math.copysign(1.0, error) * error_rate
        step = TURN_KI_SHARE * kp * kp * dt * _stays(abs(error), closing, kp) * error
        self._turn_integral = clamp(
            self._turn_integral + step, -MAX_INTEGRAL_TURN, MAX_INTEGRAL_TURN
        )


def _quickest_lag(jerk: float, limits: LimitsSection, shaper_s: float) -> float:
    """Return the shortest first-order lag (s) that the jerk limit allows.

    With errors extrapolated by the lag, a gain of MAX_KP_LEAD / lag gives poles of magnitude w =
    sqrt(MAX_KP_LEAD) / lag; an oscillation of amplitude LINEAR_ERROR_M at w takes a jerk of w^3
    LINEAR_ERROR_M. Set-points within the acceleration limit ask for no more jerk than that limit
    over the shaper's own lag.

    Args:
        jerk: of the autopilot, m/s^3.
        limits: of our own set-points.
        shaper_s: lag of the autopilot's shaper, s.
    """
    jerk = min(jerk, limits.acceleration_mps2 / shaper_s)
    return math.sqrt(MAX_KP_LEAD) * math.cbrt(LINEAR_ERROR_M / jerk)


def _error_ahead(relative: RelativeState, moves: PadMotion, lead_s: float) -> tuple[float, float]:
    (north, east, _), (v_north, v_east, _) = relative.error, moves.error_rate
    return north + lead_s * v_north, east + lead_s * v_east


def _stays(error: float, closing: float, kp: float) -> float:
    """Return the share of an error (m or rad) that stays: 0 where it closes at kp times it."""
    return clamp(1.0 - closing / (kp * error), 0.0, 1.0)


def _braking_speed(distance: float, kp: float, deceleration: float) -> float:
    """Return the speed (m/s) for a distance (m): kp (1/s) times it, no more than can be braked.

    ArduPilot's sqrt_controller: linear near zero, beyond that by v^2 / (2 a).
    """
    knee = deceleration / (kp * kp)
    if distance <= knee:
        return kp * distance
    return math.sqrt(2.0 * deceleration * (distance - 0.5 * knee))
