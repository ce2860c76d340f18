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
from landerd.guidance.rest_detector import BUILD_ERROR_M
from landerd.guidance.sink_rate import TOUCHES_AT_MPS
from landerd.guidance.states import Event
from landerd.guidance.touchdown import MAX_BLIND_S, MAX_CONTACT_HEIGHT_M, Touchdown
from landerd.messages import Landed, Phase, Severity

# Slowest descent after commit, m/s, in local NED, even over a deck that rises: yielding to that
# would be to hover just over it. Chosen by hand, just enough to be a descent.
MIN_DESCENT_MPS = 0.05
# The switch must be in its middle for this long, s, to ask for a hold: on its way from high to low
# it is there for one or two of the RC messages, 0.05 s apart. Where these broke off the descent,
# the release that followed stopped a vehicle that leaned by 18 degrees, and once a foot was down it
# was not levelled.
HOLD_ASKED_S = 0.15
# A foot that will be down before thrust answers (contact.is_arriving) is down after this time, s:
# where its height was wrong by a centimetre it was so 0.23 s later.
ARRIVES_S = 0.3


class Committed:
    """Flies down onto the pad by sight; descent region and heading no longer bind.

    Out of sight it goes on with the pad extrapolated, and breaks off when contact would come later
    than touchdown.MAX_BLIND_S after the last sighting. It also breaks off when it would miss the
    pad, or when the pilot asks to hold after all. Ends at contact.
    """

    def __init__(self, context: LandingContext, method: Method, touchdown: Touchdown) -> None:
        self._context = context
        self._method = method
        self._touchdown = touchdown
        self._pad: PadEstimate | None = None  # as last known
        # Relative state and pad's heading (rad) in the last step: if a foot may have been down
        # then, and if one will be down before a climb takes effect. Else None.
        self._touching: tuple[RelativeState, float | None] | None = None
        self._arriving: tuple[RelativeState, float | None] | None = None
        self._misses_since = self._hold_since = math.inf
        self._watched_t = -math.inf  # time of the last velocity passed to the touch-down, s

    def enter(self, step: ControlStep) -> None:
        """Begin to watch for contact."""
        self._touchdown.begin(step.now)
        self._watched_t = step.now
        self._context.landed = Landed.UNDEFINED  # earlier reports are of another landing
        self._pad = self._touching = self._arriving = None
        self._misses_since = self._hold_since = math.inf
        self._context.attempts.end()

    def order(self, step: ControlStep) -> Event | None:
        """Order a descent relative to the pad's own motion, or return what ends it."""
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
        # Fresh sight bounds the height of contact: over a deck that begins to sink, a vehicle that
        # answers late closes as slowly as one that stands.
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
        is_lost = event is Event.SIGHT_LOST and age <= MAX_BLIND_S
        if is_lost and foot_height(relative, vehicle) > -BUILD_ERROR_M:
            # A climb would begin with its feet on the pad, unless that is lower than estimated.
            return self._blind(step.now)
        if event is not None:
            return event
        # From a touch on sight says little: it turns the airframe faster than the direction of the
        # lens is known.
        if self._asks_to_hold(step.now) and not self._touchdown.may_touch:
            return Event.HOLD_ASKED
        in_air = clearance > (BUILD_ERROR_M if self._touchdown.may_touch else 0.0)
        if in_air and self._misses(step.now, _of_foot(relative, vehicle), pad.heading):
            return Event.PAD_MISSED
        (north, east, _), yaw_rate = self._method.step(Phase.LANDED, relative, 0.0, step.dt)
        if age > context.options.lost.after_s:
            yaw_rate = 0.0
        sink_rate = self._touchdown.descent(vehicle.tilt)
        if relative.height > context.options.descent.commit_height_m:  # the deck has sunk since
            sink_rate = min(sink_rate, TOUCHES_AT_MPS)
        descent = max(heave + sink_rate, MIN_DESCENT_MPS)
        context.orders.fly((north, east, descent), yaw_rate, may_descend=True)
        return None

    def _asks_to_hold(self, now: float) -> bool:
        """Tell whether the switch stays in its middle; called until contact."""
        asked = self._context.hold_asked
        self._hold_since = min(self._hold_since, now) if asked else math.inf
        return now - self._hold_since >= HOLD_ASKED_S

    def _note_contact(
        self, relative: RelativeState, heading: float | None, lowest_m: float
    ) -> None:
        """Note where it touches; warn the pilot if that is higher than the pad can be."""
        context = self._context
        context.footprint.touch(relative, heading)
        if lowest_m > MAX_CONTACT_HEIGHT_M:
            text = pilot_texts.TOUCHED_HIGH.format(height=lowest_m)
            context.orders.say(Severity.WARNING, text)

    def _blind(self, now: float) -> Event:
        """Return the event that follows when telemetry is stale, or the pad unknown or unseen.

        Contact where a foot was touching, or will be down before thrust answers: vehicles that
        were told to climb then were dragged across the plate. Else sight is lost.
        """
        return Event.CONTACT if self.takes_touch(now) else Event.SIGHT_LOST

    def takes_touch(self, now: float) -> bool:
        """Take feet that may have been down in the last step, or arrive, for contact; tell whether.

        Args:
            now: s.
        """
        comes_s = ARRIVES_S if self._touching is None else 0.0
        self._touching = self._touching or self._arriving
        if self._touching is None:
            return False
        self._touchdown.touch(now, comes_s)
        self._context.footprint.touch(*self._touching)
        return True

    def takes_touch_stopped(self, now: float) -> bool:
        """Take a foot that is down, of a vehicle stopped in wind, for contact; tell whether.

        With no descent ordered the sink rate says nothing of contact: the height alone does.
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
        """Pass each velocity measured since the last control step to the touch-down.

        After a step that came late they show feet that have touched in between.
        """
        heave = relative.pad_velocity[2]
        ordered = self._context.orders.velocity[2]
        unsure = 2.0 * relative.sigma_heave if clearance <= BUILD_ERROR_M else 0.0
        for t, foot in self._context.estimator.velocities(self._watched_t):
            self._touchdown.watch(t, (foot[2], ordered), heave, unsure)
            self._watched_t = t

    def _misses(self, now: float, relative: RelativeState, heading: float | None) -> bool:
        """Tell whether sight has shown for MISSES_S that the vehicle will not stand on the pad.

        Either the feet will miss it or slide across it; or the sightings are inconsistent with the
        estimate, as of a pad that has stopped, started or been moved. Sightings that have agreed to
        the millimetre become inconsistent by millimetres when other markers come into use: the pad
        must be off by as much as one that slides at commit_slip_mps would be by now.
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
        """Return the pad; extrapolated from the last estimate where the filter has restarted.

        At the touch the airframe turns faster than gimbal and clock are known: sightings are
        refused until the filter restarts. After commit that is no reason to climb.
        """
        pad = self._context.estimator.pad(now)
        if pad is None and self._pad is not None:
            return self._pad.moved(now)
        self._pad = pad
        return pad


def _of_foot(relative: RelativeState, vehicle: VehicleState) -> RelativeState:
    """Return the state with the error rate of the foot that sinks slowest, if that slides less."""
    rate = sub(relative.pad_velocity, vehicle.foot_velocity)
    slides_less = horizontal(rate) < horizontal(relative.error_rate)
    return replace(relative, error_rate=rate) if slides_less else relative
