"""The states at the pad: COMMITTED until contact, then ON_PAD (rule 4)."""

import math

from landerd.estimation.pad_filter import PadEstimate
from landerd.guidance import pilot_texts
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.method import Method
from landerd.guidance.states import Event
from landerd.guidance.touchdown import Touchdown
from landerd.messages import Landed, Phase, Severity

# After commit, whatever the deck does, m/s. A deck that comes up meets the vehicle: to give way to
# it would be to hover just over it. Chosen by hand: enough to be a descent.
MIN_DESCENT_MPS = 0.05


class Committed:
    """Flies down onto the pad, led by sight; region and heading no longer bind.

    Without sight it goes on with the pad as last known, and breaks off when that is older than
    touchdown.MAX_BLIND_S. Leaves at contact.
    """

    def __init__(self, context: LandingContext, method: Method, touchdown: Touchdown) -> None:
        self._context = context
        self._method = method
        self._touchdown = touchdown
        self._pad: PadEstimate | None = None  # as last known

    def enter(self, step: ControlStep) -> None:
        """Begin to watch for contact."""
        self._touchdown.begin(step.now)
        self._context.landed = Landed.UNDEFINED  # what was said of the air or another landing
        self._pad = None

    def order(self, step: ControlStep) -> Event | None:
        """Order a descent relative to the pad's own vertical motion, and go along with it."""
        context = self._context
        vehicle = context.estimator.fresh_vehicle(step.now)
        pad = self._pad_now(step.now)
        if vehicle is None or pad is None:
            return Event.SIGHT_LOST
        relative = context.relative(vehicle, pad)
        context.note_height(relative)
        context.pad_velocity = relative.pad_velocity
        heave = relative.pad_velocity[2]
        age = step.now - context.estimator.sighting_t
        event = self._touchdown.step(
            step.now,
            vehicle.velocity[2] - heave,
            context.orders.velocity[2] - heave,
            age,
            context.landed,
        )
        if event is not None:
            return event
        (north, east, _), yaw_rate = self._method.step(Phase.LANDED, relative, 0.0, step.dt)
        if age > context.options.lost.after_s:
            yaw_rate = 0.0
        descent = max(heave + self._touchdown.descent(vehicle.tilt), MIN_DESCENT_MPS)
        context.orders.fly((north, east, descent), yaw_rate, may_descend=True)
        return None

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

    Once the vehicle stands still, level without thrust instead; then disarms. Sight plays no part.
    Only the gate ends this state. When the land detector stays silent, the pilot is told, the
    outcome is `touchdown_unconfirmed`, and the orders go on.
    """

    def __init__(self, context: LandingContext, touchdown: Touchdown) -> None:
        self._context = context
        self._touchdown = touchdown

    def enter(self, step: ControlStep) -> None:
        """Nothing to begin: contact was noted when it was found."""

    def order(self, step: ControlStep) -> Event | None:
        """Order disarming when it is due; and to press down, or to stand level."""
        context, orders, now = self._context, self._context.orders, step.now
        if self._touchdown.disarm_due(now, context.landed):
            orders.disarm()
        if self._touchdown.unconfirmed(now, context.landed):
            context.finish("touchdown_unconfirmed")
            orders.say(Severity.CRITICAL, pilot_texts.UNCONFIRMED)
        vehicle = context.estimator.fresh_vehicle(now)
        sink_rate = slip = roll_pitch_rate = math.inf
        north, east, _ = context.pad_velocity
        if vehicle is not None:
            v_north, v_east, sink_rate = vehicle.velocity
            slip = math.hypot(v_north - north, v_east - east)
            roll_pitch_rate = vehicle.roll_pitch_rate
        level = self._touchdown.level_due(
            now, sink_rate, slip, roll_pitch_rate, math.hypot(north, east), context.landed
        )
        if level and vehicle is not None:
            orders.stand_level(vehicle.yaw)
        else:
            orders.fly((north, east, self._touchdown.descent(0.0)), 0.0, may_descend=True)
        return None
