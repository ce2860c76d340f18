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
        """Nothing to begin."""

    def order(self, step: ControlStep) -> Event | None:
        """Order nothing, and say why."""
        context = self._context
        if step.granted and context.sight is not None:
            return None if context.may_rest(step.now) else Event.PAD_IN_SIGHT
        why = context.why_blind(step.now) if step.granted else step.why
        context.orders.enter(Phase.NOT_LANDING, why)
        return None


class Releasing:
    """Streams stop orders for a while after landerd has flown (rule 1b).

    Silence alone would leave the last velocity flying until the autopilot's own timeout.
    """

    def __init__(self, context: LandingContext) -> None:
        self._context = context
        self._until = -math.inf
        self._blind_t = -math.inf  # since when it may fly again and sees nothing, s

    def enter(self, step: ControlStep) -> None:
        """Begin the time of the stop orders."""
        self._until = step.now + self._context.options.release_s
        self._blind_t = step.now

    def order(self, step: ControlStep) -> Event | None:
        """Order zero velocity until the time is over, or it may fly and sees the pad.

        While it may fly again but sees nothing, the time does not run: nobody else flies then. But
        not for ever: stop orders would hold against a ground station that flies it to the pad.
        """
        context, why = self._context, step.why
        if not step.granted:
            self._blind_t = step.now
        else:
            if context.sight is not None and not context.may_rest(step.now):
                return Event.PAD_IN_SIGHT
            if step.now - self._blind_t > context.options.lost.give_up_s:
                return Event.PAD_NOT_FOUND
            self._until = step.now + context.options.release_s
            why = context.why_blind(step.now)
        if step.now < self._until:
            context.orders.stop()
            context.orders.enter(Phase.NOT_LANDING, why)
            return None
        return Event.RELEASE_OVER
