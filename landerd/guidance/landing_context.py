"""What the states of a landing share: the control step, what is seen, how the landing goes."""

import math
from dataclasses import dataclass
from typing import Protocol

from landerd.config.models import Config
from landerd.estimation.estimator import Estimator
from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import ZERO, angle_between, horizontal, rot_z, rotate, sub
from landerd.guidance import pilot_texts
from landerd.guidance.foothold import Foothold
from landerd.guidance.footing import Footing
from landerd.guidance.limits import MAX_STEP_S, flyable_limits
from landerd.guidance.orders import Orders
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.sink_rate import LEAD_S
from landerd.guidance.states import Event
from landerd.guidance.touchdown import MAX_CONTACT_HEIGHT_M
from landerd.messages import Landed, Severity
from landerd.pad import PadLayout

# So low over a pad so fast a stop relative to the ground would tip the vehicle over (rule 1b).
JUST_OVER_PAD_M = 0.20
SINKS_ON_S = 0.1  # for so long at least, whatever it is told then
STOPS_OVER_PAD_M = 0.10  # a foot that leans may hang so low under where sinking ends
FAST_PAD_MPS = 0.5
# A foot may be down with the lowest one so high by what is seen, m: what a builder measures gear
# and camera to, 2 cm each. Else a vehicle that stood on one foot climbed away: its pad seemed to
# slide.
BUILD_ERROR_M = 0.04
# What ends for less than this, s, breaks off no descent where it is the vehicle's own data: on a
# lossy link attitude was stale for a tick now and again, each time the landing began anew, and the
# sixth time it was handed back.
MOMENT_S = 0.3
# Told to climb, only on the pad it is so slow up and down for so long, m/s and s: from sinking to
# climbing takes half of it. Feet that stand may seem to be higher than BUILD_ERROR_M on a tilted
# pad: as low over one as contact is believed, and going with it, nothing flies for so long.
RESTS_MPS = 0.1
RESTS_S, RESTS_HIGHER_S = 0.35, 1.0
# What is seen of the height tells up and down where the autopilot's climb rate is wrong; over so
# long, s, its noise of some millimetres is less than RESTS_MPS. Chosen by hand.
HEIGHT_CHANGES_S = 0.3
# What stands on a pad and is so much slower than that was, m/s, has slid off, or its pad has
# braked: it is looked at and followed once more.
LEFT_BEHIND_MPS = 1.5
# Health of the last moments that the pilot is told of. In 38 days of the field (seeds 401 to 440)
# one window of as many sightings while tracking had a share refused above 0.13 (0.33, and sight was
# lost then). Pictures older than this share of guidance.lost.after_s are all but out of sight when
# the next one comes. NIS tells the pilot nothing: the filter learns noise until it is as expected.
LEAST_SIGHTINGS = 15
MOST_REFUSED, MOST_LATE = 0.25, 0.6


@dataclass(frozen=True, slots=True)
class ControlStep:
    """One control step, as the gate let it begin."""

    now: float  # s
    dt: float  # since the last one, s
    granted: bool  # landerd may fly
    why: str  # why not, or why the state that has its turn was entered: pilot_texts


class LandingState(Protocol):
    """One state of the landing; `states.TRANSITIONS` says where its events lead."""

    def enter(self, step: ControlStep) -> None:
        """Begin; no order is made yet, but the pilot may be told."""

    def order(self, step: ControlStep) -> Event | None:
        """Make the orders of one control step, or return the event that ends the state."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The pad in sight in one control step, of a vehicle whose own data are fresh."""

    relative: RelativeState
    age: float  # since the exposure of the last accepted sighting, s
    heading: float | None  # of the pad, local, rad; None: not known
    lean: float  # of the airframe from how it would stand on the pad, rad
    pad_down: float  # local z of the landing point, m
    # The autopilot's height contradicts its climb rate: what it is ordered up or down it flies
    # otherwise, and a pad that stands seems to rise or to sink.
    climbs_otherwise: bool


class LandingContext:
    """Shared by the states, of which one at a time is active.

    Attributes:
        options: `guidance` of the configuration as it is now; parameters may change in flight.
        guided_timeout_s: after so long without a set-point the autopilot stops, s,
        braking_mps2: and brakes the descent no harder than this.
        estimator: where vehicle and pad are.
        orders: of this control step.
        sight: of the pad in this control step, None while it may not be flown on; `watch` looks.
        outcome: of the last landing, None while none has ended.
        aborts: times a descent was broken off, or the pad went out of sight while flying.
        low: below the alignment height when the pad was last in sight.
        may_touch: so low then that a foot that leans may be all but down.
        landed: what the autopilot's land detector has said since commit.
        tracked_t: when it was flown by sight of the pad last, s; -inf: not since it was broken off.
        pad_velocity: as last seen, local NED, m/s.
        heading: of the vehicle as the autopilot told it last, rad: to stand level with.
        foothold: where the feet are on the plate.
        stops_until: the stop orders before silence last so long, s.
        hold_asked: the pilot asks to hold over the marker and not to land yet.
    """

    def __init__(
        self, config: Config, layout: PadLayout, estimator: Estimator, orders: Orders
    ) -> None:
        self.configure(config)
        self.estimator = estimator
        self.orders = orders
        self.sight: Sight | None = None
        self.outcome: str | None = None
        self.aborts = 0
        self.low = self.hold_asked = False
        self.tracked_t = self.stops_until = -math.inf
        self.landed = Landed.UNDEFINED
        self.pad_velocity = ZERO
        self.heading = 0.0
        self._course_rate = 0.0  # of the pad's velocity, rad/s
        self._fastest_heave = 0.0  # that it was surely seen to have, low over it, m/s
        self._pad_seen = 0.0, 0.0  # when it was in sight last, s, and its local z then, m
        self._known_velocity = ZERO  # the pad's, by what was seen before contact
        self.foothold = Foothold(layout.plate, config.vehicle.footprint_m)
        self._footing = Footing()
        self.may_touch = self._just_over_pad = self._sinks_onto_pad = False
        # On the pad, as far as is seen: since then, and low enough for it, s.
        self._rests_since = self._rests_low_since = math.inf
        self._may_rest = False  # there, for all that is known of its velocities
        self._height_m: float | None = None  # over the pad as seen, smoothed
        self._began = math.inf  # this landing, without having come to commit since, s
        self._sigma_bearing = math.radians(config.estimation.gimbal_sigma_deg)
        self._descents_broken_off = 0

    def configure(self, config: Config) -> None:
        """Go on with changed parameters."""
        self.options = config.guidance
        self.guided_timeout_s = config.autopilot.guided_timeout_s
        self.braking_mps2 = flyable_limits(config).vertical_acceleration_mps2

    # ---- what is seen --------------------------------------------------------------------------

    def _look(self, step: ControlStep, vehicle: VehicleState | None) -> Sight | None:
        """Return the sight of the pad, None while it may not be flown on (rules 2 and 5)."""
        pad = self.estimator.pad(step.now)
        age = self.estimator.sight_age(step.now)
        # The sighting must still be young enough when the next control step comes; one that came
        # late says nothing of the next.
        limit = self.options.lost.after_s - min(step.dt, MAX_STEP_S)
        if vehicle is None or pad is None or not age < limit:
            return None
        relative = self.relative(vehicle, pad)
        lean = angle_between(vehicle.down, pad.normal)
        otherwise = self.estimator.poses.climbs_otherwise(step.now)
        return Sight(relative, age, pad.heading, lean, pad.position[2], otherwise)

    def relative(self, vehicle: VehicleState, pad: PadEstimate) -> RelativeState:
        """Return the pad relative to the vehicle, both now."""
        return RelativeState.between(vehicle, pad, self._sigma_bearing)

    def why_blind(self, now: float) -> str:
        """Return why there is no sight of the pad, for the pilot."""
        stale = self.estimator.stale(now)
        if stale is not None:
            return pilot_texts.STALE[stale]
        limit = self.options.lost.after_s
        searched_t, frame_t = self.estimator.searched_t, self.estimator.frame_t
        # The newest picture may show the pad: then none has come that does not.
        is_old = self.estimator.is_shown and self.estimator.sight_age(now) >= limit - MAX_STEP_S
        if is_old or now - frame_t > limit:
            was_late = searched_t - frame_t >= now - searched_t
            return pilot_texts.OLD_PICTURES if was_late else pilot_texts.NO_PICTURES
        if now - self.estimator.refused_t <= self.options.lost.after_s:
            return pilot_texts.NOT_BELIEVED
        other = self.estimator.other
        if other is not None and now - other[0] <= self.options.lost.after_s:
            return pilot_texts.OTHER_PAD.format(id=other[1])
        return pilot_texts.NOT_IN_SIGHT

    def tell_of_health(self) -> None:
        """Tell the pilot of what still suffices to land, but soon may not."""
        health = self.estimator.health.newest
        if health is None or health.sightings < LEAST_SIGHTINGS:
            return
        for is_bad, text in (
            (health.refused > MOST_REFUSED, pilot_texts.MANY_REFUSED),
            (
                health.picture_age_s > MOST_LATE * self.options.lost.after_s,
                pilot_texts.LATE_PICTURES,
            ),
        ):
            if is_bad:
                self.orders.say(Severity.WARNING, text, every_s=pilot_texts.REMIND_S)

    def watch(self, step: ControlStep) -> None:
        """See in each control step, whoever flies, whether the vehicle rests on the pad."""
        vehicle = self.estimator.fresh_vehicle(step.now)
        if vehicle is not None:
            self.heading = vehicle.told_yaw
        sight = self.sight = self._look(step, vehicle)
        if sight is None:
            self._rests_since = self._rests_low_since = math.inf
            self._may_rest = False
            self._height_m = None
            return
        self._pad_seen = step.now, sight.pad_down
        relative, o = sight.relative, self.options
        is_there = relative.height <= MAX_CONTACT_HEIGHT_M and not self.foothold.will_miss(
            relative, sight.heading, o.touchdown_descent_mps, o.descent.commit_miss_m
        )
        # Just begun, it may not know yet how the lens errs; the autopilot knows what stands.
        is_low = relative.least_height <= BUILD_ERROR_M or self.landed is Landed.ON_GROUND
        changes = self._height_rate(relative.height, step.dt)
        up = abs(changes if sight.climbs_otherwise else relative.error_rate[2])
        across = horizontal(relative.error_rate)
        rests = is_there and up < RESTS_MPS and across < o.descent.commit_slip_mps
        # The first pictures after a while without any tell little of the pad's velocity.
        self._may_rest = (
            is_there
            and up < RESTS_MPS + 2.0 * relative.sigma_heave
            and across < o.descent.commit_slip_mps + 2.0 * relative.sigma_velocity
        )
        self._rests_since = min(self._rests_since, step.now) if rests else math.inf
        is_low = is_low and rests
        self._rests_low_since = min(self._rests_low_since, step.now) if is_low else math.inf

    def _height_rate(self, height: float, dt: float) -> float:
        """Return how fast the height over the pad is seen to change lately, m/s; up is positive."""
        last = height if self._height_m is None else self._height_m
        self._height_m = last + min(1.0, dt / HEIGHT_CHANGES_S) * (height - last)
        return (height - self._height_m) / HEIGHT_CHANGES_S

    def rests(self, now: float) -> bool:
        """Tell whether it is seen to have rested on the pad for some time."""
        low_s, higher_s = now - self._rests_low_since, now - self._rests_since
        return low_s >= RESTS_S or higher_s >= RESTS_HIGHER_S

    def may_begin(self, now: float) -> bool:
        """Tell whether a landing may begin: it sees the pad, and whether it rests on it is known.

        Taken to fly low over the pad, what may rest there was told to climb. Where the pilot asks
        to hold it waits on the pad: his switch may only be on its way from low to high.
        """
        rests = self.rests(now)
        waits = self.hold_asked if rests else self._may_rest
        waits = waits or (self.sight is not None and self.sight.climbs_otherwise)
        return self.sight is not None and not waits

    def why_not_begun(self, now: float) -> str:
        """Return why no landing begins although it may fly, for the pilot."""
        if self.sight is None:
            return self.why_blind(now)
        if self.sight.climbs_otherwise:
            return pilot_texts.WRONG_CLIMB_RATE
        return pilot_texts.HOLDS_IN_THE_AIR if self.hold_asked else pilot_texts.MAY_STAND

    def stands(self, now: float) -> bool:
        """Tell whether it rests so and was not told to climb: its thrust comes late.

        A landing that begins so ends there: taken off again, just to land, it tipped over.
        """
        return self.rests(now) and not self.orders.climbs

    # ---- how the landing goes ------------------------------------------------------------------

    def note(self, relative: RelativeState) -> None:
        """Keep how low it is over what: what to do when sight or authority ends hangs on it."""
        self.low = relative.height < self.options.descent.alignment_height_m
        sinking = max(0.0, -relative.error_rate[2])
        self.may_touch = relative.height < JUST_OVER_PAD_M
        self._just_over_pad = relative.height - SINKS_ON_S * sinking < JUST_OVER_PAD_M
        stops_m = LEAD_S * sinking + sinking * sinking / (2.0 * self.braking_mps2)
        self._sinks_onto_pad = relative.height - stops_m < STOPS_OVER_PAD_M
        self.pad_velocity = relative.pad_velocity
        self._course_rate = relative.course_rate
        surely = abs(relative.pad_velocity[2]) - 2.0 * relative.sigma_heave
        self._fastest_heave = max(self._fastest_heave, surely) if self.low else 0.0

    @property
    def heaves(self) -> bool:
        """Whether the pad was surely seen to heave, low over it."""
        return self._fastest_heave > 0.0

    def touch(self, now: float) -> None:
        """Begin to go with the pad: its velocity is what was known of it at the touch."""
        self._known_velocity = self.pad_velocity
        self._footing.begin(now)

    def ride(self, step: ControlStep) -> None:
        """Go with the pad: as it drove and turned when it was seen last, or as what it carries."""
        self._known_velocity = rotate(rot_z(self._course_rate * step.dt), self._known_velocity)
        glimpse, vehicle = self.estimator.glimpse, self.estimator.fresh_vehicle(step.now)
        is_new = glimpse is not None and self._footing.look(glimpse, self._known_velocity)
        if glimpse is not None and is_new:
            pad = self.estimator.pad(step.now)
            self.foothold.see(glimpse.to_pad, None if pad is None else pad.heading)
        if not self._footing.holds:
            self.pad_velocity = self._known_velocity
        elif vehicle is not None:  # else as it went last: what was known has proved wrong
            north, east, _ = vehicle.velocity
            self.pad_velocity = (north, east, self._known_velocity[2])

    @property
    def rise_m(self) -> float:
        """How far the feet are seen to have risen from the pad since contact was noticed, m."""
        return self._footing.rise_m

    @property
    def is_carried(self) -> bool:
        """Whether the pad is seen to take the vehicle along, otherwise than it was known to go."""
        return self._footing.holds

    def is_left_behind(self, now: float) -> bool:
        """Tell whether the vehicle is much slower or faster than the pad was when last seen."""
        vehicle = self.estimator.fresh_vehicle(now)
        if vehicle is None:
            return False
        return horizontal(sub(vehicle.velocity, self.pad_velocity)) > LEFT_BEHIND_MPS

    def heave(self, now: float) -> tuple[float, float]:
        """Return the pad's vertical velocity as far as it is known, and its sigma, m/s.

        A deck that is not seen any more may heave as fast as it did, up or down.
        """
        pad = self.estimator.pad(now)
        if pad is None or self.estimator.sight_age(now) > self.options.lost.after_s:
            return 0.0, self._fastest_heave
        return pad.velocity[2], pad.sigma_velocity[2]

    def pad_down(self, now: float) -> float:
        """Return local z of the pad, m: where it is not seen, as far down as it may be by now.

        An autopilot's height that drifts carries down pad and vehicle alike.
        """
        t, down = self._pad_seen
        return down + max(2.0 * self._fastest_heave, self.pad_velocity[2]) * (now - t)

    def leave_pad(self) -> None:
        """It has climbed away from the pad: what was just under it is so no more."""
        self._just_over_pad = self._sinks_onto_pad = False

    @property
    def over_fast_pad(self) -> bool:
        """Whether the pad, as last seen, is too fast to stop on."""
        return horizontal(self.pad_velocity) > FAST_PAD_MPS

    @property
    def just_over_fast_pad(self) -> bool:
        """Whether it is so low over such a pad that it would touch it."""
        return self._just_over_pad and self.over_fast_pad

    @property
    def sinks_onto_fast_pad(self) -> bool:
        """Whether it would touch such a pad while it is stopped."""
        return self._sinks_onto_pad and self.over_fast_pad

    def begin_landing(self, now: float) -> None:
        """Take the time that a landing may take from now on, unless it runs already."""
        self._began = min(self._began, now)

    def end_landing(self) -> None:
        """Take no more time: it has come to commit, or is over."""
        self._began = math.inf

    def takes_too_long(self, now: float) -> bool:
        """Tell whether the landing should have come to commit by now."""
        return now - self._began > self.options.lost.total_s

    def goes_on(self, now: float) -> bool:
        """Tell whether nothing but the vehicle's own data is missing, and that for a moment."""
        is_seen = self.estimator.sight_age(now) < self.options.lost.after_s
        return is_seen and now - self.tracked_t < MOMENT_S and self.outcome is None

    def break_off(self) -> None:
        """Count an abort; those of descents are limited in number (guidance.lost.retries)."""
        self.tracked_t = -math.inf
        self.aborts += 1
        if self.low and not self.hold_asked:
            self._descents_broken_off += 1

    @property
    def tried_enough(self) -> bool:
        """Whether more descents were broken off than are allowed."""
        return self._descents_broken_off > self.options.lost.retries

    def forgive(self) -> None:
        """Count broken-off descents and the landing's time anew: the pilot flies, or waits."""
        self._descents_broken_off = 0
        self.end_landing()

    def finish(self, outcome: str) -> None:
        """Keep the first outcome of a landing: what follows is its consequence."""
        if self.outcome is None:
            self.outcome = outcome
