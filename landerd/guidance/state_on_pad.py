"""The states ON_PAD, from contact on, and STANDING, where landerd may not fly on (rules 1b, 4)."""

import math

from landerd.estimation.vehicle_state import VehicleState
from landerd.guidance import pilot_texts
from landerd.guidance.contact import (
    MISSES_S,
    least_clearance,
    level_due,
    sure_slip_mps,
    tell_unconfirmed,
)
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.rest_detector import BUILD_ERROR_M
from landerd.guidance.states import Event
from landerd.guidance.touchdown import MAX_BLIND_S, MAX_CONTACT_HEIGHT_M, Touchdown
from landerd.messages import Phase

# Contact was a false one, caused by a gust, where the feet have since risen by this, m, and are
# clear of the pad: such a vehicle was pressed down in the air and, its own velocity taken for the
# pad's, carried off. The turn of the lens at a real touch shows less than this.
RISES_M = 0.05
# Nor was it one where the vehicle has sunk as in the air for this long since, s, and is out of
# sight: over a deck that began to sink a vehicle that answered late was pressed down for a second.
FLIES_S = 0.3


class OnPad:
    """Moves with the pad and presses down until the autopilot knows that it has landed.

    Once the vehicle stands still it is ordered level without thrust instead, and then disarmed.
    Until it stands still pictures are still searched: a vehicle that is seen to rise was not on the
    pad. Otherwise only the gate ends this state. When the land detector stays silent, the pilot is
    told, the outcome is `touchdown_unconfirmed`, and the orders go on.
    """

    def __init__(self, context: LandingContext, touchdown: Touchdown) -> None:
        self._context = context
        self._touchdown = touchdown
        self._clear_since = math.inf  # since when it has been clear of the pad, s

    def enter(self, step: ControlStep) -> None:
        """Begin to move with the pad; contact was noted when it was found.

        The outcome is open again: released and granted again while it stands, the landing goes on.
        """
        orders = self._context.orders
        if orders.phase is not Phase.LANDED and not self._touchdown.turned_over:
            # Released, or told to climb: that is over, and the pilot was told of it.
            orders.enter(Phase.LANDED, pilot_texts.STANDS)
        self._context.attempts.outcome = None
        self._context.stops_until = -math.inf  # the next release gets its full time
        self._context.below.touch(step.now)
        self._clear_since = math.inf

    def order(self, step: ControlStep) -> Event | None:
        """Order a disarm when it is due; and to press down, or to stand level."""
        context, orders, now = self._context, self._context.orders, step.now
        context.below.ride(now, step.dt, self._touchdown.pressed_s(now))
        self._clear_since = min(self._clear_since, now) if self._is_clear(now) else math.inf
        if now - self._clear_since >= MISSES_S or self._flies_unseen(now):
            return Event.NO_CONTACT
        if self._touchdown.disarm_due(now, context.landed):
            orders.disarm()
        if self._touchdown.unconfirmed(now, context.landed):
            context.attempts.finish("touchdown_unconfirmed")
            tell_unconfirmed(context)
        if not _stand_level(context, self._touchdown, step):
            north, east, _ = context.below.velocity
            # Relative to a deck that sinks; a deck that rises presses by itself.
            down = self._touchdown.descent(0.0) + max(0.0, context.below.heave(now)[0])
            # On stale data no descent is ordered (rule 5), until what sinks on has touched.
            descends = self._touchdown.is_down(now) or context.estimator.has_fresh_vehicle(now)
            orders.fly((north, east, down if descends else 0.0), 0.0, may_descend=descends)
        return None

    def _flies_unseen(self, now: float) -> bool:
        """Tell whether nothing holds it up, with the pad out of sight for as long as it may be."""
        is_unseen = self._context.estimator.sight_age(now) > MAX_BLIND_S
        return is_unseen and not self._touchdown.stands and self._touchdown.flies_s(now) > FLIES_S

    def _is_clear(self, now: float) -> bool:
        """Tell whether it is seen to be clear of the pad: it has risen, or the pad slides away.

        Risen: higher than contact is possible. The pad slides away: no foot can be down then.
        """
        context = self._context
        vehicle, pad = context.estimator.fresh_vehicle(now), context.estimator.pad(now)
        if self._touchdown.stands or vehicle is None or pad is None:
            return False
        relative = context.relative(vehicle, pad)
        if _has_risen(context, relative, vehicle, MAX_CONTACT_HEIGHT_M):
            return True
        slides = sure_slip_mps(relative) > context.options.descent.commit_slip_mps
        clears = least_clearance(context, relative, vehicle, pad) > BUILD_ERROR_M
        return slides and clears and context.sight is not None


class Standing:
    """Stands level without thrust when landerd may not fly on, then falls silent.

    Until the vehicle stands still the order is to stop: level on an edge it would slide off. Where
    it is stopped over a deck that sinks away it does not stand on it, and is not levelled.
    """

    def __init__(self, context: LandingContext, touchdown: Touchdown) -> None:
        self._context = context
        self._touchdown = touchdown

    def enter(self, step: ControlStep) -> None:
        """Start the time of the orders, or go on with that of a stop that was under way."""
        if step.now >= self._context.stops_until:
            self._context.stops_until = step.now + self._context.options.release_s

    def order(self, step: ControlStep) -> Event | None:
        """Order to stand level, or zero velocity, until the time is over or it may fly on."""
        context = self._context
        if step.granted:  # the switch was high again before the climb away had ended
            return Event.GRANTED
        if step.now >= context.stops_until:
            return Event.RELEASE_OVER
        context.orders.enter(Phase.NOT_LANDING, step.why)
        context.below.look(step.now)
        is_left = not self._touchdown.is_level and self._is_left(step.now)
        if is_left or not _stand_level(context, self._touchdown, step, released=True):
            context.orders.stop()
        return None

    def _is_left(self, now: float) -> bool:
        """Tell whether the pad is seen to have sunk away from under the feet."""
        context = self._context
        vehicle, pad = context.estimator.fresh_vehicle(now), context.estimator.pad(now)
        if vehicle is None or pad is None:
            return False
        return _has_risen(context, context.relative(vehicle, pad), vehicle, 0.0)


def _has_risen(
    context: LandingContext, relative: RelativeState, vehicle: VehicleState, above_m: float
) -> bool:
    """Tell whether the feet are seen to have risen since contact, to above this height, m."""
    lowest_m = context.footprint.clearance(relative, vehicle.tilt)
    return context.below.rise_m >= RISES_M and lowest_m > above_m


def _stand_level(
    context: LandingContext, touchdown: Touchdown, step: ControlStep, *, released: bool = False
) -> bool:
    """Order to stand level without thrust if that is due; tell whether it was.

    Args:
        context: of the landing.
        touchdown: that has noticed contact.
        step: of the control task.
        released: landerd may not fly on: a vehicle that stands is not pressed down any more.
    """
    vehicle = context.estimator.fresh_vehicle(step.now)
    if vehicle is None:
        level = touchdown.without_data(step.now, context.landed, released=released)
    else:
        level = level_due(context, touchdown, step, vehicle, released=released)
        stands = touchdown.has_rested and not context.below.leaves_behind(step.now)
        velocity = context.below.velocity
        context.footprint.slide(step.now, vehicle.feet, vehicle.yaw, velocity, stands=stands)
    if level:
        context.orders.stand_level(context.heading, context.below.velocity)
    return level
