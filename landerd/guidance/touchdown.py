"""From commit to disarmed motors (design rule 4).

"Measured" below is ArduCopter 4.5.7 in SITL, whose step responses bench/step_response.py has.
What was tried in wind is the campaign `guidance` with its rows wind-8 and wind-12.
"""

import math
from dataclasses import dataclass

from landerd.config.models import Config
from landerd.geometry import clamp
from landerd.guidance.states import Event
from landerd.messages import Landed

# ---- contact -----------------------------------------------------------------------------------
# A sink rate below this part of the order is contact. Measured: in the air it is above this from
# 0.4 s after the order on, on the ground it is below, and the vehicle rebounds 0.2 s later.
CONTACT_SINK_SHARE = 0.4
# Where a foot may be down by its height, more of it is contact: by what is not known of the pad's
# heave; and while the airframe turns as an edge that touches turns it, about which its middle goes
# on sinking. But no more than this part: in the air it sinks faster.
MAX_CONTACT_SINK_SHARE = 0.7
CONTACT_S = 0.2  # for so long: shorter slow moments are gusts
# After commit before contact is looked for, s, and so long an order must have stood: measured, a
# vehicle that hovered sinks at 0.6 of the order by then. Without it contact was called 0.25 s after
# commit, 11 cm up; and 9 cm up of a slow vehicle that was to sink quicker for its lean.
ANSWER_S = 0.4
# Before that, what it would sink at in the air by now counts, once it is so much of the gentle
# descent: a deck that came up met the feet 0.06 s after commit, and was climbed away from.
ANSWERED_SHARE = 0.5
# From the last sighting until contact is noticed, s; the rule allows 1.0.
MAX_BLIND_S = 0.97
# No contact is believed with the lowest foot higher over the pad than this, m (design rule 4): a
# gust or the air cushion over the plate slows the sinking too.
MAX_CONTACT_HEIGHT_M = 0.10
# But where gear or camera were measured wrong: what is so slow for so long, s, is held up, and
# sooner if the land detector says so as well. With gear 10 cm longer than configured vehicles stood
# under thrust, climbed off again, or tipped over, and the pilot never heard why.
WRONG_BUILD_M = 0.20
HELD_UP_S, SAID_HELD_UP_S = 1.2, 0.6
# ON_GROUND is believed so long after contact, s: ArduCopter's land detector takes 1 s at least.
# What says it sooner is wrong, and to disarm on its word would be to fall.
CONFIRMED_S = 0.5

# ---- the descent onto the pad ------------------------------------------------------------------
# From the first foot's touch to the last one's, in wind, s; and the fastest descent for that, m/s.
# Chosen by trial in wind: touching slower, a vehicle leaning against 8 m/s slid half a metre.
EDGE_TO_EDGE_S = 0.1
MAX_DESCENT_MPS = 0.6
MAX_TILT = 1.0  # rad: of more only this counts; no multicopter flies so

# ---- standing level without thrust -------------------------------------------------------------
# After contact, s: at the earliest; once it has stood still for so long; at the latest. Chosen by
# trial in wind: levelled earlier, on an edge and with thrust left, it was blown off the pad. What
# was taken for contact may have been the air cushion, 4 cm up: from the touch on it stands still.
LEVEL_AFTER_S = 0.6
LEVEL_STILL_S = 0.55
LEVEL_AT_LATEST_S = 2.5
# Or as soon as it has lain flat for STILL_S, where it slides, no faster than this, m/s, and may not
# fly on, or leaned by more than this before the touch, rad: while as much is asked for ArduCopter
# keeps half of the thrust of hover to steer with (measured), and what that carries slides in the
# wind that it leaned against, ever faster.
SLIDES_MPS, STEERS = 0.45, math.radians(15.0)
# What leaned and slides faster than this, m/s, is dragged off the plate within a second: levelled
# up to this speed, m/s, so soon after contact, once it has lain within so much of the plate, rad,
# for so long, s. By its attitude: it rocks on its gear, and its rates, which come late, fall below
# MAX_ROLL_PITCH_RATE 0.2 to 0.6 s after it lies there; waiting for that, one tipped over beside the
# plate and one was left with a foot off it.
DRAGGED_MPS = 0.3
MOST_DRAGGED_MPS, DRAGGED_AFTER_S = 0.8, 0.3
LIES_FLAT, DRAGGED_FLAT_S = math.radians(6.0), 0.1
# Pressed down, what stands sinks slower by so much of the gentle descent than it would in the air.
# What answers late hovers for a second over a deck that begins to sink, where neither height nor
# sinking against the deck tell it from what stands: 4 cm up it was within 0.03 m/s of the air's.
PRESSED_DOWN_SHARE = 0.3
# A vehicle answers so much later than ArduPilot's shaper, s. Measured with 0.2 s of that: one that
# hovered sinks at 0.6 of the order 0.4 s after it.
LATE_S = 0.2
# Or so soon, where it leans by so much more than in the air, rad, on a pad that is seen to take it
# along: an autopilot that holds its velocity against a pad that brakes tips over on it. Or where it
# is to stop and leaned: turned level by the pad, and with the thrust that it had against the wind,
# one was dragged off its pad, and tipped over.
LEVEL_TIPPING_S, TIPS = 0.3, math.radians(5.0)
# What counts as standing still, and for how long, s; chosen by trial with these.
STILL_S = 0.3
MAX_SLIP_MPS = 0.1  # across the pad: faster, thrust and wind still carry it;
# meanwhile it has sunk by no more than this, m: on an air cushion it sinks slower than 0.1 m/s;
SETTLES_M = 0.01
PAD_SPEED_ERROR_SHARE = 0.05  # of a fast pad's speed may be an error
MAX_ROLL_PITCH_RATE = 0.3  # rad/s: faster, not all feet are down yet, but one may be
# No deck that can be landed on sinks faster, m/s. What sinks faster without thrust falls.
FASTEST_HEAVE_MPS = 0.6

# Told to climb, what is on the pad may lift after so long, s, and what it was pressed down before,
# and what the autopilot takes from sinking to climbing as fast: of two that were told to climb as
# they touched, one of 2.2 m/s^2 lifted after 0.5 s, one of 0.9 m/s^2 after 1.5 s.
LIFTS_S = 0.15

# Levelled as its thrust was coming back, it lifts all the same, and falls beside the pad: where it
# has risen so far since, m, and rises so fast, m/s, it is to fly. Telemetry that is wrong in height
# alone does not say so, and a deck that was seen to heave may carry it up.
LIFTED_M, LIFTS_MPS = 0.08, 0.15

DISARM_EVERY_S = 0.5  # the command is repeated: one may be lost


@dataclass(frozen=True, slots=True)
class ContactMotion:
    """How vehicle and pad move in a control step from contact on."""

    feet_down: float  # local z, m
    pad_down: float  # as far down as it may be by now, local z, m
    sink_rate: float  # measured, m/s, downward; infinity: not known
    slip: float  # measured speed across the pad, m/s; infinity: not known
    lean: float  # of the airframe from the plate as last seen, rad; infinity: never seen
    roll_pitch_rate: float  # measured, rad/s; infinity: not known
    pad_speed: float  # horizontal, against which slip is measured, m/s
    heave: float  # of the pad, downward, as far as is known, m/s
    sigma_heave: float  # m/s

    @property
    def slip_error(self) -> float:
        """What of the slip may be an error of the pad's speed, m/s."""
        return PAD_SPEED_ERROR_SHARE * self.pad_speed


class Touchdown:
    """Watches for contact, for the land detector, and for the time that each may take.

    Attributes:
        stands: the vehicle stands still on the pad, as far as is known.
        turned_over: it has turned over there, however it lies now.
    """

    def __init__(self, config: Config) -> None:
        """Make one that has not begun."""
        self._reach_m = 0.5 * max(config.vehicle.footprint_m)  # of the furthest edge
        self.configure(config)
        self.begin(-math.inf)

    def configure(self, config: Config) -> None:
        """Take changed parameters."""
        self._timeout_s = config.guidance.touchdown_timeout_s
        self._descent_mps = config.guidance.touchdown_descent_mps
        autopilot = config.autopilot
        self._acceleration = autopilot.vertical_acceleration_mps2
        self._lag_s = autopilot.vertical_shaper_lag_s + LATE_S

    def begin(self, now: float) -> None:
        """Start with a landing and at commit, at time now."""
        self._began = now
        self._watch_from = now + ANSWER_S
        self._ordered: list[tuple[float, float]] = []  # in the last ANSWER_S: when, m/s
        self._slow_since = math.inf
        self._lies_since = math.inf  # on the plate, by its attitude
        self._flat_since = self._still_since = math.inf  # nor turns; and does not slide
        self._flat_at = (0.0, 0.0)  # local z of feet and pad then, m
        self._contact_t: float | None = None
        self._in_air: tuple[float, float] | None = None  # when, how fast it would sink then, m/s
        self._flew_t = -math.inf  # last seen to sink as it would in the air, s
        self._level = self.stands = False
        self._level_down: float | None = None  # local z of the feet when it was levelled, m
        self._tilt = 0.0  # largest since commit, rad
        self.turned_over = False
        self._disarm_t = -math.inf

    def descent(self, tilt: float) -> float:
        """Return the downward speed to order against the pad's, m/s; called from commit on.

        A vehicle that leans against wind touches with one edge first. From then on it stands too
        upright to hold against the wind and too lightly not to slide, until all feet are down and
        the thrust is gone: the more it leans, the quicker that must be. So it stays when the pad
        has levelled it.

        Args:
            tilt: of the airframe from level, rad.
        """
        self._tilt = max(self._tilt, tilt)
        quick = self._reach_m * math.tan(min(self._tilt, MAX_TILT)) / EDGE_TO_EDGE_S
        return max(self._descent_mps, min(quick, MAX_DESCENT_MPS))

    def step(
        self,
        now: float,
        sighting_age: float,
        clearance: float,
        landed: Landed,
        highest_m: float = MAX_CONTACT_HEIGHT_M,
    ) -> Event | None:
        """Return CONTACT or SIGHT_LOST when that has come, None to descend; called until contact.

        Args:
            now: s.
            sighting_age: s since the exposure of the last accepted sighting.
            clearance: the least that the lowest foot may be over the pad as last known, m.
            landed: what the autopilot's land detector says.
            highest_m: with no more clearance a slow sinking is believed to be contact; one that
                lasts, up to WRONG_BUILD_M.
        """
        # What sinks as ordered is in the air, whatever is said of it.
        says_so = landed is Landed.ON_GROUND and self.may_touch
        is_slow = now - self._slow_since >= CONTACT_S and clearance <= highest_m
        held_up_s = SAID_HELD_UP_S if says_so else HELD_UP_S
        is_held_up = now - self._slow_since >= held_up_s and clearance <= WRONG_BUILD_M
        if is_slow or is_held_up or (says_so and clearance <= MAX_CONTACT_HEIGHT_M):
            self._contact_t = now
            return Event.CONTACT
        # A contact that begins only now would be noticed too late.
        begins_late = sighting_age > MAX_BLIND_S - CONTACT_S and not self.may_touch
        lost = begins_late or sighting_age > MAX_BLIND_S
        return Event.SIGHT_LOST if lost else None

    def watch(
        self, t: float, sinking: tuple[float, float], heave: float = 0.0, unsure: float = 0.0
    ) -> None:
        """Take a measurement; called from commit to contact for each, and before `step`.

        Args:
            t: of the measurement, s.
            sinking: downward, measured and of the last set-point, m/s.
            heave: of the pad, downward, m/s.
            unsure: it may sink by so much more and touch, m/s; 0 where no foot can be down.
        """
        sink_rate, ordered = sinking
        in_air = self._fly_on(t, sink_rate, ordered) - heave
        self._ordered = [(at, o) for at, o in self._ordered if at > t - ANSWER_S]
        self._ordered.append((t, ordered - heave))
        answered = min(o for _, o in self._ordered)
        share = min(CONTACT_SINK_SHARE * answered + unsure, MAX_CONTACT_SINK_SHARE * answered)
        if t < self._watch_from:
            answers = in_air > ANSWERED_SHARE * self._descent_mps
            share = CONTACT_SINK_SHARE * in_air if answers else -math.inf
        self._note_slow(t, is_slow=sink_rate - heave < share)

    def _note_slow(self, t: float, *, is_slow: bool) -> None:
        self._slow_since = min(self._slow_since, t) if is_slow else math.inf

    def _fly_on(self, t: float, sink_rate: float, ordered: float) -> float:
        """Return how fast it would sink in the air at t by what was ordered since commit, m/s."""
        at, sinks = self._in_air or (t, sink_rate)
        most = self._acceleration * (t - at)
        sinks += clamp(min(1.0, (t - at) / self._lag_s) * (ordered - sinks), -most, most)
        self._in_air = t, sinks
        return sinks

    @property
    def has_touched(self) -> bool:
        """Whether contact has been noticed."""
        return self._contact_t is not None

    def touch(self, t: float) -> None:
        """Take it that the vehicle has touched at t (s), unless contact was noticed before."""
        if self._contact_t is None:
            self._contact_t = t

    def press(self, t: float) -> None:
        """Take it that the vehicle touches at t (s): it is pressed down before it is levelled."""
        self._contact_t = t
        self._lies_since = self._flat_since = self._still_since = math.inf
        self._level = self.stands = False
        self._level_down = None

    def lifts(self, feet_down: float, climb_mps: float) -> bool:
        """Tell whether what is level on a pad that does not heave rises from it.

        Args:
            feet_down: local z of the feet, m; called at every control step while it is level.
            climb_mps: measured.
        """
        if self._level_down is None:
            self._level_down = feet_down
        lifted = self._level_down - feet_down > LIFTED_M and climb_mps > LIFTS_MPS
        return lifted and not self.turned_over

    def settle(self, t: float) -> None:
        """Take it that the vehicle has stood on the pad since t (s), and is to stand level."""
        self.touch(t)
        self._level = self.stands = True

    def turn_over(self, t: float) -> None:
        """Take it that the vehicle turns over on the ground at t (s): no thrust does any good."""
        self.settle(t)
        self.turned_over = True

    @property
    def is_level(self) -> bool:
        """Whether the vehicle was to stand level without thrust when that was looked at last."""
        return self._level

    def has_settled(self, now: float) -> bool:
        """Tell whether it was pressed down for so long that it stands, for all that is known."""
        return self._contact_t is not None and now - self._contact_t > LEVEL_AT_LATEST_S

    @property
    def may_touch(self) -> bool:
        """Whether the sinking is so slow that the feet may touch; called until contact."""
        return self._slow_since < math.inf

    def thrust_back_s(self, now: float, ordered: float) -> float:
        """Return how long after it is told to climb the vehicle on the pad stays there, s.

        Args:
            now: when it is told, s.
            ordered: what it was to sink at before, m/s.
        """
        pressed_s = max(0.0, now - self._slow_since)
        turns_s = 2.0 * max(0.0, ordered) / self._acceleration
        return LIFTS_S + turns_s + pressed_s

    def disarm_due(self, now: float, landed: Landed) -> bool:
        """Tell whether the disarm command is to be sent now."""
        if not self._confirmed(now, landed) or now - self._disarm_t < DISARM_EVERY_S:
            return False
        self._disarm_t = now
        return True

    def _confirmed(self, now: float, landed: Landed) -> bool:
        touched = self._contact_t is not None and now - self._contact_t >= CONFIRMED_S
        return touched and landed is Landed.ON_GROUND

    def leans_more(self, tilt: float) -> bool:
        """Tell whether it leans (rad) by more than it needs to in the air here."""
        return tilt > self._tilt + TIPS

    @property
    def leaned(self) -> bool:
        """Whether it leaned before the touch: what carries it then drags it across the pad."""
        return self._tilt > STEERS

    def level_due(
        self,
        now: float,
        motion: ContactMotion,
        ordered: float,
        landed: Landed,
        *,
        tips: bool = False,
        released: bool = False,
    ) -> bool:
        """Tell whether to stand level without thrust rather than to go with the pad.

        ArduCopter's land detector does not trust in a landing while more than 15 degrees of tilt
        are asked for, as a velocity kept in wind does. It waits until the vehicle stands still, or
        slides lying flat: levelled on one edge, with thrust left, it would be blown away. Once
        level it stays so, but never while it sinks: what sinks is in the air, whatever was taken
        for contact, and needs its thrust.

        Args:
            now: s; called at every control step from contact on.
            motion: of vehicle and pad.
            ordered: what it is to sink at by the last set-point, m/s.
            landed: what the autopilot's land detector says.
            tips: thrust tips it over, or drags it off.
            released: landerd may not fly on, and what stands is pressed down no longer.
        """
        if self.turned_over:
            return True
        sink_rate = motion.sink_rate
        # A deck that may be sinking as fast carries it down; on one that rises it does not sink.
        by_deck = clamp(motion.heave + 2.0 * motion.sigma_heave, 0.0, FASTEST_HEAVE_MPS)
        self._note_slow(now, is_slow=sink_rate - by_deck < CONTACT_SINK_SHARE * self._descent_mps)
        held_up_by = self._fly_on(now, sink_rate, ordered) - sink_rate
        # Told to climb, what has touched is held down, if by anything.
        told_up = ordered <= 0.0
        is_pressed = released or told_up or held_up_by > PRESSED_DOWN_SHARE * self._descent_mps
        if not is_pressed:
            self._flew_t = now  # for all that is known
        self._note_still(now, motion, is_pressed=is_pressed)
        since = max(self._contact_t, self._flew_t) if self._contact_t is not None else math.inf
        waited = now - since
        still_s = now - self._still_since
        tips_over = tips and waited > LEVEL_TIPPING_S
        slides = motion.slip < SLIDES_MPS + motion.slip_error and (self.leaned or released)
        slides = slides and waited > LEVEL_AFTER_S and now - self._flat_since >= STILL_S
        slides = slides or (self._is_dragged(now, motion) and waited > DRAGGED_AFTER_S)
        confirmed = self._confirmed(now, landed)
        stands = (waited > LEVEL_AFTER_S and still_s >= STILL_S) or tips_over
        stands = stands or (released and confirmed)  # and not stopped there, nor pressed down
        stays = stands and (released or still_s >= LEVEL_STILL_S)
        late = waited > LEVEL_AT_LATEST_S or tips_over or slides or stays
        may_level = released or (is_pressed and landed is not Landed.ON_GROUND)
        due = self._level or (late and may_level)
        self._level = due and now - self._slow_since >= CONTACT_S
        if not self._level:
            self._level_down = None
        self.stands = stands or self._level or confirmed
        return self._level

    def _is_dragged(self, now: float, motion: ContactMotion) -> bool:
        """Tell whether what it leaned against drags it across the plate on which it lies."""
        across = motion.slip - motion.slip_error
        lies = now - self._lies_since >= DRAGGED_FLAT_S
        return self.leaned and lies and DRAGGED_MPS < across < MOST_DRAGGED_MPS

    def _note_still(self, now: float, motion: ContactMotion, *, is_pressed: bool) -> None:
        """Note since when it lies on the plate, turns no longer, and does not slide either."""
        down = motion.feet_down, motion.pad_down
        lies = motion.lean < LIES_FLAT and is_pressed
        self._lies_since = min(self._lies_since, now) if lies else math.inf
        if not (motion.roll_pitch_rate < MAX_ROLL_PITCH_RATE and is_pressed):
            self._flat_since = math.inf
        elif self._flat_since == math.inf or self._has_settled_by(down) > SETTLES_M:
            self._flat_since, self._flat_at = now, down
        if motion.slip < MAX_SLIP_MPS + motion.slip_error:
            self._still_since = max(self._flat_since, min(self._still_since, now))
        else:
            self._still_since = math.inf

    def _has_settled_by(self, down: tuple[float, float]) -> float:
        """Return how far it has sunk since it lies flat, and not with the pad, m."""
        feet, pad = (now - then for now, then in zip(down, self._flat_at, strict=True))
        return feet - max(0.0, pad)

    def without_data(self, now: float, landed: Landed, *, released: bool = False) -> bool:
        """Tell whether to stand level while nothing is known of how the vehicle moves.

        What stood stands still; pressed down no longer, it would be given thrust for want of data.

        Args:
            now: s; called at every control step from contact on without data.
            landed: what the autopilot's land detector says.
            released: landerd may not fly on.
        """
        self.stands = self.stands or self._confirmed(now, landed)
        if released and (self.stands or self.has_settled(now)):
            self.settle(now)
        return self._level

    def unconfirmed(self, now: float, landed: Landed) -> bool:
        """Tell whether the land detector has been silent for too long, after contact or commit.

        Velocities that are wrong may show no contact: commit is a second before it.
        """
        since = self._began if self._contact_t is None else self._contact_t
        return now - since > self._timeout_s and landed is not Landed.ON_GROUND
