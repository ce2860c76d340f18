"""A model of the parts of ArduCopter's flight code that landerd uses: modes, arming, GUIDED, LAND.

It behaves as measured with ArduCopter 4.5. Sticks are not modelled: LOITER and STABILIZE only hold
the position. RTL climbs, flies home (the local origin) and holds there. The velocity of a position
target and yaw angles are ignored.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from hw.autopilots.arducopter import Mode
from hw.sim.stand_in.ekf import Estimate
from hw.sim.stand_in.pilot import PilotRadio
from landerd.geometry import Vec3, clamp, heading_of, horizontal, sub, wrap
from landerd.messages import Landed

_MODES = (Mode.STABILIZE, Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.LAND)
_ARMABLE = (Mode.STABILIZE, Mode.GUIDED, Mode.LOITER)

_ZERO: Vec3 = (0.0, 0.0, 0.0)
_SPOOL_UP_S = 1.5  # from NAV_TAKEOFF to lift-off
_REACHED_M = 0.1
_LAND_HIGH_M = 10.0  # height above which LAND descends faster (LAND_ALT_LOW)
_LAND_DISARM_S = 0.5  # time from landed to disarmed in LAND
_RADIO_FAILSAFE_S = 1.0
_RTL_CLIMBS_M = 1.0  # farther than this below its return height, RTL only climbs
_NEAREST_COURSE_M = 5.0  # the nose is not turned towards a position target nearer than this
_SLOWEST_COURSE_MPS = 0.9  # the nose is not turned into a course flown slower than this
_BRAKING = 0.5  # share of the acceleration with which it brakes for a target, as the vehicle lags
_YAW_RATE_LIMIT = math.radians(60.0)  # ATC_SLEW_YAW


@dataclass(frozen=True)
class CopterParameters:
    """ArduCopter's parameters that matter here, in SI units."""

    guid_timeout_s: float = 3.0  # GUID_TIMEOUT
    disarm_delay_s: float = 10.0  # DISARM_DELAY
    wpnav_speed_mps: float = 5.0  # WPNAV_SPEED
    wpnav_speed_up_mps: float = 2.5
    wpnav_speed_down_mps: float = 1.5
    wpnav_accel_mps2: float = 2.5
    wpnav_accel_z_mps2: float = 1.0
    psc_jerk_xy_mps3: float = 5.0  # PSC_JERK_XY
    psc_jerk_z_mps3: float = 5.0
    atc_input_tc_s: float = 0.15  # ATC_INPUT_TC
    land_speed_mps: float = 0.5  # LAND_SPEED
    rtl_alt_m: float = 15.0  # RTL_ALT, height over home
    wp_yaw_behavior: int = 2  # 0: the nose keeps its heading; 2: it turns into the course


ARDUPILOT_DEFAULTS = CopterParameters()


class Vehicle(Protocol):
    """The airframe with its inner control loops."""

    @property
    def landed_detected(self) -> bool:
        """Whether the land detector says so."""
        ...

    def order(
        self, velocity: Vec3, yaw_rate: float, *, level: bool = False, landing: bool = False
    ) -> None:
        """Fly a velocity and a yaw rate from now on; a climb takes off.

        Args:
            velocity: local NED, m/s
            yaw_rate: rad/s
            level: keep a level attitude and ignore the horizontal velocity
            landing: the mode is LAND
        """

    def motors_on(self) -> None:
        """Start the motors."""

    def motors_off(self) -> None:
        """Stop the motors."""


@dataclass(frozen=True, slots=True)
class _Velocity:
    velocity: Vec3
    yaw_rate: float | None
    t: float


@dataclass(frozen=True, slots=True)
class _Position:
    position: Vec3
    yaw_rate: float | None


@dataclass(frozen=True, slots=True)
class _Level:
    climb: float  # of the fastest climb, or descent, -1 to 1
    t: float


@dataclass(frozen=True, slots=True)
class _Climb:
    down: float  # to reach, local NED
    t: float


class Copter:
    """The flight code. Times are the event loop's.

    Attributes:
        mode: how it flies.
        armed: whether the motors may turn.
        failsafe: the radio was lost and the mode has been changed for it.
        refuses_disarm: orders to disarm are refused on the ground, too.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        pilot: PilotRadio,
        parameters: CopterParameters,
        say: Callable[[str], None],
        *,
        flying: bool,
    ) -> None:
        """Say takes the lines for the pilot; flying starts armed, in LOITER."""
        self.mode = Mode.LOITER if flying else Mode.STABILIZE
        self.armed = flying
        self.failsafe = self.refuses_disarm = False
        self._vehicle = vehicle
        self._pilot = pilot
        self._p = parameters
        self._say = say
        self._target: _Velocity | _Position | _Level | _Climb | None = None
        self._speed_mps = parameters.wpnav_speed_mps  # towards a position target
        self._idle_since: float | None = None  # landed, and with the throttle low but for LAND
        self._radio_lost_at: float | None = None
        if flying:
            vehicle.motors_on()

    @property
    def landed_state(self) -> Landed:
        """MAV_LANDED_STATE, as EXTENDED_SYS_STATE has it."""
        if self._vehicle.landed_detected and not isinstance(self._target, _Climb):
            return Landed.ON_GROUND
        if self.mode == Mode.LAND:
            return Landed.LANDING
        return Landed.TAKEOFF if isinstance(self._target, _Climb) else Landed.IN_AIR

    # ---- orders; each returns whether it was accepted ----

    def set_mode(self, mode: int) -> bool:
        """Change the mode."""
        if mode not in _MODES:
            return False
        if mode != self.mode:
            self.mode = Mode(mode)
            self._target = None
            self._speed_mps = self._p.wpnav_speed_mps
            self._idle_since = None
        self.failsafe = False
        return True

    def arm(self) -> bool:
        """Arm."""
        if not self.armed:
            if self.mode not in _ARMABLE or self._pilot.lost:
                return False
            self.armed = True
            self._target = None
            self._idle_since = None
            self._vehicle.motors_on()
            self._say("Arming motors")
        return True

    def disarm(self, *, forced: bool = False) -> bool:
        """Disarm; in the air only if forced."""
        if self.armed:
            if not forced and (self.refuses_disarm or not self._vehicle.landed_detected):
                return False
            self.armed = False
            self._target = None
            self._vehicle.motors_off()
            self._say("Disarming motors")
        return True

    def take_off(self, height_m: float, estimate: Estimate, t: float) -> bool:
        """Climb to a height above the take-off point."""
        if not (self.armed and self.mode == Mode.GUIDED and self._vehicle.landed_detected):
            return False
        if not 0.0 < height_m < 1000.0:
            return False
        self._target = _Climb(estimate.position[2] - height_m, t)
        return True

    def fly_velocity(self, velocity: Vec3, yaw_rate: float | None, t: float) -> None:
        """Take a velocity target, local NED; it ends a take-off."""
        if self._is_guided():
            self._target = _Velocity(velocity, yaw_rate, t)

    def fly_to(self, position: Vec3, yaw_rate: float | None) -> None:
        """Take a position target, local NED; it ends a take-off."""
        if self._is_guided():
            self._target = _Position(position, yaw_rate)

    def fly_level(self, climb: float, t: float) -> None:
        """Take a level attitude target with a climb rate, of the fastest; it ends a take-off."""
        if self._is_guided():
            self._target = _Level(climb, t)

    def set_speed(self, speed_mps: float) -> bool:
        """Fly to position targets at this speed until the mode is changed."""
        if not (self._is_guided() and speed_mps > 0.0):
            return False
        self._speed_mps = speed_mps
        return True

    def stop(self) -> None:
        """Hold, as after a malformed target."""
        if self._is_guided():
            self._target = None

    def _is_guided(self) -> bool:
        return self.armed and self.mode == Mode.GUIDED

    # ---- the main loop ----

    def step(self, estimate: Estimate, t: float) -> None:
        """Run the failsafes and give the vehicle its order."""
        self._check_radio(t)
        self._disarm_when_idle(t)
        velocity, yaw_rate = self._wanted(estimate, t)
        if self._vehicle.landed_detected and not isinstance(self._target, _Climb):
            velocity = (0.0, 0.0, max(velocity[2], 0.0))  # only NAV_TAKEOFF takes off
            yaw_rate = 0.0
        yaw_rate = clamp(yaw_rate, -_YAW_RATE_LIMIT, _YAW_RATE_LIMIT)
        self._vehicle.order(
            velocity,
            yaw_rate,
            level=self._is_guided() and isinstance(self._target, _Level),
            landing=self.mode == Mode.LAND,
        )

    def _check_radio(self, t: float) -> None:
        if not self._pilot.lost:
            self._radio_lost_at = None
            return
        if self._radio_lost_at is None:
            self._radio_lost_at = t
        # A ground station's overrides are input of the radio, too: while they come it is not lost.
        heard_t = max(self._radio_lost_at, self._pilot.overridden_t)
        if self.armed and not self.failsafe and t - heard_t >= _RADIO_FAILSAFE_S:
            self.set_mode(Mode.RTL)
            self.failsafe = True
            self._say("Radio Failsafe")

    def _disarm_when_idle(self, t: float) -> None:
        landed = self._vehicle.landed_detected and not isinstance(self._target, _Climb)
        may_disarm = self.mode == Mode.LAND or self._pilot.throttle_is_low(t)
        if not (self.armed and landed and may_disarm):
            self._idle_since = None
            return
        if self._idle_since is None:
            self._idle_since = t
        wait = _LAND_DISARM_S if self.mode == Mode.LAND else self._p.disarm_delay_s
        if t - self._idle_since >= wait:
            self.disarm()

    def _wanted(self, estimate: Estimate, t: float) -> tuple[Vec3, float]:
        """Return the velocity (local NED, m/s) and yaw rate (rad/s) to fly."""
        if self.armed and self.mode == Mode.LAND:
            high = estimate.position[2] < -_LAND_HIGH_M
            speed = self._p.wpnav_speed_down_mps if high else self._p.land_speed_mps
            return (0.0, 0.0, speed), 0.0
        if self.armed and self.mode == Mode.RTL:
            return self._way_home(estimate, t)
        target = self._target if self._is_guided() else None
        if target is None:
            return _ZERO, 0.0
        if isinstance(target, _Climb):
            return self._climb(target, estimate, t)
        if isinstance(target, _Level):
            return self._level(target, t)
        return self._course(target, estimate, t)

    def _way_home(self, estimate: Estimate, t: float) -> tuple[Vec3, float]:
        down = estimate.position[2]
        height = min(down, -self._p.rtl_alt_m)  # it never sinks to it
        if down - height > _RTL_CLIMBS_M:
            return (0.0, 0.0, self._vertical(height - down)), 0.0
        return self._course(_Position((0.0, 0.0, height), None), estimate, t)

    def _level(self, target: _Level, t: float) -> tuple[Vec3, float]:
        fastest = self._p.wpnav_speed_up_mps if target.climb > 0.0 else self._p.wpnav_speed_down_mps
        late = t - target.t > self._p.guid_timeout_s
        return (0.0, 0.0, 0.0 if late else -fastest * target.climb), 0.0

    def _course(
        self, target: _Velocity | _Position, estimate: Estimate, t: float
    ) -> tuple[Vec3, float]:
        if isinstance(target, _Position):
            error = sub(target.position, estimate.position)
            velocity, turns = self._towards(error), horizontal(error) > _NEAREST_COURSE_M
        elif t - target.t > self._p.guid_timeout_s:
            return _ZERO, 0.0
        else:
            velocity, turns = target.velocity, horizontal(estimate.velocity) > _SLOWEST_COURSE_MPS
        if target.yaw_rate is not None:
            return velocity, target.yaw_rate
        if self._p.wp_yaw_behavior == 0 or not turns:
            return velocity, 0.0
        return velocity, wrap(heading_of(velocity) - estimate.yaw)  # gain 1 /s

    def _climb(self, target: _Climb, estimate: Estimate, t: float) -> tuple[Vec3, float]:
        if t - target.t < _SPOOL_UP_S:
            return _ZERO, 0.0
        error = target.down - estimate.position[2]
        if abs(error) < _REACHED_M:
            self._target = _Position((*estimate.position[:2], target.down), 0.0)
        return (0.0, 0.0, self._vertical(error)), 0.0

    def _towards(self, error: Vec3) -> Vec3:
        distance = horizontal(error)
        braking = _BRAKING * self._p.wpnav_accel_mps2
        speed = _sqrt_controller(distance, braking, self._speed_mps)
        k = speed / distance if distance > 0.0 else 0.0
        return (k * error[0], k * error[1], self._vertical(error[2]))

    def _vertical(self, error: float) -> float:
        limit = self._p.wpnav_speed_down_mps if error > 0.0 else self._p.wpnav_speed_up_mps
        return math.copysign(_sqrt_controller(abs(error), self._p.wpnav_accel_z_mps2, limit), error)


def _sqrt_controller(error: float, acceleration: float, limit: float) -> float:
    """Speed towards a target this far away: ArduPilot's sqrt_controller with a gain of 1 /s."""
    if error <= acceleration:
        return min(error, limit)
    return min(math.sqrt(2.0 * acceleration * (error - 0.5 * acceleration)), limit)
