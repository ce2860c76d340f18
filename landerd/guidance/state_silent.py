"""The states in which landerd flies nothing: SILENT and RELEASING."""

import math

from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.states import Event
from landerd.messages import Phase


class Silent:
    """Orders nothing; waits until it may fly, and then for the pad (rule 1c)."""

    def __init__(self, context: LandingContext) -> None:
        self._context = context

    def enter(self, step: ControlStep) -> None:
        """Begin to wait; a landing that was under way is over."""
        self._context.attempts.end()

    def order(self, step: ControlStep) -> Event | None:
        """Order nothing and say why, or begin a landing."""
        context = self._context
        why = step.why
        if step.granted:
            if context.may_begin(step.now):
                return Event.PAD_IN_SIGHT
            why = context.why_not_begun(step.now)
        context.orders.enter(Phase.NOT_LANDING, why, reminds=step.granted)
        return None


class Releasing:
    """Streams stop orders for a while after landerd has flown (rule 1b).

    Silence alone would leave the last velocity flying until the autopilot's own timeout.
    """

    def __init__(self, context: LandingContext) -> None:
        self._context = context
        self._began = -math.inf  # s

    def enter(self, step: ControlStep) -> None:
        """Start the time of the stop orders."""
        self._context.stops_until = step.now + self._context.options.release_s
        self._began = step.now

    def order(self, step: ControlStep) -> Event | None:
        """Order zero velocity until the time is over, or landerd may fly and sees the pad.

        While landerd may fly but sees no pad the time does not run: nobody else flies then. It ends
        after guidance.lost.give_up_s all the same, also where RC is stale now and then: stop orders
        would fight a ground station that flies the vehicle to the pad.
        """
        context, why = self._context, step.why
        if step.granted:
            if context.may_begin(step.now, stops=True):
                return Event.PAD_IN_SIGHT
            if step.now - self._began > context.options.lost.give_up_s:
                is_seen = context.sight is not None
                return Event.NO_LANDING_POSSIBLE if is_seen else Event.PAD_NOT_FOUND
            context.stops_until = step.now + context.options.release_s
            why = context.why_not_begun(step.now)
        if step.now < context.stops_until:
            context.orders.enter(Phase.NOT_LANDING, why)
            context.orders.stop()
            return None
        return Event.RELEASE_OVER
