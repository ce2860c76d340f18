"""The states in the air: TRACKING with the pad in sight, SEARCHING without."""

import math

from landerd.geometry import ZERO, clamp, norm, sub
from landerd.guidance import pilot_texts
from landerd.guidance.contact import is_arriving
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.lost import LostPlan
from landerd.guidance.method import Method
from landerd.guidance.phases import Phases
from landerd.guidance.relative_state import RelativeState, Sight
from landerd.guidance.sink_rate import safe_sink_rate
from landerd.guidance.states import Event
from landerd.messages import Phase, Severity

# While held over the pad: climb rate per m below the height asked for, 1/s (TrackingMethod descends
# likewise from above); and how far above that height the pilot is told that it is reached, m.
HOLD_KP = 1.5
HOLD_TOLERANCE_M = 0.3
# With a wrong climb rate the vehicle yields to a pad that seems to rise, fading out over this
# height above the one to hold, m: where the vehicle does not really sink it would climb forever.
GIVES_WAY_M = 1.0
# Farther from the landing point than this, m, no plate is below the vehicle, nor will be before it
# has climbed within the acceleration limits.
NEAR_M = 3.0
# Low over the pad without a position the vehicle climbs for this long, s: at
# guidance.lost.climb_mps out of reach of a heaving deck. One that hovered 0.3 m over a deck was
# struck by it.
BLIND_CLIMB_S = 2.0
# The pilot is told of moments without own data, each too short to be told, that come to so much, s,
# with a memory of so long, s. With 2.5 positions a second the vehicle hovered over the pad for 105
# s, until its time was over, and nobody was told why.
MOMENTS_S, MOMENTS_MEMORY_S = 0.8, 5.0
# A vehicle in DESCENT that gets lower by less than this, m, within pilot_texts.REMIND_S waits.
# Gusts kept one 4 m up for 30 s, and nobody was told why.
GETS_LOWER_M = 0.1
# The same for one in APPROACH that comes nearer by less than this, m: one that was no faster than
# its pad followed it without a word until its time was over.
GETS_NEARER_M = 1.0
# Time inside the descent region before the descent begins, s: at its edge one picture's error is
# enough to look inside.
SETTLED_S = 0.15
# Time that a pad known by its ring alone must be in sight before the descent begins, s: a
# look-alike is seldom seen for as long without a break.
RING_ALONE_S = 1.0
# A pad that was never certain to heave may rise faster than estimated: by this many sigma of its
# vertical velocity, but by no more than this, m/s, as most of the sigma is that of the sight.
# Without it the vehicle descended onto decks that rose while the estimate stood still faster than
# the autopilot's timeout stops; with one sigma it did so now and then, where the reversal of a slow
# deck had not been seen yet.
UNSURE_HEAVE_SIGMAS, UNSURE_HEAVE_MPS = 1.5, 0.2
# A deck that heaves may since the last picture have begun to rise: its velocity, at most the
# fastest seen, changes at this rate, 1/s, if it heaves at 0.25 Hz. Fully allowed for above the
# second height, m, and not below the first: there it lands within a second, and with pictures that
# are 0.35 s old it would otherwise wait for minutes.
HEAVE_RATE, HEAVE_TURNS_M = 1.6, (0.3, 0.6)
# The pilot is warned when the flown velocity differs from the ordered one by this share and by
# this, m/s, for this long, s. The slowest vehicle that lands answers 2.1 s late; ArduCopter with
# GUID_OPTIONS 32 follows no velocity at all, and a vehicle at its lean limit lags behind in wind.
UNFOLLOWED_SHARE, UNFOLLOWED_MPS, UNFOLLOWED_S = 0.5, 1.5, 5.0


class Tracking:
    """Flies to the pad and down, by phase and method; goes around where it could not land.

    While the pilot asks to hold, the vehicle stays over the pad at guidance.hold.height_m, climbing
    there from below. Ends when sight is lost, at commit, or with a hand-back: after too many
    refused descents, or when for too long the pad's heading is not seen or the vehicle leans too
    far to land.
    """

    def __init__(self, context: LandingContext, phases: Phases, method: Method) -> None:
        self._context = context
        self._phases = phases
        self._method = method
        # Last time that the landing waited neither for the pad's heading nor for a lull, s.
        self._heading_t = 0.0
        self._waits_t = 0.0  # last time that it did not wait to descend, or told why, s
        self._holds = False  # where the pilot asked to, and he was told
        self._lowest_m = math.inf  # over the pad, in DESCENT
        self._nearest_m = math.inf  # to the pad, in APPROACH
        # Since it last got lower: how far from the landing point it came, m, and why it cannot
        # descend there, for the pilot.
        self._farthest_m, self._kept_off = 0.0, ""
        self._outside_t = -math.inf  # last time outside the descent region, s
        self._seen_from = 0.0  # since when the pad has been in sight without a break, s
        self._followed_t = 0.0  # last time that the vehicle flew as ordered, s
        # Height over the pad when the climb rate was found to be wrong, m; None: it is right.
        self._held_m: float | None = None

    def enter(self, step: ControlStep) -> None:
        """Begin a landing from the vehicle's own velocity, or go on with one (`goes_on`)."""
        context = self._context
        if context.goes_on(step.now):
            return
        vehicle = context.estimator.fresh_vehicle(step.now)
        if vehicle is not None:
            north, east, down = vehicle.velocity
            # A vehicle that stands does not climb: velocity noise taken for a climb lifted one.
            down = max(down, 0.0) if context.stands(step.now) else down
            if context.sight is not None:
                # A vehicle may sink fast after a silence; orders need not, and must not from low.
                down = min(down, max(0.0, self._fastest_sinking(context.sight)))
            context.orders.go_on_from((north, east, down))
        self._heading_t = self._waits_t = self._seen_from = self._followed_t = step.now
        self._holds = False
        self._lowest_m = self._nearest_m = math.inf
        context.attempts.begin(step.now)
        context.attempts.outcome = None
        self._phases.restart()
        self._method.restart()
        context.orders.enter(Phase.APPROACH, step.why)

    def order(self, step: ControlStep) -> Event | None:
        """Order the method's velocity, down only where the phases allow it."""
        context, sight = self._context, self._context.sight
        if sight is None:
            is_low = context.below.is_fast_and_close or context.below.sinks_onto_fast
            return Event.SIGHT_LOST_LOW if is_low else Event.SIGHT_LOST
        context.attempts.tracked_t = step.now
        rests = sight.climb_rate_is_wrong and context.rest.is_seen(step.now)
        if rests and context.orders.climbs and not context.hold_asked:
            # With a wrong climb rate an order to climb does not mean that it climbs.
            north, east, _ = context.below.velocity
            context.orders.end_climb(north, east)
            return None
        if context.stands(step.now) and not context.hold_asked:
            context.orders.enter(Phase.LANDED, pilot_texts.STANDS)
            return Event.COMMITS
        context.tell_of_health()
        self._tell_if_unfollowed(step.now, sight.relative)
        event = self._event(step, sight)
        if event is None:
            self._fly(step, sight)
        return event

    def _fly(self, step: ControlStep, sight: Sight) -> None:
        """Order the method's velocity, or a climb where the vehicle has to be higher."""
        context, phases, relative = self._context, self._phases, sight.relative
        o = context.options
        hold_m = o.hold.height_m if context.hold_asked else 0.0
        floor_m = max(phases.floor_m, hold_m)
        (north, east, down), yaw_rate = self._method.step(
            phases.phase, relative, floor_m, step.dt, widening=phases.widening
        )
        climbs, heave = phases.goes_around, relative.heave
        if self._held_m is not None:
            # It waits higher up, and over the pad: one that waited in place came down half beside
            # it.
            hold_m = max(self._held_m, o.descent.retry_height_m)
            down = heave = _given_way(relative, hold_m)
            climbs = relative.height < o.descent.retry_height_m
        if climbs:
            # Relative to a deck that rises.
            down = min(0.0, heave) - o.lost.climb_mps
        elif relative.height < hold_m:
            down = heave - min(HOLD_KP * (hold_m - relative.height), o.lost.climb_mps)
        may_descend = self._may_descend(step.now, sight, floor_m)
        # A foot of a leaning vehicle may all but touch, unless pictures show the pad elsewhere.
        seen_m = relative.height + context.estimator.inconsistency.off_m
        if climbs and seen_m < o.descent.commit_height_m and relative.distance < NEAR_M:
            # At the pad's velocity: a rising deck may touch the feet, and would drag them.
            north, east, _ = relative.pad_velocity
            context.orders.climb_away(north, east)
        else:
            down = min(down, self._fastest_sinking(sight))
            context.orders.fly((north, east, down), yaw_rate, may_descend=may_descend)

    def _fastest_sinking(self, sight: Sight) -> float:
        """Return the fastest downward velocity to order, m/s."""
        context, relative = self._context, sight.relative
        # Were this the last order, the autopilot's own timeout would have to stop the vehicle in
        # time, also where it is lower than estimated.
        safe = safe_sink_rate(
            relative.least_height,
            -relative.error_rate[2],
            context.guided_timeout_s,
            context.braking_mps2,
        )
        # While a deck's heave is uncertain the vehicle waits, but does not climb for that. A pad
        # that was never certain to heave stands still, or nearly so.
        unsure = min(UNSURE_HEAVE_SIGMAS * relative.sigma_heave, UNSURE_HEAVE_MPS)
        comes_up = min(0.0, relative.pad_velocity[2] - unsure)
        least = comes_up if context.below.heaves else comes_up + safe
        low_m, high_m = HEAVE_TURNS_M
        share = clamp((relative.height - low_m) / (high_m - low_m), 0.0, 1.0)
        turned = share * HEAVE_RATE * context.below.fastest_heave * sight.age
        return max(relative.sure_heave - turned + safe, least)

    def _may_descend(self, now: float, sight: Sight, floor_m: float) -> bool:
        """Tell whether it may descend, to floor_m over the pad; called at every control step."""
        context, phases, relative = self._context, self._phases, sight.relative
        off_m = context.estimator.inconsistency.off_m
        if not phases.may_descend(relative, off_m):
            self._outside_t = now
            self._note_outside(relative, off_m)
        is_inside = now - self._outside_t >= SETTLED_S
        is_sure = relative.heading_error is not None or now - self._seen_from >= RING_ALONE_S
        is_blind = phases.is_blind(relative, sight.age)
        may_descend = is_inside and is_sure and not is_blind and relative.height > floor_m
        return may_descend and not sight.climb_rate_is_wrong

    def _tell_if_unfollowed(self, now: float, relative: RelativeState) -> None:
        """Warn the pilot of an autopilot that does not fly the ordered velocity."""
        ordered = self._context.orders.velocity
        flown = relative.vehicle_velocity
        off = norm(sub(ordered, flown))
        if off <= UNFOLLOWED_MPS or off <= UNFOLLOWED_SHARE * norm(ordered):
            self._followed_t = now
        elif now - self._followed_t > UNFOLLOWED_S:
            text = pilot_texts.UNFOLLOWED.format(off=off)
            self._context.orders.say(Severity.WARNING, text)
            self._followed_t = now  # as the figures change `say` would repeat it at once

    def _event(self, step: ControlStep, sight: Sight) -> Event | None:
        """Step the phases; return the event that ends tracking, None to go on."""
        context, phases = self._context, self._phases
        relative = sight.relative
        context.below.note(relative)
        # Not just over a pad that moves, where a stop is dangerous: it lands or goes around first.
        if context.attempts.takes_too_long(step.now) and not context.below.is_fast_and_close:
            return Event.TOOK_TOO_LONG
        went_around = phases.goes_around
        phases.watch(sight.down, relative, step.dt)
        may_land = not context.hold_asked and not sight.climb_rate_is_wrong
        arrives = self._arrives(step.now, sight)
        phase, why = phases.step(relative, sight.age, may_land=may_land, arrives=arrives)
        if self._wait_out(sight):
            return Event.NO_LANDING_POSSIBLE if context.attempts.tried_enough else None
        context.orders.enter(phase, why)
        self._tell_of_hold(phase, relative)
        if phases.goes_around and not went_around:
            context.break_off()
            context.orders.say(Severity.WARNING, why)
        elif went_around and not phases.goes_around and context.attempts.tried_enough:
            return Event.NO_LANDING_POSSIBLE
        if not context.hold_asked:
            context.attempts.begin(step.now)
        self._tell_of_wait(step.now, self._why_waits(phase, relative, why))
        waits = phase is Phase.YAW_CORRECTION and not context.hold_asked
        if not waits or (relative.heading_error is not None and not phases.leans):
            self._heading_t = step.now
        elif step.now - self._heading_t > context.options.lost.give_up_s:
            return Event.NO_LANDING_POSSIBLE if phases.leans else Event.HEADING_NOT_SEEN
        return Event.COMMITS if phase is Phase.LANDED else None

    def _arrives(self, now: float, sight: Sight) -> bool:
        """Tell whether it will stand on the plate before an order to climb takes effect.

        A vehicle that a rising deck had touched stood there, told to climb, until the deck sank.
        """
        context, relative, o = self._context, sight.relative, self._context.options.descent
        if relative.height >= o.commit_height_m:  # saves the rest in most steps
            return False
        vehicle, sinking = context.estimator.fresh_vehicle(now), -relative.error_rate[2]
        if vehicle is None or not is_arriving(relative, vehicle, sinking):
            return False
        tolerance = o.commit_miss_m
        return not context.footprint.will_miss(relative, sight.heading, sinking, tolerance)

    def _wait_out(self, sight: Sight) -> bool:
        """Tell whether to wait until the climb rate is right again; count the abort, once."""
        if not sight.climb_rate_is_wrong:
            self._held_m = None
            return False
        self._lowest_m = math.inf
        context, orders = self._context, self._context.orders
        text = pilot_texts.WRONG_CLIMB_RATE
        orders.enter(Phase.NOT_LANDING, text)
        orders.say(Severity.WARNING, text, every_s=pilot_texts.REMIND_S)
        if self._held_m is None:
            self._held_m = sight.relative.height
            context.break_off()
        return True

    def _why_waits(self, phase: Phase, relative: RelativeState, why: str) -> str:
        """Return why it comes no nearer or lower, for the pilot; "": it does, or he asked for it.

        Args:
            phase: in force.
            relative: pad relative to the vehicle.
            why: the phase's reason.
        """
        holds = self._context.hold_asked
        if phase is Phase.APPROACH or self._phases.goes_around or holds:
            self._lowest_m = math.inf
        if phase is not Phase.APPROACH:
            self._nearest_m = math.inf
        match phase:
            case Phase.APPROACH:
                return "" if self._gets_nearer(relative) else why
            case Phase.CLOSE_APPROACH | Phase.YAW_CORRECTION:
                return "" if holds else why
            case Phase.DESCENT:
                return "" if self._gets_lower(relative) else self._kept_off
        return ""

    def _tell_of_wait(self, now: float, why: str) -> None:
        """Remind the pilot why the vehicle waits; "": it does not."""
        if not why:
            self._waits_t = now
        elif now - self._waits_t > pilot_texts.REMIND_S:
            self._context.orders.say(Severity.WARNING, why)
            self._waits_t = now  # as the figures change `say` would repeat it at once

    def _gets_lower(self, relative: RelativeState) -> bool:
        """Tell whether it comes to descend; called at every control step in DESCENT."""
        if relative.height > self._lowest_m - GETS_LOWER_M:
            return False
        self._lowest_m, self._farthest_m, self._kept_off = relative.height, 0.0, ""
        return True

    def _gets_nearer(self, relative: RelativeState) -> bool:
        """Tell whether it comes nearer to the pad; called at every control step in APPROACH."""
        if relative.distance > self._nearest_m - GETS_NEARER_M:
            return False
        self._nearest_m = relative.distance
        return True

    def _note_outside(self, relative: RelativeState, off_m: float) -> None:
        """Note how far outside the descent region it is."""
        farthest_m = self._phases.farthest_m(relative, off_m)
        if farthest_m > self._farthest_m:
            radius_m = self._phases.radius_m(relative)
            self._farthest_m = farthest_m
            self._kept_off = pilot_texts.KEPT_OFF.format(off=farthest_m, radius=radius_m)

    def _tell_of_hold(self, phase: Phase, relative: RelativeState) -> None:
        """Tell the pilot, once, that the vehicle holds where he asked and waits for him."""
        context, held = self._context, self._holds
        is_there = relative.height < context.options.hold.height_m + HOLD_TOLERANCE_M
        is_over = context.hold_asked and phase is Phase.YAW_CORRECTION
        self._holds = is_over and (held or is_there)
        if self._holds:
            context.orders.enter(phase, pilot_texts.HOLDING_OVER)
            if not held:
                context.orders.say(Severity.NOTICE, pilot_texts.HOLDING_OVER)


def _given_way(relative: RelativeState, hold_m: float) -> float:
    """Return the downward velocity that holds a height although the climb rate is wrong, m/s.

    The flown climb rate is not the ordered one then, and only sight shows it: a pad that seems to
    rise means that the vehicle sinks, and is yielded to; one that seems to sink is not followed.

    Args:
        relative: pad relative to vehicle.
        hold_m: height over the pad to hold, m.
    """
    share = clamp((hold_m + GIVES_WAY_M - relative.height) / GIVES_WAY_M, 0.0, 1.0)
    return share * min(0.0, relative.pad_velocity[2])


class Searching:
    """Hovers, then climbs by the plan of guidance.lost, and never turns or sinks (rule 1d).

    Just over the pad it climbs at once. The camera sweeps meanwhile (guidance.aim). Ends when the
    pad is back in sight, or with a hand-back when the plan has ended or too many descents were
    broken off.
    """

    def __init__(self, context: LandingContext, plan: LostPlan) -> None:
        self._context = context
        self._plan = plan
        self._moments_s = 0.0  # that came lately without position or attitude; at the next time, s
        self._moments_t = -math.inf

    def enter(self, step: ControlStep) -> None:
        """Begin the plan where the vehicle is."""
        self._plan.begin(step.now, low=self._context.below.low)

    def order(self, step: ControlStep) -> Event | None:
        """Order the plan's velocity without turning; count the abort, once, unless it goes on."""
        context = self._context
        if context.attempts.tracked_t > -math.inf and not context.goes_on(step.now):
            context.break_off()
        if context.attempts.tried_enough:
            return Event.NO_LANDING_POSSIBLE
        if context.sight is not None:
            return Event.PAD_IN_SIGHT
        vehicle = context.estimator.fresh_vehicle(step.now)
        planned = self._plan.step(step.now, vehicle.feet[2] if vehicle else None)
        if context.attempts.takes_too_long(step.now):
            return Event.TOOK_TOO_LONG
        if planned is None:
            return Event.PAD_NOT_FOUND
        # A climb must be ended by height or, without a position, by time.
        climbs_blind = context.below.low and self._plan.waited_s(step.now) < BLIND_CLIMB_S
        may_climb = vehicle is not None or climbs_blind
        velocity, what = planned if may_climb else (ZERO, pilot_texts.HOLDING)
        why = pilot_texts.BLIND.format(why=context.why_blind(step.now), what=what)
        # The pilot is not told of telemetry that is stale for a moment: the landing goes on.
        if vehicle is not None or not context.goes_on(step.now):
            context.orders.enter(Phase.NOT_LANDING, why)
        elif self._moment(step) > MOMENTS_S:
            text = pilot_texts.NOW_AND_THEN.format(why=context.why_blind(step.now))
            context.orders.say(Severity.WARNING, text, every_s=pilot_texts.REMIND_S)
        context.orders.fly(velocity, 0.0, may_descend=False)
        return None

    def _moment(self, step: ControlStep) -> float:
        """Add a control step without own data; return for how long there were none lately, s."""
        kept = math.exp((self._moments_t - step.now) / MOMENTS_MEMORY_S)
        self._moments_s, self._moments_t = kept * self._moments_s + step.dt, step.now
        return self._moments_s
