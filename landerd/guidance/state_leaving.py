"""The states WAVING_OFF and LEAVING: away from the pad, or to stand on it after all (rule 1b)."""

import math

from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import horizontal, sub
from landerd.guidance.climb_away import ClimbAway
from landerd.guidance.contact import least_clearance, level_due
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.rest_detector import RESTS_MPS, RESTS_S
from landerd.guidance.states import Event
from landerd.guidance.touchdown import MAX_CONTACT_HEIGHT_M, Touchdown

# Time from the order to climb until thrust may lift the vehicle, s: levelled at 0.6 and 0.7 s it
# hopped, and fell. And until it has lifted if it ever does, s: 1.1 and 1.5 s were flown.
THRUST_BACK_S, LIFTED_S = 0.45, 2.5
# A vehicle that was told to climb, with its feet down by what is known, is on the pad if it rests
# for this long, s. Where that was known later than THRUST_BACK_S the climb went on, and ended in a
# stop before the vehicle had lifted: on 5 of 19 field days with a pad of 1 or 5 m/s and RC lost
# 0.3 s after commit, and one of these tipped over. With this, on none; two hopped, as they were
# levelled while their thrust was coming back.
RESTS_DOWN_S = 0.15
# The same where contact was noted before and the pad is unknown, as after a restart of the
# autopilot, s. Of 7 vehicles with such a restart in the last half metre 3 stayed there, told to
# climb for a second without thrust and then to stop: they hopped, or tipped over.
RESTS_UNKNOWN_S = 0.2


class Leaving:
    """Climbs away from the pad, because landerd may not fly on or the descent is broken off.

    The autopilot has taken thrust away from a vehicle pressed onto the pad, and takes a second to
    give it back. A vehicle that stands still before that stays on the pad: it would be stopped just
    as it lifts, and tip over. One that nothing held up before has all its thrust, and its turn from
    descent to climb looks like rest: levelled then, 0.1 m up, vehicles were blown off the pad. One
    that rests although told to climb is on the pad, even if contact had not been noticed. Where
    landerd may fly on, such a vehicle is pressed down again and not levelled: vehicles levelled
    just as they lifted were thrown 0.4 and 0.7 m high, and came down beside the pad.
    """

    def __init__(
        self, context: LandingContext, touchdown: Touchdown, *, flies_on: bool = False
    ) -> None:
        """Make the state.

        Args:
            context: of the landing.
            touchdown: of the landing.
            flies_on: landerd may fly on (WAVING_OFF). Then only sight decides that the vehicle
                stands: at rest it may just be reversing from descent to climb, over a pad that
                slides away.
        """
        self._context = context
        self._touchdown = touchdown
        self._flies_on = flies_on
        self._climb = ClimbAway(context)
        self._began = -math.inf
        self._thrust_back_s = 0.0
        self._rests_since = math.inf  # since when it has moved with the pad, s

    def enter(self, step: ControlStep) -> None:
        """Begin to climb."""
        self._began, self._rests_since = step.now, math.inf
        down = self._context.orders.velocity[2]
        back_s = self._touchdown.thrust_back_s(step.now, down)
        if not self._flies_on:
            may_touch = self._touchdown.may_touch or self._touchdown.has_touched
            back_s = min(back_s, THRUST_BACK_S) if may_touch else 0.0
        self._thrust_back_s = back_s
        self._climb.begin(step)

    def order(self, step: ControlStep) -> Event | None:
        """Order the climb until it is over, or the vehicle stands."""
        vehicle = self._context.estimator.fresh_vehicle(step.now)
        rests = vehicle is not None and self._may_rest(step.now, vehicle)
        self._rests_since = min(self._rests_since, step.now) if rests else math.inf
        if vehicle is not None:
            rests_s = step.now - self._rests_since
            if rests_s >= RESTS_S:
                self._note_contact(step.now, vehicle, MAX_CONTACT_HEIGHT_M)
            elif rests_s >= RESTS_DOWN_S:
                self._note_contact(step.now, vehicle, 0.0)
            if rests_s >= RESTS_UNKNOWN_S:
                self._keep_contact(step.now)
            level_due(self._context, self._touchdown, step, vehicle)
        stands = rests and self._touchdown.stands
        waited_s = step.now - self._began
        if stands and waited_s < self._thrust_back_s:
            return self._stay(step.now)
        event = self._climb.step(step)
        # Where landerd may not fly on, the climb ends in a stop even if it stands: vehicles
        # levelled then were thrown off a pad of 5 m/s.
        if not (self._flies_on and stands and event is Event.CLEAR_OF_PAD):
            return event
        # Thrust has not come back: the vehicle is not clear of the pad, and waits for it.
        if waited_s >= LIFTED_S:
            return self._stay(step.now)
        self._climb.order()
        return None

    def _stay(self, now: float) -> Event | None:
        """Keep the vehicle on the pad: end the climb, then press down or leave it standing."""
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
        """Tell whether it moves with the pad as last known: neither up nor down nor across."""
        pad = self._context.estimator.pad(now)
        below = pad.velocity if pad is not None else self._context.below.velocity
        over = sub(vehicle.velocity, below)
        slides = horizontal(over) > self._context.options.descent.commit_slip_mps
        return abs(over[2]) < RESTS_MPS and not slides

    def _note_contact(self, now: float, vehicle: VehicleState, highest_m: float) -> None:
        """Note contact if the lowest foot may be no higher over the pad than highest_m."""
        context = self._context
        pad = context.estimator.pad(now)
        if pad is None or (self._flies_on and not context.rest.is_seen(now)):
            return
        relative = context.relative(vehicle, pad)
        if least_clearance(context, relative, vehicle, pad) > highest_m:
            return
        if not self._touchdown.has_touched:
            context.footprint.touch(relative, pad.heading)
        self._touchdown.settle(self._rests_since)

    def _keep_contact(self, now: float) -> None:
        """Take contact that was noted for certain where the pad is unknown since."""
        is_unknown = self._context.estimator.pad(now) is None and not self._flies_on
        if is_unknown and self._touchdown.has_touched:
            self._touchdown.settle(self._rests_since)
