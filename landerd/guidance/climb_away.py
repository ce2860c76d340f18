"""The climb away from the pad: what WAVING_OFF and LEAVING order (rule 1b)."""

import math

from landerd.guidance import pilot_texts
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.states import Event
from landerd.messages import Phase

# Duration and height of a climb away; design rule 1b: at most 1 s or 0.5 m.
WAVE_OFF_S, WAVE_OFF_M = 1.0, 0.4
# While landerd may fly on, a vehicle that has not gained WAVE_OFF_M goes on for up to this long, s:
# one whose thrust came back late was stopped with its feet 6 cm over a pad that drove on.
SLOW_WAVE_OFF_S = 2.0


class ClimbAway:
    """Climbs away from the pad at the pad's velocity, without turning.

    Just over a pad that moves, or with feet on it, a stop relative to the ground would tip the
    vehicle over. Ends WAVE_OFF_M higher, or after WAVE_OFF_S (SLOW_WAVE_OFF_S).
    """

    def __init__(self, context: LandingContext) -> None:
        self._context = context
        self._why = ""
        self._began = -math.inf
        self._from_down: float | None = None  # local z of the feet then, m

    def begin(self, step: ControlStep) -> None:
        """Begin to climb."""
        self._began = step.now
        vehicle = self._context.estimator.fresh_vehicle(step.now)
        self._from_down = vehicle.feet[2] if vehicle else None
        context = self._context
        why = step.why if step.why != pilot_texts.GRANTED else context.why_blind(step.now)
        self._why = pilot_texts.BLIND.format(why=why, what=pilot_texts.CLIMBING_AWAY)

    def step(self, step: ControlStep) -> Event | None:
        """Order the climb; return CLEAR_OF_PAD when it is high enough, or the time is over."""
        climbed_m = self._climbed_m(step.now)
        is_slow = step.granted and climbed_m is not None
        most_s = SLOW_WAVE_OFF_S if is_slow else WAVE_OFF_S
        if step.now - self._began >= most_s or (climbed_m or 0.0) >= WAVE_OFF_M:
            return Event.CLEAR_OF_PAD
        self.order()
        return None

    def order(self) -> None:
        """Order the climb."""
        context = self._context
        sight = context.sight
        if sight is not None:
            context.below.note(sight.relative)
        context.orders.enter(Phase.NOT_LANDING, self._why)
        north, east, _ = context.below.velocity
        if context.below.may_touch:
            context.orders.climb_away(north, east)
        else:  # there is room to begin within the acceleration limits
            climb = (north, east, -context.options.limits.climb_mps)
            context.orders.fly(climb, 0.0, may_descend=False)

    def _climbed_m(self, now: float) -> float | None:
        """Return the height gained over the pad, m, the pad's heave extrapolated; None: unknown."""
        context = self._context
        vehicle = context.estimator.fresh_vehicle(now)
        if vehicle is None or self._from_down is None:
            return None
        return self._from_down - vehicle.feet[2] + (now - self._began) * context.below.velocity[2]
