"""The landing's state machine: steps the states, follows transitions, notes how a landing ends."""

import math

from landerd.config.models import Config
from landerd.estimation.estimator import Estimator
from landerd.guidance import pilot_texts
from landerd.guidance.footprint import most_lean
from landerd.guidance.gate import Authority, Gate
from landerd.guidance.landing_context import ControlStep, LandingContext, LandingState
from landerd.guidance.last_orders import LastOrders
from landerd.guidance.limits import STOPPED, flyable_limits
from landerd.guidance.lost import LostPlan
from landerd.guidance.method import make_method
from landerd.guidance.orders import Orders
from landerd.guidance.phases import Phases
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.state_committed import Committed
from landerd.guidance.state_flying import Searching, Tracking
from landerd.guidance.state_leaving import Leaving
from landerd.guidance.state_on_pad import OnPad, Standing
from landerd.guidance.state_silent import Releasing, Silent
from landerd.guidance.states import HAND_BACKS, LANDED, OUTCOMES, TRANSITIONS, Event, State
from landerd.guidance.touchdown import Touchdown
from landerd.messages import Command, Landed, Phase, PressDown, Setpoint, Severity
from landerd.pad import PadLayout

# Duration of the wave-off in `last_orders`, s, which is flown without sight: at climb_mps it gains
# a metre at most (rule 1b).
BLIND_WAVE_OFF_S = 1.0
# Largest share of guidance.release_s for which `last_orders` wait until it lies on the pad.
MOST_WAIT = 0.8
TIPPED = math.radians(30.0)  # lean on the ground; no pad is as steep (pad_filter.MAX_TILT)
# A vehicle that leans this far, rad, for this long, s, with its feet no higher over the pad as last
# seen than this, m, turns over on the ground. One that lost a motor 0.11 m up was told to climb for
# 13 s, and thrown across the plate from one side to the other.
TURNS_OVER, TURNS_OVER_S, TURNS_OVER_BELOW_M = math.radians(60.0), 0.1, 0.5
FALLEN_M = 0.2  # below the pad: more than build errors and a drifting height explain


class Landing:
    """Steps the states of guidance.states.

    Attributes:
        state: the current one.
    """

    def __init__(self, config: Config, layout: PadLayout, gate: Gate, estimator: Estimator) -> None:
        guidance = config.guidance
        self._gate = gate
        self._orders = Orders(flyable_limits(config))
        self._context = LandingContext(config, layout, estimator, self._orders)
        self._phases = Phases(
            guidance.descent,
            has_heading=layout.has_heading,
            most_lean=most_lean(config.vehicle, guidance.descent.commit_height_m),
        )
        self._method = make_method(config)
        self._lost = LostPlan(guidance.lost)
        self._touchdown = Touchdown(config)
        context = self._context
        self._committed = Committed(context, self._method, self._touchdown)
        self._states: dict[State, LandingState] = {
            State.SILENT: Silent(context),
            State.RELEASING: Releasing(context),
            State.TRACKING: Tracking(context, self._phases, self._method),
            State.SEARCHING: Searching(context, self._lost),
            State.COMMITTED: self._committed,
            State.WAVING_OFF: Leaving(context, self._touchdown, flies_on=True),
            State.LEAVING: Leaving(context, self._touchdown),
            State.ON_PAD: OnPad(context, self._touchdown),
            State.STANDING: Standing(context, self._touchdown),
        }
        self.state = self._was_state = State.SILENT  # the current and the previous one
        self._now = -math.inf  # of the last control step, s
        self._turns_since = math.inf  # since when it has been turning over, s

    def configure(self, config: Config) -> None:
        """Go on with changed parameters."""
        guidance = config.guidance
        self._context.configure(config)
        self._orders.configure(flyable_limits(config))
        lean = most_lean(config.vehicle, guidance.descent.commit_height_m)
        self._phases.configure(guidance.descent, lean)
        self._method.configure(config)
        self._lost.configure(guidance.lost)
        self._touchdown.configure(config)

    def on_landed_state(self, landed: Landed) -> None:
        """Take the state of the autopilot's land detector; UNDEFINED when nothing is known."""
        self._context.landed = landed

    @property
    def phase(self) -> Phase:
        """The thesis's phase that the landing is in."""
        return self._orders.phase

    @property
    def has_stood(self) -> bool:
        """Whether the vehicle has come to stand on the pad, whatever that has done since."""
        return self._touchdown.stands and self.state in {State.ON_PAD, State.STANDING}

    @property
    def stands(self) -> bool:
        """Whether the vehicle stands still on the pad, as far as is known, and goes with it."""
        rests = self.has_stood and self._touchdown.has_rested
        return rests and not self._context.below.leaves_behind(self._now)

    @property
    def reason(self) -> str:
        """Why it is in that phase, in plain words."""
        return self._orders.reason

    @property
    def outcome(self) -> str | None:
        """Outcome of the last landing, None while none has ended."""
        return self._context.attempts.outcome

    @property
    def aborts(self) -> int:
        """Times a descent was broken off, or the pad went out of sight while flying."""
        return self._context.attempts.aborts

    def relative_state(self, now: float) -> RelativeState | None:
        """Return the pad relative to the vehicle at time now (s), None while either is unknown."""
        estimator = self._context.estimator
        vehicle, pad = estimator.vehicle(now), estimator.pad(now)
        return self._context.relative(vehicle, pad) if vehicle and pad else None

    def step(self, now: float, dt: float) -> list[Command]:
        """Return the orders of the control step at time now, dt (> 0) after the last, s."""
        self._now = now
        self._orders.begin(now, dt)
        if self._context.options.output == "landing_target":
            self._orders.enter(Phase.NOT_LANDING, pilot_texts.PRECISION_LANDING)
            return self._orders.commands
        authority, why = self._gate.authority(now)
        hold_asked = self._context.hold_asked = self._gate.asks_to_hold
        if self._gate.with_pilot or hold_asked:
            self._context.attempts.forgive()
        step = ControlStep(now, dt, authority is Authority.GRANTED, why)
        self._context.watch(step)
        event: Event | None = self._event_of(authority)
        while event is not None:
            step = self._follow(event, step)
            event = self._states[self.state].order(step)
        return self._orders.commands

    @property
    def last_orders(self) -> LastOrders | None:
        """What is to be streamed should the core fail now; None while nothing is flown."""
        if not any(isinstance(c, Setpoint | PressDown) for c in self._orders.commands):
            return None
        release_s = self._context.options.release_s
        if not self.has_stood and self._must_leave():
            north, east, _ = self._orders.velocity  # the pad's, and no jump to it
            away = Setpoint((north, east, -self._context.options.limits.climb_mps), 0.0)
            return LastOrders(away, BLIND_WAVE_OFF_S, STOPPED, release_s)
        if self.state in {State.ON_PAD, State.STANDING}:
            lies_in_s = 0.0 if self.has_stood else self._touchdown.levels_in_s(self._now)
            wait_s = min(lies_in_s, MOST_WAIT * release_s)
            level = PressDown(self._context.heading)
            return LastOrders(STOPPED, wait_s, level, release_s - wait_s)
        return LastOrders(None, 0.0, STOPPED, release_s)

    def _event_of(self, authority: Authority) -> Event:
        if authority is not Authority.SILENT and self._turns_over():
            return Event.TURNS_OVER
        match authority:
            case Authority.GRANTED:
                return Event.GRANTED
            case Authority.RELEASED:
                if self._must_leave():
                    return Event.RELEASED_LOW
                return Event.RELEASED_TOUCHING if self._takes_touch() else Event.RELEASED
            case Authority.SILENT:
                # ArduCopter reports a disarmed vehicle as on the ground; a disarmed heartbeat alone
                # may be false.
                on_ground = self._context.landed is Landed.ON_GROUND
                if self.state is not State.ON_PAD or not (self._gate.disarmed and on_ground):
                    return Event.SILENCED
                if self._has_tipped:
                    return Event.DISARMED_TIPPED
                on_plate = self._context.footprint.on_plate and not self._has_fallen
                return Event.DISARMED if on_plate else Event.DISARMED_OFF_PAD

    def _takes_touch(self) -> bool:
        """Take feet that may be down after commit for contact; tell whether they may be."""
        if self.state is State.COMMITTED:
            return self._committed.takes_touch(self._now)
        stops = self.state is State.RELEASING and self._was_state is State.COMMITTED
        return stops and self._committed.takes_touch_stopped(self._now)

    def _turns_over(self) -> bool:
        """Tell whether it turns over, and that is news; called at every control step."""
        leans = self._tilt > TURNS_OVER
        vehicle = self._context.estimator.fresh_vehicle(self._now) if leans else None
        turns = (
            vehicle is not None
            and self._context.below.down(self._now) - vehicle.feet[2] < TURNS_OVER_BELOW_M
        )
        self._turns_since = min(self._turns_since, self._now) if turns else math.inf
        return self._now - self._turns_since >= TURNS_OVER_S and not self._touchdown.turned_over

    @property
    def _tilt(self) -> float:
        """Lean of the airframe by the newest attitude, rad; 0 without any."""
        attitude = self._context.estimator.poses.attitude.newest
        return 0.0 if attitude is None else math.hypot(*attitude[1][:2])

    @property
    def _has_tipped(self) -> bool:
        return self._touchdown.turned_over or self._tilt > TIPPED

    @property
    def _has_fallen(self) -> bool:
        """Whether it stands lower than the pad can be: it has slid off a raised plate.

        Judged from a fresh position alone: a stale one is extrapolated, and may sink for ever.
        """
        vehicle = self._context.estimator.fresh_vehicle(self._now)
        below = 0.0 if vehicle is None else vehicle.feet[2] - self._context.below.down(self._now)
        return below > FALLEN_M

    def _must_leave(self) -> bool:
        """Tell whether a stop relative to the ground would tip the vehicle over on the pad."""
        if self.state is State.ON_PAD:
            return self._context.below.is_fast and not self._touchdown.stands
        return self._context.below.is_fast_and_close

    def _follow(self, event: Event, step: ControlStep) -> ControlStep:
        """Follow an event's transition; return the control step as the new state begins it."""
        state = TRANSITIONS[self.state].get(event)
        if state is None:
            return step
        if event in LANDED:  # replaces touchdown_unconfirmed
            self._context.attempts.outcome = OUTCOMES[event]
        elif event in OUTCOMES:
            self._context.attempts.finish(OUTCOMES[event])
        if event is Event.CLEAR_OF_PAD:
            self._context.below.leave()
        elif event is Event.TURNS_OVER:
            self._touchdown.turn_over(self._now)
            text = pilot_texts.REASONS[event]
            self._orders.say(Severity.CRITICAL, text)
            self._orders.enter(Phase.NOT_LANDING, text)
        step = step._replace(why=pilot_texts.REASONS.get(event, step.why))
        if event in HAND_BACKS:
            self._hand_back(step.why)
            step = step._replace(granted=False)
        if state is State.TRACKING:
            self._touchdown.begin(step.now)
        self._was_state, self.state = self.state, state
        self._states[state].enter(step)
        return step

    def _hand_back(self, reason: str) -> None:
        """Tell the pilot to take over; landerd flies again only after the switch was low."""
        self._orders.say(Severity.CRITICAL, pilot_texts.HANDED_BACK.format(reason=reason))
        self._gate.latch()
        self._context.attempts.forgive()
