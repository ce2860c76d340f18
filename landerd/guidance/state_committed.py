"""The state COMMITTED: from commit until contact (rule 4)."""

import math
from dataclasses import replace

from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import horizontal, sub
from landerd.guidance import pilot_texts
from landerd.guidance.contact import (
    MISSES_S,
    foot_height,
    is_arriving,
    least_clearance,
    lowest_foot,
    tell_unconfirmed,
)
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.method import Method
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.rest import BUILD_ERROR_M
from landerd.guidance.sink_rate import TOUCHES_AT_MPS
from landerd.guidance.states import Event
from landerd.guidance.touchdown import MAX_CONTACT_HEIGHT_M, Touchdown
from landerd.messages import Landed, Phase, Severity

# After commit, whatever the deck does, m/s. A deck that comes up meets the vehicle: to give way to
# it would be to hover just over it. Chosen by hand: enough to be a descent.
MIN_DESCENT_MPS = 0.05


class Committed:
    """Flies down onto the pad, led by sight; region and heading no longer bind.

    Without sight it goes on with the pad as last known, and breaks off when contact would come
    later than touchdown.MAX_BLIND_S after it; with sight it breaks off when it would miss the pad.
    So it does when the pilot asks to hold after all. Leaves at contact.
    """

    def __init__(self, context: LandingContext, method: Method, touchdown: Touchdown) -> None:
        self._context = context
        self._method = method
        self._touchdown = touchdown
        self._pad: PadEstimate | None = None  # as last known
        # Where a foot may have been down in the last step, or is before a climb would answer: the
        # pad relative to it, its heading.
        self._touching: tuple[RelativeState, float | None] | None = None
        self._arriving: tuple[RelativeState, float | None] | None = None
        self._misses_since = math.inf
        self._watched_t = -math.inf  # the last velocity that was looked at

    def enter(self, step: ControlStep) -> None:
        """Begin to watch for contact."""
        self._touchdown.begin(step.now)
        self._watched_t = step.now
        self._context.landed = Landed.UNDEFINED  # what was said of the air or another landing
        self._pad = self._touching = self._arriving = None
        self._misses_since = math.inf
        self._context.attempts.end()

    def order(self, step: ControlStep) -> Event | None:
        """Order a descent relative to the pad's own vertical motion, and go along with it."""
        context = self._context
        if self._touchdown.unconfirmed(step.now, context.landed):
            tell_unconfirmed(context)
        vehicle = context.estimator.fresh_vehicle(step.now)
        pad = self._pad_now(step.now)
        if vehicle is None or pad is None:
            return self._blind(step.now)
        relative = context.relative(vehicle, pad)
        context.below.note(relative)
        heave = relative.pad_velocity[2]
        age = context.estimator.sight_age(step.now)
        clearance = least_clearance(context, relative, vehicle, pad)
        self._watch(relative, clearance)
        # Over a deck that begins to sink a vehicle that answers late is as slow against it.
        is_seen = age < context.options.lost.after_s
        highest_m = BUILD_ERROR_M if is_seen else MAX_CONTACT_HEIGHT_M
        lowest_m = lowest_foot(relative, vehicle, pad)
        event = self._touchdown.step(step.now, age, lowest_m, context.landed, highest_m)
        at = (relative, pad.heading)
        self._touching = at if self._touchdown.may_touch and clearance <= BUILD_ERROR_M else None
        sinking = vehicle.foot_velocity[2] - heave
        self._arriving = at if is_arriving(relative, vehicle, sinking) else None
        if event is None and context.stands(step.now):  # as where a landing begins on the pad
            self._touchdown.touch(step.now)
            event = Event.CONTACT
        if event is Event.CONTACT:
            self._note_contact(relative, pad.heading, lowest_m)
        if event is not None:
            return event
        # A touch turns the airframe faster than the lens's direction is known: nothing is to be
        # told of where the pad is then.
        if context.hold_asked and not self._touchdown.may_touch:
            return Event.HOLD_ASKED
        in_air = clearance > (BUILD_ERROR_M if self._touchdown.may_touch else 0.0)
        if in_air and self._misses(step.now, _of_foot(relative, vehicle), pad.heading):
            return Event.PAD_MISSED
        (north, east, _), yaw_rate = self._method.step(Phase.LANDED, relative, 0.0, step.dt)
        if age > context.options.lost.after_s:
            yaw_rate = 0.0
        sink_rate = self._touchdown.descent(vehicle.tilt)
        if relative.height > context.options.descent.commit_height_m:  # it came up once more
            sink_rate = min(sink_rate, TOUCHES_AT_MPS)
        descent = max(heave + sink_rate, MIN_DESCENT_MPS)
        context.orders.fly((north, east, descent), yaw_rate, may_descend=True)
        return None

    def _note_contact(
        self, relative: RelativeState, heading: float | None, lowest_m: float
    ) -> None:
        """Note where it touches, and tell the pilot if that is where nothing should be."""
        context = self._context
        context.footprint.touch(relative, heading)
        if lowest_m > MAX_CONTACT_HEIGHT_M:
            text = pilot_texts.TOUCHED_HIGH.format(height=lowest_m)
            context.orders.say(Severity.WARNING, text)

    def _blind(self, now: float) -> Event:
        """Return what it means that data are too old all at once.

        Feet that are touching are not lifted again for that: half on the pad is no place to climb
        from, nor to wait for thrust. Nor are those that will be down before thrust answers: told
        to climb then, vehicles were dragged across the plate.
        """
        self._touching = self._touching or self._arriving
        return Event.CONTACT if self.takes_touch(now) else Event.SIGHT_LOST

    def takes_touch(self, now: float) -> bool:
        """Take feet that may have been down in the last step for feet on the pad; tell whether."""
        if self._touching is None:
            return False
        self._touchdown.touch(now)
        self._context.footprint.touch(*self._touching)
        return True

    def takes_touch_stopped(self, now: float) -> bool:
        """Take it for a touch where it is stopped in wind with a foot down; tell whether.

        Where nothing is ordered up or down sinking does not tell it: the height alone does.
        """
        vehicle, pad = self._context.estimator.fresh_vehicle(now), self._pad_now(now)
        if vehicle is None or pad is None:
            return False
        relative = self._context.relative(vehicle, pad)
        is_down = foot_height(relative, vehicle) <= 0.0
        if not (is_down and self._touchdown.leaned):
            return False
        self._touching = (relative, pad.heading)
        return self.takes_touch(now)

    def _watch(self, relative: RelativeState, clearance: float) -> None:
        """Show the touch-down each velocity measured since the last control step.

        After a step that came late, feet that have been down meanwhile are known from them.
        """
        heave = relative.pad_velocity[2]
        ordered = self._context.orders.velocity[2]
        unsure = 2.0 * relative.sigma_heave if clearance <= BUILD_ERROR_M else 0.0
        for t, foot in self._context.estimator.velocities(self._watched_t):
            self._touchdown.watch(t, (foot[2], ordered), heave, unsure)
            self._watched_t = t

    def _misses(self, now: float, relative: RelativeState, heading: float | None) -> bool:
        """Tell whether, as seen for some time now, it will not stand on the pad.

        A pad that is seen where it cannot be has stopped, started or been moved. Where sightings
        have agreed to the millimetre, some millimetres are more than their noise explains, as
        when other markers of the pad come into use; then it must be as far off as a pad that
        slides away too fast to touch would be by now.
        """
        options, estimator = self._context.options, self._context.estimator
        too_far_m = options.descent.commit_slip_mps * MISSES_S
        inconsistency = estimator.inconsistency
        is_elsewhere = inconsistency.lasts_s >= MISSES_S and inconsistency.off_m > too_far_m
        if is_elsewhere and not self._touchdown.may_touch:
            return True
        sink_rate = options.touchdown_descent_mps
        tolerance = options.descent.commit_miss_m
        misses = estimator.sight_age(now) < options.lost.after_s and (
            horizontal(relative.error_rate) > options.descent.commit_slip_mps
            or self._context.footprint.will_miss(relative, heading, sink_rate, tolerance)
        )
        self._misses_since = min(self._misses_since, now) if misses else math.inf
        return now - self._misses_since >= MISSES_S

    def _pad_now(self, now: float) -> PadEstimate | None:
        """Return the pad, as last known when the filter has begun anew.

        At the touch the airframe turns faster than gimbal and clock are known: sightings are
        refused until the filter begins anew. After commit that is no reason to climb.
        """
        pad = self._context.estimator.pad(now)
        if pad is None and self._pad is not None:
            return self._pad.moved(now)
        self._pad = pad
        return pad


def _of_foot(relative: RelativeState, vehicle: VehicleState) -> RelativeState:
    """Return the same with the rate of the foot that may stand, where that slides less."""
    rate = sub(relative.pad_velocity, vehicle.foot_velocity)
    slides_less = horizontal(rate) < horizontal(relative.error_rate)
    return replace(relative, error_rate=rate) if slides_less else relative
