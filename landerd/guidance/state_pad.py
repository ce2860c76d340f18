"""The states at the pad: COMMITTED until contact, ON_PAD, STANDING, LEAVING (rules 1b, 4)."""

import math
from dataclasses import replace

from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import horizontal, sub
from landerd.guidance import pilot_texts
from landerd.guidance.climb_away import ClimbAway
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.method import Method
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.rest import BUILD_ERROR_M, RESTS_MPS, RESTS_S
from landerd.guidance.sink_rate import TOUCHES_AT_MPS
from landerd.guidance.states import Event
from landerd.guidance.touchdown import MAX_CONTACT_HEIGHT_M, ContactMotion, Touchdown
from landerd.messages import Landed, Phase, Severity

# After commit, whatever the deck does, m/s. A deck that comes up meets the vehicle: to give way to
# it would be to hover just over it. Chosen by hand: enough to be a descent.
MIN_DESCENT_MPS = 0.05
# Told to climb, it may lift after so long, s: levelled at 0.6 and 0.7 s it hopped, and fell.
# It has lifted after so long, if it ever does: 1.1 and 1.5 s were flown.
THRUST_BACK_S, LIFTED_S = 0.45, 2.5
# What was taken for contact was a gust where the feet are seen to have risen by so much since, m,
# and to be clear of the pad: it was pressed down in the air, and with the pad's velocity as its own
# it was carried off. The touch turns the lens less than that.
RISES_M = 0.05
# The pad is given up when it is seen for so long that it will be missed, s: two or three pictures.
MISSES_S = 0.09


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
        # Where a foot may have been down in the last step: the pad relative to it, its heading.
        self._touching: tuple[RelativeState, float | None] | None = None
        self._misses_since = math.inf
        self._watched_t = -math.inf  # the last velocity that was looked at

    def enter(self, step: ControlStep) -> None:
        """Begin to watch for contact."""
        self._touchdown.begin(step.now)
        self._watched_t = step.now
        self._context.landed = Landed.UNDEFINED  # what was said of the air or another landing
        self._pad = self._touching = None
        self._misses_since = math.inf
        self._context.attempts.end()

    def order(self, step: ControlStep) -> Event | None:
        """Order a descent relative to the pad's own vertical motion, and go along with it."""
        context = self._context
        if self._touchdown.unconfirmed(step.now, context.landed):
            _tell_unconfirmed(context)
        vehicle = context.estimator.fresh_vehicle(step.now)
        pad = self._pad_now(step.now)
        if vehicle is None or pad is None:
            return self._blind(step.now)
        relative = context.relative(vehicle, pad)
        context.below.note(relative)
        heave = relative.pad_velocity[2]
        age = context.estimator.sight_age(step.now)
        clearance = _clearance(context, relative, vehicle, pad)
        self._watch(relative, clearance)
        # Over a deck that begins to sink a vehicle that answers late is as slow against it.
        is_seen = age < context.options.lost.after_s
        highest_m = BUILD_ERROR_M if is_seen else MAX_CONTACT_HEIGHT_M
        lowest_m = _lowest_foot(relative, vehicle, pad)
        event = self._touchdown.step(step.now, age, lowest_m, context.landed, highest_m)
        self._touching = None
        if self._touchdown.may_touch and clearance <= BUILD_ERROR_M:
            self._touching = (relative, pad.heading)
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
        from, nor to wait for thrust.
        """
        return Event.CONTACT if self.takes_touch(now) else Event.SIGHT_LOST

    def takes_touch(self, now: float) -> bool:
        """Take feet that may have been down in the last step for feet on the pad; tell whether."""
        if self._touching is None:
            return False
        self._touchdown.touch(now)
        self._context.footprint.touch(*self._touching)
        return True

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


class OnPad:
    """Goes with the pad and presses down until the autopilot knows that it has landed.

    Once the vehicle stands still, level without thrust instead; then disarms. Until it stands
    still pictures are looked at: seen to rise from the pad, it was not on it. Otherwise only the
    gate ends this state. When the land detector stays silent, the pilot is told, the outcome is
    `touchdown_unconfirmed`, and the orders go on.
    """

    def __init__(self, context: LandingContext, touchdown: Touchdown) -> None:
        self._context = context
        self._touchdown = touchdown
        self._clear_since = math.inf  # of the pad

    def enter(self, step: ControlStep) -> None:
        """Begin to go with the pad; contact was noted when it was found.

        Released and granted again as it stood there, the landing goes on: how is yet to be told.
        """
        self._context.attempts.outcome = None
        self._context.below.touch(step.now)
        self._clear_since = math.inf

    def order(self, step: ControlStep) -> Event | None:
        """Order disarming when it is due; and to press down, or to stand level."""
        context, orders, now = self._context, self._context.orders, step.now
        context.below.ride(now, step.dt)
        self._clear_since = min(self._clear_since, now) if self._is_clear(now) else math.inf
        if now - self._clear_since >= MISSES_S:
            return Event.NO_CONTACT
        if self._touchdown.disarm_due(now, context.landed):
            orders.disarm()
        if self._touchdown.unconfirmed(now, context.landed):
            context.attempts.finish("touchdown_unconfirmed")
            _tell_unconfirmed(context)
        if not _stand_level(context, self._touchdown, step):
            north, east, _ = context.below.velocity
            # It presses down on a deck that sinks, and as hard on one that comes up.
            down = self._touchdown.descent(0.0) + max(0.0, context.below.heave(now)[0])
            orders.fly((north, east, down), 0.0, may_descend=True)
        return None

    def _is_clear(self, now: float) -> bool:
        """Tell whether it is seen over the pad: to have risen, or as the pad slides away.

        Risen higher than contact is believed; or with no foot down, and no contact either where the
        pad goes on without it.
        """
        context = self._context
        vehicle, pad = context.estimator.fresh_vehicle(now), context.estimator.pad(now)
        if self._touchdown.stands or vehicle is None or pad is None:
            return False
        relative = context.relative(vehicle, pad)
        if context.below.rise_m >= RISES_M:
            lowest_m = context.footprint.clearance(relative, vehicle.tilt)
            if lowest_m > MAX_CONTACT_HEIGHT_M:
                return True
        slides = _sure_slip_mps(relative) > context.options.descent.commit_slip_mps
        clears = _clearance(context, relative, vehicle, pad) > BUILD_ERROR_M
        return slides and clears and context.sight is not None


class Standing:
    """Stands level without thrust when landerd may not fly on, then leaves the vehicle there.

    Until it stands still it stops: level on an edge it would slide off.
    """

    def __init__(self, context: LandingContext, touchdown: Touchdown) -> None:
        self._context = context
        self._touchdown = touchdown
        self._until = -math.inf

    def enter(self, step: ControlStep) -> None:
        """Begin the time of the orders."""
        self._until = step.now + self._context.options.release_s

    def order(self, step: ControlStep) -> Event | None:
        """Order to stand level, or zero velocity, until the time is over."""
        if step.now >= self._until:
            return Event.RELEASE_OVER
        context = self._context
        if not _stand_level(context, self._touchdown, step, released=True):
            context.orders.stop()
        context.orders.enter(Phase.NOT_LANDING, step.why)
        return None


class Leaving:
    """Climbs away from the pad, because landerd may not fly on or the descent is broken off.

    Pressed down on it, thrust takes a second to come back. What stands still before that stays
    there: it would be stopped just as it lifts, and tip over. What is told to climb and rests is on
    the pad, also where contact had not been noticed yet. Where landerd may fly on, it is pressed
    down once more, not levelled: levelled just as they lifted, vehicles were thrown 0.4 and 0.7 m
    high, and down beside the pad.
    """

    def __init__(
        self, context: LandingContext, touchdown: Touchdown, *, flies_on: bool = False
    ) -> None:
        """Make the state.

        Args:
            context: of the landing.
            touchdown: of the descent.
            flies_on: landerd may. Then it stands only where it is seen to: it may just be turning,
                from sinking to climbing, over a pad that slides away.
        """
        self._context = context
        self._touchdown = touchdown
        self._flies_on = flies_on
        self._climb = ClimbAway(context)
        self._began = -math.inf
        self._thrust_back_s = 0.0
        self._rests_since = math.inf  # goes with the pad

    def enter(self, step: ControlStep) -> None:
        """Begin to climb."""
        self._began, self._rests_since = step.now, math.inf
        down = self._context.orders.velocity[2]
        back_s = self._touchdown.thrust_back_s(step.now, down)
        self._thrust_back_s = back_s if self._flies_on else min(back_s, THRUST_BACK_S)
        self._climb.begin(step)

    def order(self, step: ControlStep) -> Event | None:
        """Order the climb until it is over, or the vehicle stands."""
        vehicle = self._context.estimator.fresh_vehicle(step.now)
        rests = vehicle is not None and self._may_rest(step.now, vehicle)
        self._rests_since = min(self._rests_since, step.now) if rests else math.inf
        if vehicle is not None:
            if step.now - self._rests_since >= RESTS_S:
                self._note_contact(step.now, vehicle)
            _level_due(self._context, self._touchdown, step, vehicle)
        stands = rests and self._touchdown.stands
        waited_s = step.now - self._began
        if stands and waited_s < self._thrust_back_s:
            return self._stay(step.now)
        event = self._climb.step(step)
        # What may not fly on is stopped as it lifts: levelled then, a pad of 5 m/s threw it off.
        if not (self._flies_on and stands and event is Event.CLEAR_OF_PAD):
            return event
        # Its thrust has not come: it is not clear of the pad. It waits for it.
        if waited_s >= LIFTED_S:
            return self._stay(step.now)
        self._climb.order()
        return None

    def _stay(self, now: float) -> Event | None:
        """Leave it on the pad; where it is pressed down the climb ends at once."""
        if not self._flies_on:
            return Event.STANDS
        orders = self._context.orders
        if orders.velocity[2] < 0.0:
            north, east, _ = self._context.below.velocity
            orders.end_climb(north, east)
            return None
        self._touchdown.press(now)
        return Event.STANDS

    def _may_rest(self, now: float, vehicle: VehicleState) -> bool:
        """Tell whether it goes with the pad as last known: neither up nor down nor across."""
        pad = self._context.estimator.pad(now)
        below = pad.velocity if pad is not None else self._context.below.velocity
        over = sub(vehicle.velocity, below)
        slides = horizontal(over) > self._context.options.descent.commit_slip_mps
        return abs(over[2]) < RESTS_MPS and not slides

    def _note_contact(self, now: float, vehicle: VehicleState) -> None:
        context = self._context
        pad = context.estimator.pad(now)
        if pad is None or (self._flies_on and not context.rest.is_seen(now)):
            return
        relative = context.relative(vehicle, pad)
        if _clearance(context, relative, vehicle, pad) > MAX_CONTACT_HEIGHT_M:
            return
        if not self._touchdown.has_touched:
            context.footprint.touch(relative, pad.heading)
        self._touchdown.settle(self._rests_since)


def _clearance(
    context: LandingContext, relative: RelativeState, vehicle: VehicleState, pad: PadEstimate
) -> float:
    """Return the least that the lowest foot may be over the pad, m: leaning, as low as may be.

    By it a touch is allowed for; not waved off, say, for a pad that seems to slide.
    """
    return context.footprint.clearance(relative, vehicle.tilt) - _unsure_m(pad)


def _lowest_foot(relative: RelativeState, vehicle: VehicleState, pad: PadEstimate) -> float:
    """Return the height of the lowest foot over the pad, m, as airframe and plate do lean.

    By it contact is believed. Its uncertainty counts as in `_clearance`.
    """
    return relative.height - vehicle.lowest_foot(relative.normal) - _unsure_m(pad)


def _sure_slip_mps(relative: RelativeState) -> float:
    """Return how fast the pad surely slides away under it, as seen, m/s."""
    return horizontal(relative.error_rate) - 2.0 * relative.sigma_velocity


def _unsure_m(pad: PadEstimate) -> float:
    """Return by how much the pad may be higher than it is said to be, m."""
    return 2.0 * math.sqrt(pad.covariance[2][2])


def _tell_unconfirmed(context: LandingContext) -> None:
    text, every_s = pilot_texts.UNCONFIRMED, pilot_texts.REMIND_UNCONFIRMED_S
    context.orders.say(Severity.CRITICAL, text, every_s=every_s)


def _of_foot(relative: RelativeState, vehicle: VehicleState) -> RelativeState:
    """Return the same with the rate of the foot that may stand, where that slides less."""
    rate = sub(relative.pad_velocity, vehicle.foot_velocity)
    slides_less = horizontal(rate) < horizontal(relative.error_rate)
    return replace(relative, error_rate=rate) if slides_less else relative


def _stand_level(
    context: LandingContext, touchdown: Touchdown, step: ControlStep, *, released: bool = False
) -> bool:
    """Order to stand level without thrust if that is due; tell whether it was.

    Args:
        context: of the landing.
        touchdown: that has noticed contact.
        step: of the control task.
        released: landerd may not fly on: what stands is pressed down no longer.
    """
    vehicle = context.estimator.fresh_vehicle(step.now)
    if vehicle is None:
        level = touchdown.without_data(step.now, context.landed, released=released)
    else:
        level = _level_due(context, touchdown, step, vehicle, released=released)
        climb_mps = -vehicle.foot_velocity[2]
        if level and touchdown.lifts(vehicle.feet[2], climb_mps) and not context.below.heaves:
            touchdown.press(step.now)
            level = False
        stands = touchdown.stands and not context.below.leaves_behind(step.now)
        context.footprint.slide(step.now, vehicle.feet, context.below.velocity, stands=stands)
    if level:
        context.orders.stand_level(context.heading, context.below.velocity)
    return level


def _level_due(
    context: LandingContext,
    touchdown: Touchdown,
    step: ControlStep,
    vehicle: VehicleState,
    *,
    released: bool = False,
) -> bool:
    """Show the touch-down how the vehicle moves on the pad; tell whether it is to be levelled."""
    north, east, _ = context.below.velocity
    v_north, v_east, _ = vehicle.velocity
    slip = math.hypot(v_north - north, v_east - east)
    if context.sight is not None and not context.below.carries:
        # What the pad did at the touch it may do no longer: it brakes under feet that are up.
        slip = max(slip, _sure_slip_mps(context.sight.relative))
    heave, sigma_heave = context.below.heave(step.now)
    motion = ContactMotion(
        feet_down=vehicle.feet[2],
        pad_down=context.below.down(step.now),
        sink_rate=vehicle.foot_velocity[2],
        slip=slip,
        roll_pitch_rate=vehicle.roll_pitch_rate,
        pad_speed=math.hypot(north, east),
        heave=heave,
        sigma_heave=sigma_heave,
    )
    tips = context.below.carries and touchdown.leans_more(vehicle.tilt)
    ordered = context.orders.velocity[2]
    return touchdown.level_due(
        step.now, motion, ordered, context.landed, tips=tips, released=released
    )
