"""What the states of a landing share: the control step, the sight of the pad, may it begin."""

import math
from typing import NamedTuple, Protocol

from landerd.config.models import Config
from landerd.estimation.estimator import Estimator
from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.guidance import pilot_texts
from landerd.guidance.attempts import Attempts
from landerd.guidance.footprint import Footprint
from landerd.guidance.limits import MAX_STEP_S, flyable_limits
from landerd.guidance.orders import Orders
from landerd.guidance.pad_below import PadBelow
from landerd.guidance.relative_state import RelativeState, Sight
from landerd.guidance.rest_detector import RestDetector
from landerd.guidance.states import Event
from landerd.messages import Landed, Severity
from landerd.pad import PadLayout

# Telemetry that is stale for less than this, s, does not break off a descent: on a lossy link the
# attitude was stale for a tick now and again, each time the landing started afresh, and the sixth
# time it was handed back.
MOMENT_S = 0.3
# When the pilot is warned of the sightings' health: at this many sightings in the window of
# estimation.health, and this share refused. In 38 days of the field world (seeds 401 to 440) one
# window while tracking had more than 0.13 refused: 0.33, and sight was lost then. And with pictures
# older than this share of guidance.lost.after_s: sight is all but lost when the next one comes.
# There is no warning by NIS: the filter adapts its noise until that is as expected.
LEAST_SIGHTINGS = 15
MOST_REFUSED, MOST_LATE = 0.25, 0.6


class ControlStep(NamedTuple):
    """One control step."""

    now: float  # s
    dt: float  # since the last one, s
    granted: bool  # landerd may fly
    why: str  # why it may not, or why the current state was entered: a text of pilot_texts


class LandingState(Protocol):
    """One state of the landing; `states.TRANSITIONS` says where its events lead."""

    def enter(self, step: ControlStep) -> None:
        """Begin; no order is made yet, but the pilot may be told."""

    def order(self, step: ControlStep) -> Event | None:
        """Make the orders of one control step, or return the event that ends the state."""


class LandingContext:
    """Shared by the states, of which one at a time is active.

    Attributes:
        options: `guidance` of the configuration as it is now; parameters may change in flight.
        guided_timeout_s: time without a set-point after which the autopilot stops by itself, s.
        braking_mps2: deceleration with which a descent is braked then, m/s^2.
        estimator: where vehicle and pad are.
        orders: of this control step.
        sight: of the pad in this control step, None while it may not be flown on; see `watch`.
        attempts: the attempts at landing so far.
        below: the pad under the vehicle.
        footprint: where the feet are on the plate.
        rest: whether the vehicle rests on the pad.
        landed: what the autopilot's land detector has reported since commit.
        heading: of the vehicle, by the autopilot, rad: to keep while it stands level.
        stops_until: when the stop orders before silence end, s.
        hold_asked: the pilot asks to hold over the marker and not to land yet.
    """

    def __init__(
        self, config: Config, layout: PadLayout, estimator: Estimator, orders: Orders
    ) -> None:
        self._set(config)
        self.estimator = estimator
        self.orders = orders
        self.sight: Sight | None = None
        self.attempts = Attempts(self.options.lost)
        self.footprint = Footprint(layout.plate, config.vehicle.footprint_m)
        self.below = PadBelow(self.options, self.braking_mps2, estimator, self.footprint)
        self.rest = RestDetector(self.options, self.footprint)
        self.landed = Landed.UNDEFINED
        self.heading = 0.0
        self.stops_until = -math.inf
        self.hold_asked = False
        self._sigma_bearing = math.radians(config.estimation.gimbal_sigma_deg)

    def configure(self, config: Config) -> None:
        """Go on with changed parameters."""
        self._set(config)
        self.attempts.configure(self.options.lost)
        self.below.configure(self.options, self.braking_mps2)
        self.rest.configure(self.options)

    def _set(self, config: Config) -> None:
        self.options = config.guidance
        self.guided_timeout_s = config.autopilot.guided_timeout_s
        self.braking_mps2 = flyable_limits(config).vertical_acceleration_mps2

    # ---- what is seen --------------------------------------------------------------------------

    def _look(self, step: ControlStep, vehicle: VehicleState | None) -> Sight | None:
        """Return the sight of the pad, None while it may not be flown on (rules 2 and 5)."""
        pad = self.estimator.pad(step.now)
        age = self.estimator.sight_age(step.now)
        # The sighting must still be fresh at the next control step; MAX_STEP_S, since a step that
        # came late does not mean that the next one will.
        limit = self.options.lost.after_s - min(step.dt, MAX_STEP_S)
        if vehicle is None or pad is None or not age < limit:
            return None
        relative = self.relative(vehicle, pad)
        wrong_climb = self.estimator.poses.climb_rate_is_wrong(step.now)
        return Sight(relative, age, pad.heading, vehicle.down, pad.position[2], wrong_climb)

    def relative(self, vehicle: VehicleState, pad: PadEstimate) -> RelativeState:
        """Return the pad relative to the vehicle, both at the same time."""
        return RelativeState.between(vehicle, pad, self._sigma_bearing)

    def why_blind(self, now: float) -> str:
        """Return why there is no sight of the pad, for the pilot."""
        stale = self.estimator.stale(now)
        if stale is not None:
            return pilot_texts.STALE[stale]
        limit = self.options.lost.after_s
        searched_t, exposed_t = self.estimator.searched_t, self.estimator.exposed_t
        # Where the newest picture shows the pad, sight is lost because no newer one has come.
        is_old = self.estimator.is_shown and self.estimator.sight_age(now) >= limit - MAX_STEP_S
        if is_old or now - exposed_t > limit:
            was_late = searched_t - exposed_t >= now - searched_t
            return pilot_texts.OLD_PICTURES if was_late else pilot_texts.NO_PICTURES
        if now - self.estimator.refused_t <= self.options.lost.after_s:
            return pilot_texts.NOT_BELIEVED
        if now - self.estimator.unplaced_t <= limit:
            return pilot_texts.UNPLACED
        other = self.estimator.other
        if other is not None and now - other[0] <= self.options.lost.after_s:
            return pilot_texts.OTHER_PAD.format(id=other[1])
        return pilot_texts.NOT_IN_SIGHT

    def tell_of_health(self) -> None:
        """Warn the pilot of sightings that still suffice to land, but soon may not."""
        health = self.estimator.health.newest
        if health is None or health.sightings < LEAST_SIGHTINGS:
            return
        every_s = pilot_texts.REMIND_S
        if health.refused > MOST_REFUSED:
            self.orders.say(Severity.WARNING, pilot_texts.MANY_REFUSED, every_s=every_s)
        if health.picture_age_s > MOST_LATE * self.options.lost.after_s:
            self.orders.say(Severity.WARNING, pilot_texts.LATE_PICTURES, every_s=every_s)

    def watch(self, step: ControlStep) -> None:
        """Update the sight of the pad and what follows from it; in each step, whoever flies."""
        vehicle = self.estimator.fresh_vehicle(step.now)
        if vehicle is not None:
            self.heading = vehicle.autopilot_yaw
        sight = self.sight = self._look(step, vehicle)
        if sight is None:
            self.rest.out_of_sight()
            return
        self.below.in_sight(step.now, sight.pad_down)
        self.rest.watch(step.now, step.dt, sight, self.landed)

    def may_begin(self, now: float, *, stops: bool = False) -> bool:
        """Tell whether a landing may begin: with the pad in sight, and known to rest on it or not.

        A vehicle that may rest on the pad is not to be taken for one that flies low over it: that
        is told to climb. Where the pilot asks to hold, a vehicle on the pad waits there: his switch
        may only be on its way from low to high.

        Args:
            now: s.
            stops: landerd orders zero velocity now. With a wrong climb rate the vehicle sinks then,
                while tracking would hold its height by sight.
        """
        sinks = self.sight is not None and self.sight.climb_rate_is_wrong and not stops
        if self.sight is None or sinks:
            return False
        rests = self.rest.is_seen(now)
        waits = self.hold_asked if rests else self.rest.is_possible
        return not waits

    def why_not_begun(self, now: float) -> str:
        """Return why no landing begins although landerd may fly, for the pilot."""
        if self.sight is None:
            return self.why_blind(now)
        if self.sight.climb_rate_is_wrong:
            return pilot_texts.WRONG_CLIMB_RATE
        return pilot_texts.HOLDS_IN_THE_AIR if self.hold_asked else pilot_texts.MAY_STAND

    def stands(self, now: float) -> bool:
        """Tell whether the vehicle rests on the pad, and was not told to climb a moment ago.

        Thrust comes late, so that a vehicle told to climb may still rest. A landing that begins on
        the pad ends there: a vehicle that took off again, just to land, tipped over.
        """
        return self.rest.is_seen(now) and not self.orders.climbs

    def goes_on(self, now: float) -> bool:
        """Tell whether tracking goes on: only telemetry is missing, and for less than MOMENT_S."""
        is_seen = self.estimator.sight_age(now) < self.options.lost.after_s
        lately = now - self.attempts.tracked_t < MOMENT_S
        return is_seen and lately and self.attempts.outcome is None

    def break_off(self) -> None:
        """Count an abort; it counts as a descent's where the vehicle was low and was to land."""
        self.attempts.break_off(is_descent=self.below.low and not self.hold_asked)
