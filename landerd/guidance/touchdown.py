"""The touch-down, from commit until the motors are disarmed (design rule 4).

Tells how fast to descend, what counts as contact, when to stand level without thrust, and when to
disarm. "Measured" is said of ArduCopter 4.5.7 in SITL, whose step responses
bench/step_response.py prints. "Chosen by trial in wind" refers to the campaign `guidance`, rows
wind-8 and wind-12.
"""

import math
from dataclasses import dataclass, replace

from landerd.config.models import Config
from landerd.geometry import clamp
from landerd.guidance.states import Event
from landerd.messages import Landed

# ---- contact -----------------------------------------------------------------------------------
# Contact is a sink rate below this share of the ordered one. Measured: from 0.4 s after the order
# on the share is larger in the air and smaller on the ground, where the vehicle rebounds 0.2 s
# later.
CONTACT_SINK_SHARE = 0.4
# Where a foot may be down by its height, the limit grows by the uncertainty of the pad's heave, but
# no further than to this share of the order: in the air the vehicle sinks faster.
MAX_CONTACT_SINK_SHARE = 0.7
CONTACT_S = 0.2  # how long the sink rate must be that low: shorter slow moments are gusts
# Time after commit from which on that is looked for, and time that an order must have stood to
# count, s. Measured: a vehicle that hovered sinks at 0.6 of the order by then. Without the wait
# contact was called 0.25 s after commit, 11 cm up; and 9 cm up with a slow vehicle that was to sink
# faster because it leaned.
ANSWER_S = 0.4
# Earlier than that the limit is taken of the sink rate that the vehicle would have in the air by
# now, once that exceeds this share of the gentle descent. A deck that came up met the feet 0.06 s
# after commit; not noticing that, the vehicle climbed away.
ANSWERED_SHARE = 0.5
# Delay of the vehicle's answer beyond that of ArduPilot's shaper, s. Measured with a shaper's delay
# of 0.2 s: a vehicle that hovered sinks at 0.6 of the order 0.4 s after it.
LATE_S = 0.2
# How wrong the sink rate that the vehicle would have in the air may be at contact, m/s. Measured in
# 200 days of the field world, predicted 0.6 s ahead in the descent: 0.076 to 0.078 rms, of which
# this is 2 sigma. A vehicle that answered late, cushioned by its own wash, rose with a deck for
# half a second longer than predicted: taken for held up, it was levelled 4 cm over it.
IN_AIR_ERROR_MPS = 0.15
# Longest time from the last sighting until contact is noticed, s; the rule allows 1.0.
MAX_BLIND_S = 0.97
# Greatest height of the lowest foot over the pad at which contact is believed, m (design rule 4):
# a gust, or the air cushion over the plate, slows the descent too.
MAX_CONTACT_HEIGHT_M = 0.10
# Up to this height, m, contact is believed after HELD_UP_S of low sink rate, s, or SAID_HELD_UP_S
# if the land detector says ON_GROUND: something holds the vehicle up, and gear or camera were
# measured wrong. With gear 10 cm longer than configured, vehicles stood under thrust, climbed off
# again or tipped over, and the pilot was not told why.
WRONG_BUILD_M = 0.20
HELD_UP_S, SAID_HELD_UP_S = 1.2, 0.6
# Time after contact from which on ON_GROUND is believed, s. ArduCopter's land detector takes at
# least 1 s: an earlier report is wrong, and a vehicle disarmed by it would fall.
CONFIRMED_S = 0.5

# ---- the descent onto the pad ------------------------------------------------------------------
# Time from the touch of the first foot to that of the last one, in wind, s; and the fastest descent
# ordered to keep it, m/s. Chosen by trial in wind: with a slower touch a vehicle that leaned
# against 8 m/s slid half a metre.
EDGE_TO_EDGE_S = 0.1
MAX_DESCENT_MPS = 0.6
MAX_TILT = 1.0  # rad, the largest tilt that is counted: no multicopter flies with more

# ---- standing level without thrust -------------------------------------------------------------
# Time after contact at which the vehicle is levelled, s: at the earliest, and at the latest; and
# how long it must have stood still before the latest. Chosen by trial in wind: levelled earlier, on
# one edge and with thrust left, vehicles were blown off the pad. What was taken for contact may
# have been the air cushion, 4 cm up: a vehicle stands still from the real touch on only.
LEVEL_AFTER_S = 0.6
LEVEL_STILL_S = 0.55
LEVEL_AT_LATEST_S = 2.5
# The same while nothing is known of how it moves: pressed down for longer, with the velocity that
# it had as that was last known, one tipped over on a pad that turned, and one slid 0.7 m in wind.
LEVEL_UNKNOWN_S = 1.0

# What counts as standing still; chosen by trial in wind together with the times above.
STILL_S = 0.3  # how long
MAX_SLIP_MPS = 0.1  # speed across the pad: a faster vehicle is still carried by thrust and wind
PAD_SPEED_ERROR_SHARE = 0.05  # share of a fast pad's speed that may be an error of it
MAX_ROLL_PITCH_RATE = 0.3  # rad/s: in a faster turn one foot may be down, but not all
# Sinking since it lies flat, m: on an air cushion a vehicle sinks slower than 0.1 m/s, but sinks.
# One that slides across a tilted plate may sink by its slope besides.
SETTLES_M = 0.01
# Longest that it is then taken to settle on, s: slower than 0.04 m/s no air cushion lets it down.
# Without this, vehicles were levelled 0.45 s after the real touch.
MOST_SETTLING_S = 0.25
# A levelled vehicle that sinks gets its thrust back unless it comes down from a rebound: slower
# than the first, m/s, and with its feet no lower than the second, m, under where something held it
# up. One that leaned against 8 m/s rebounded by 1 cm as it fell onto all feet: levelled there, and
# given thrust again as it came down at 0.3 m/s, it leaned into the wind with its feet on the plate,
# and tipped over.
REBOUND_MPS, REBOUND_M = 0.5, 0.015

# What counts as pressed down: sinking slower than it would in the air, by this share of the gentle
# descent. A vehicle that answers late hovers for a second over a deck that begins to sink: neither
# its height nor its sink rate relative to the deck distinguish it from one that stands, but 4 cm up
# it sank as fast as in the air to within 0.03 m/s.
PRESSED_DOWN_SHARE = 0.3

# Time over which the autopilot's heights are differenced, s. Its velocity counts as wrong by as
# much as it said on average that it sinks faster: with 0.35 m/s too much a vehicle was not levelled
# for 12 s, and the wind that it leaned against dragged it 0.9 m.
HEIGHTS_S = 0.5

# A vehicle that has lain flat for STILL_S but slides, no faster than this, m/s, is levelled if it
# leaned by more than this before the touch, rad, or if landerd may not fly on. Measured: while more
# lean is asked for, ArduCopter keeps half of the thrust of hover to steer with, and a vehicle so
# lightened slides ever faster in the wind that it leaned against.
SLIDES_MPS, STEERS = 0.45, math.radians(15.0)
# A vehicle that leaned and slides faster than this, m/s, would be dragged off the plate within a
# second. Up to the second speed, m/s, it is levelled this long after contact, s, once it has lain
# within this angle of the plate, rad, for this long, s. Its attitude decides, not its turn rates:
# these arrive late, and as it rocks on its gear they fall below MAX_ROLL_PITCH_RATE only 0.2 to
# 0.6 s after it lies there. Waiting for that, one vehicle tipped over beside the plate and one came
# to rest with a foot off it.
DRAGGED_MPS = 0.3
MOST_DRAGGED_MPS, DRAGGED_AFTER_S = 0.8, 0.3
LIES_FLAT, DRAGGED_FLAT_S = math.radians(6.0), 0.1
# A vehicle that its thrust tips over is levelled this long after contact, s. Either it leans by
# this much more than in the air, rad, on a pad that is seen to carry it: an autopilot that keeps
# its velocity against a braking pad tips over on it. Or it leaned, and is to stop: one that the pad
# turned level, with the thrust that it had against the wind, was dragged off and tipped over. Or an
# edge is down that does not slide: one that had stood on a moving pad while nothing could be sent
# leaned back to where its autopilot wanted it, over its rear feet, and tipped over in 2 s.
LEVEL_TIPPING_S, TIPS = 0.3, math.radians(5.0)
# Fastest sinking of a deck that can be landed on, m/s: a faster vehicle without thrust falls.
FASTEST_HEAVE_MPS = 0.6

# ---- thrust that comes back --------------------------------------------------------------------
# Told to climb, a vehicle on the pad may lift after this time, s, plus the time for which it was
# pressed down, plus the autopilot's time to turn from sinking to climbing as fast. Of two vehicles
# that were told to climb as they touched, one of 2.2 m/s^2 lifted after 0.5 s, one of 0.9 m/s^2
# after 1.5 s.
LIFTS_S = 0.15
# A vehicle levelled just as its thrust came back lifts all the same, and would fall beside the pad.
# One that has risen by this since it touched, m, and rises by this, m/s, faster than its deck ever
# did and does now flies on: one of 1.5 m/s^3 that waved off as it touched rose so gently to 0.2 m
# that it seemed to stand still, and was levelled there. Telemetry whose height alone is wrong does
# not show both.
LIFTED_M, LIFTS_MPS = 0.08, 0.15
# Levelled for longer than this, s, it has no thrust that could lift it: its pad is lifted. Given
# thrust again on one that went up for 1.9 s it was not disarmed in time after ON_GROUND.
THRUST_GONE_S = 0.6

# Nor is it in the air if, levelled for longer than the first, s, it sinks no faster than the other,
# m/s: there it would fall. Given thrust again on a deck that, out of sight, began to sink at 0.1
# m/s, a vehicle was told to climb away from it.
FALLS_AFTER_S, FALLS_MPS = 1.0, 0.3

DISARM_EVERY_S = 0.5  # until the vehicle is disarmed: one command may be lost
# Time from the first disarm command after which the autopilot counts as refusing it, s: it answers
# within milliseconds, and its heartbeat says so 0.25 s later, which may be lost.
REFUSES_S = 1.0


@dataclass(frozen=True, slots=True)
class ContactMotion:
    """How vehicle and pad move in a control step from contact on."""

    feet_down: float  # local z of the feet's centre, m
    foot_down: float  # local z of the lowest foot, m
    pad_down: float  # local z of the pad, m: the lowest that it may have by now
    sink_rate: float  # measured, m/s, downward positive; infinity: unknown
    slip: float  # horizontal speed relative to the pad, measured, m/s; infinity: unknown
    lean: float  # angle of the airframe to the plate as last seen, rad; infinity: never seen
    tilt: float  # of the airframe from level, rad
    roll_pitch_rate: float  # measured, rad/s; infinity: unknown
    pad_speed: float  # the pad's horizontal speed, relative to which slip is measured, m/s
    heave: float  # the pad's vertical velocity as last known, downward positive, m/s
    sigma_heave: float  # m/s
    fastest_heave: float  # the pad's largest vertical speed that was certain, m/s

    @property
    def slip_error(self) -> float:
        """How much of the slip may be an error of the pad's speed, m/s."""
        return PAD_SPEED_ERROR_SHARE * self.pad_speed


class Touchdown:
    """Decides on contact, levelling and disarming, by measured motion and the land detector.

    Attributes:
        stands: the vehicle stands still on the pad, as far as is known.
        has_rested: it has not slid at some moment since it stands: one that is levelled as it
            slides stands only then.
        turned_over: it has turned over on the ground, whatever its attitude is now.
    """

    def __init__(self, config: Config) -> None:
        """Make a touch-down that has not begun."""
        self._reach_m = 0.5 * max(config.vehicle.footprint_m)  # from the middle to an edge, at most
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
        """Start afresh, with a landing and again at commit, at time now (s)."""
        self._watch_from = now + ANSWER_S
        # Orders of the last ANSWER_S: time, s, and sink rate relative to the pad, m/s.
        self._ordered: list[tuple[float, float]] = []
        self._slow_since = math.inf  # since when it has sunk too slowly to be in the air, s
        self._lies_since = math.inf  # since when it has lain on the plate, by its attitude, s
        self._flat_since = math.inf  # since when it has not turned or settled either, s
        self._flat_at = (0.0, 0.0)  # local z of feet and pad at that time, m
        self._settled_s = 0.0  # how long it took to settle by SETTLES_M before that, s
        self._still_since = math.inf  # since when it has not slid either, s
        # Lowest place of the feet, over the pad's local z, where something held it up, m.
        self._held_down = -math.inf
        self._contact_t: float | None = None  # of the last touch
        # Since when the land detector is awaited, s: the first touch, or commit.
        self._awaited_since = now
        self._down_t = -math.inf  # from when on a foot is down, s
        # Lately: time, s, the feet's local z, m, and measured sink rate, m/s.
        self._sunk: list[tuple[float, float, float]] = []
        self._known_t = -math.inf  # when its motion was last known after contact, s
        # Time, s, and sink rate that the vehicle would have in the air at that time, m/s.
        self._in_air: tuple[float, float] | None = None
        self._measured_mps = math.inf  # sink rate last measured before contact
        self._flew_t = -math.inf  # when it was last seen to sink as it would in the air, s
        self._flies_since = math.inf  # since when it has been seen so without a break, s
        self._level = self.stands = self.has_rested = False
        self._level_since = math.inf  # since when it has been level without a break, s
        self._lowest_down = -math.inf  # lowest local z of a foot since contact, m
        self._tilt = 0.0  # largest since commit, rad
        self.turned_over = False
        self._disarm_t = -math.inf
        self._asked_t = math.inf  # first disarm command, s

    def descent(self, tilt: float) -> float:
        """Return the sink rate to order, relative to the pad, m/s; called from commit on.

        A vehicle that leans against wind touches with one edge first. From then on, until all feet
        are down and the thrust is gone, it stands too upright to hold against the wind, and too
        lightly not to slide: the more it leans, the quicker the descent must be. The largest tilt
        since commit counts, as the pad levels the vehicle.

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
            sighting_age: time since the exposure of the last accepted sighting, s.
            clearance: lower bound of the lowest foot's height over the pad as last known, m.
            landed: what the autopilot's land detector says.
            highest_m: greatest clearance at which a low sink rate counts as contact after
                CONTACT_S; up to WRONG_BUILD_M it counts if it lasts longer.
        """
        # A vehicle that sinks as ordered is in the air, whatever the land detector says.
        says_so = landed is Landed.ON_GROUND and self.may_touch
        is_slow = now - self._slow_since >= CONTACT_S and clearance <= highest_m
        held_up_s = SAID_HELD_UP_S if says_so else HELD_UP_S
        is_held_up = now - self._slow_since >= held_up_s and clearance <= WRONG_BUILD_M
        if is_slow or is_held_up or (says_so and clearance <= MAX_CONTACT_HEIGHT_M):
            self.touch(now)
            return Event.CONTACT
        # A contact that began only now would be noticed later than MAX_BLIND_S.
        begins_late = sighting_age > MAX_BLIND_S - CONTACT_S and not self.may_touch
        lost = begins_late or sighting_age > MAX_BLIND_S
        return Event.SIGHT_LOST if lost else None

    def watch(
        self, t: float, sinking: tuple[float, float], heave: float = 0.0, unsure: float = 0.0
    ) -> None:
        """Take a measured velocity; called for each from commit to contact, before `step`.

        Args:
            t: time of the measurement, s.
            sinking: sink rate measured and sink rate of the last set-point, m/s.
            heave: the pad's vertical velocity, downward positive, m/s.
            unsure: uncertainty of heave, m/s: a vehicle that has touched may seem to sink by so
                much more; 0 where no foot can be down.
        """
        sink_rate, ordered = sinking
        self._measured_mps = sink_rate
        in_air = self._sink_rate_in_air(t, sink_rate, ordered) - heave
        self._ordered = [(at, o) for at, o in self._ordered if at > t - ANSWER_S]
        self._ordered.append((t, ordered - heave))
        answered = min(o for _, o in self._ordered)
        slow_mps = min(CONTACT_SINK_SHARE * answered + unsure, MAX_CONTACT_SINK_SHARE * answered)
        if t < self._watch_from:
            answers = in_air > ANSWERED_SHARE * self._descent_mps
            slow_mps = CONTACT_SINK_SHARE * in_air if answers else -math.inf
        self._note_slow(t, is_slow=sink_rate - heave < slow_mps)

    def _note_slow(self, t: float, *, is_slow: bool) -> None:
        self._slow_since = min(self._slow_since, t) if is_slow else math.inf

    def _sink_rate_in_air(self, t: float, sink_rate: float, ordered: float) -> float:
        """Return the sink rate that the vehicle would have in the air at time t (s), m/s.

        It begins with the measured sink_rate at commit, and follows what was ordered (m/s) since
        with the autopilot's delay and acceleration. Called in order of time.
        """
        at, in_air = self._in_air or (t, sink_rate)
        most = self._acceleration * (t - at)
        in_air += clamp(min(1.0, (t - at) / self._lag_s) * (ordered - in_air), -most, most)
        self._in_air = t, in_air
        return in_air

    @property
    def has_touched(self) -> bool:
        """Whether contact has been noticed."""
        return self._contact_t is not None

    def touch(self, t: float, comes_s: float = 0.0) -> None:
        """Note contact at t (s), unless it was noted before.

        It may have been none: the vehicle is then known to have sunk in the air as slowly as
        measured, as far as the prediction may have been wrong.

        Args:
            t: s.
            comes_s: time until a foot is down, s.
        """
        if self._contact_t is not None:
            return
        self._contact_t, self._down_t = t, t + comes_s
        self._awaited_since = t
        if self._in_air is not None:
            at, in_air = self._in_air
            self._in_air = at, clamp(self._measured_mps, in_air - IN_AIR_ERROR_MPS, in_air)

    def is_down(self, now: float) -> bool:
        """Tell whether a foot is down after contact was noted, or only will be."""
        return now >= self._down_t

    def press(self, t: float) -> None:
        """Note contact at t (s) anew: the vehicle is pressed down before it is levelled again."""
        self._contact_t = t
        self._lies_since = self._flat_since = self._still_since = math.inf
        self._held_down, self._asked_t = -math.inf, math.inf
        self._level = self.stands = self.has_rested = False
        self._lowest_down = -math.inf

    def settle(self, t: float) -> None:
        """Note that the vehicle has stood on the pad since t (s), and is to stand level."""
        self.touch(t)
        self._level = self.stands = True

    def turn_over(self, t: float) -> None:
        """Note that the vehicle turns over on the ground at t (s): thrust only does harm now."""
        self.settle(t)
        self.turned_over = True

    @property
    def is_level(self) -> bool:
        """Whether the vehicle was to stand level without thrust when that was last decided."""
        return self._level

    def pressed_s(self, now: float) -> float:
        """Return how long it has been held up, without a break, s; -inf before contact."""
        if self._contact_t is None:
            return -math.inf
        return now - max(self._contact_t, self._flew_t)

    def flies_s(self, now: float) -> float:
        """Return for how long it has sunk as in the air since contact, without a break, s."""
        return now - self._flies_since

    def levels_in_s(self, now: float) -> float:
        """Return how long it is to lie on the pad yet before it may be levelled, s."""
        return max(0.0, LEVEL_AFTER_S - self.pressed_s(now))

    @property
    def may_touch(self) -> bool:
        """Whether the sink rate is so low that a foot may be down; for use until contact."""
        return self._slow_since < math.inf

    def thrust_back_s(self, now: float, ordered: float) -> float:
        """Return how long a vehicle on the pad stays there once it is told to climb, s.

        Args:
            now: time at which it is told to climb, s.
            ordered: sink rate of the set-point before, m/s.
        """
        pressed_s = max(0.0, now - self._slow_since)
        turns_s = 2.0 * max(0.0, ordered) / self._acceleration
        return LIFTS_S + turns_s + pressed_s

    def disarm_due(self, now: float, landed: Landed) -> bool:
        """Tell whether the disarm command is to be sent now."""
        if not self._confirmed(now, landed):
            self._asked_t = math.inf  # it need not disarm in the air
            return False
        if now - self._disarm_t < DISARM_EVERY_S:
            return False
        self._disarm_t, self._asked_t = now, min(self._asked_t, now)
        return True

    def is_refused(self, now: float) -> bool:
        """Tell whether the autopilot says that it is on the ground, and does not disarm."""
        return now - self._asked_t > REFUSES_S

    def _confirmed(self, now: float, landed: Landed) -> bool:
        touched = self._contact_t is not None and now - self._contact_t >= CONFIRMED_S
        return touched and landed is Landed.ON_GROUND

    def leans_more(self, tilt: float) -> bool:
        """Tell whether a tilt (rad) exceeds the largest since commit by TIPS."""
        return tilt > self._tilt + TIPS

    @property
    def leaned(self) -> bool:
        """Whether it leaned before the touch: the wind that it leaned against drags it now."""
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

        ArduCopter's land detector does not accept a landing while more than 15 degrees of tilt are
        asked for, as they are to keep a velocity in wind. Levelled on one edge and with thrust left
        the vehicle would be blown away: it is first to stand still, or to slide lying flat. Once
        level it stays so, unless it sinks otherwise than from a rebound: then it is in the air,
        whatever was taken for contact, and needs its thrust.

        Args:
            now: s; called at every control step from contact on.
            motion: of vehicle and pad.
            ordered: sink rate of the last set-point, m/s.
            landed: what the autopilot's land detector says.
            tips: thrust tips the vehicle over, or drags it off.
            released: landerd may not fly on, and a vehicle that stands is no longer pressed down.
        """
        self._known_t = now
        if self.turned_over:
            return True
        if self._lifts(now, motion) and (self._level or not tips):
            self.press(now)
        is_pressed = self._is_pressed(now, motion, ordered) or released
        if is_pressed:
            self._flies_since = math.inf
        else:  # as far as is known
            self._flies_since, self._flew_t = min(self._flies_since, now), now
        self._note_still(now, motion, is_pressed=is_pressed)
        confirmed = self._confirmed(now, landed)
        tips = tips or self._tips_where_it_stands(motion)
        tips_over = tips and self.pressed_s(now) > LEVEL_TIPPING_S
        # A released vehicle that is said to be on the ground is neither stopped nor pressed down.
        stands = self._stands_still(now) or tips_over or (released and confirmed)
        is_time = (
            tips_over
            or (stands and (released or self._has_stood_still(now)))
            or self._slides_flat(now, motion, released=released)
            or self._is_dragged(now, motion)
            or self.pressed_s(now) > LEVEL_AT_LATEST_S
        )
        # Once it is said to be on the ground it is disarmed; if not, wind may drag it off.
        ends = landed is Landed.ON_GROUND and not self.is_refused(now)
        may_begin = released or (is_pressed and not ends)
        sinks = self._sinks(now)
        begins = is_time and may_begin and not sinks
        stays = not sinks or self._rebounds(motion) or self._is_carried(now, motion)
        self._level = begins or (self._level and stays)
        self._level_since = min(self._level_since, now) if self._level else math.inf
        self.stands = stands or self._level or confirmed
        rests = motion.slip < MAX_SLIP_MPS + motion.slip_error
        self.has_rested = self.stands and (self.has_rested or rests)
        return self._level

    def _lifts(self, now: float, motion: ContactMotion) -> bool:
        """Tell whether its thrust lifts it from its pad; called at each control step.

        Of one that tips about an edge the middle rises, but the foot on that edge does not.
        """
        self._lowest_down = max(self._lowest_down, motion.foot_down)
        risen_m = self._lowest_down - motion.foot_down
        deck_mps = max(motion.fastest_heave, -motion.heave)
        rises = risen_m > LIFTED_M and -motion.sink_rate > LIFTS_MPS + deck_mps
        return rises and now - self._level_since < THRUST_GONE_S

    def _is_pressed(self, now: float, motion: ContactMotion, ordered: float) -> bool:
        """Tell whether something holds the vehicle up; called once at each control step.

        Told to climb, a vehicle that has touched counts as pressed down: if anything keeps it from
        climbing, it is the pad.
        """
        motion = replace(motion, sink_rate=self._sink_rate(now, motion))
        self._note_sinking(now, motion)
        held_up_mps = self._sink_rate_in_air(now, motion.sink_rate, ordered) - motion.sink_rate
        told_up = ordered <= 0.0
        return told_up or held_up_mps > PRESSED_DOWN_SHARE * self._descent_mps

    def _sink_rate(self, now: float, motion: ContactMotion) -> float:
        """Return the measured sink rate less by what the autopilot's heights say is wrong, m/s."""
        if not math.isfinite(motion.sink_rate):
            return motion.sink_rate
        self._sunk = [each for each in self._sunk if each[0] > now - HEIGHTS_S]
        self._sunk.append((now, motion.feet_down, motion.sink_rate))
        (t, down, _), count = self._sunk[0], len(self._sunk)
        if now - t < 0.5 * HEIGHTS_S:
            return motion.sink_rate
        said = sum(rate for _, _, rate in self._sunk) / count
        return motion.sink_rate - max(0.0, said - (motion.feet_down - down) / (now - t))

    def _note_sinking(self, now: float, motion: ContactMotion) -> None:
        """Note whether it sinks faster than the deck may be sinking, if that sinks at all."""
        is_slow = _sink_over_deck(motion) < CONTACT_SINK_SHARE * self._descent_mps
        self._note_slow(now, is_slow=is_slow)
        if is_slow:
            self._held_down = max(self._held_down, motion.feet_down - motion.pad_down)

    def _sinks(self, now: float) -> bool:
        """Tell whether it has sunk faster than its deck within CONTACT_S."""
        return now - self._slow_since < CONTACT_S

    def _rebounds(self, motion: ContactMotion) -> bool:
        """Tell whether it comes down slowly, to no lower than where something held it up."""
        is_lower = motion.feet_down - motion.pad_down > self._held_down + REBOUND_M
        return _sink_over_deck(motion) < REBOUND_MPS and not is_lower

    def _is_carried(self, now: float, motion: ContactMotion) -> bool:
        """Tell whether a deck that sinks carries it, which in the air would fall without thrust."""
        return now - self._level_since > FALLS_AFTER_S and _sink_over_deck(motion) < FALLS_MPS

    def _stands_still(self, now: float) -> bool:
        """Tell whether it has neither turned, nor settled, nor slid for STILL_S."""
        return self.pressed_s(now) > LEVEL_AFTER_S and now - self._still_since >= STILL_S

    def _has_stood_still(self, now: float) -> bool:
        """Tell whether it has stood still for LEVEL_STILL_S since it certainly settled no more.

        It may have settled by almost as much again, and as slowly.
        """
        return now - self._still_since >= LEVEL_STILL_S + self._settled_s

    def _tips_where_it_stands(self, motion: ContactMotion) -> bool:
        """Tell whether it leans more than in the air, over an edge that does not slide."""
        leans = self.leans_more(motion.tilt) and motion.lean > LIES_FLAT
        return leans and motion.slip < DRAGGED_MPS + motion.slip_error

    def _slides_flat(self, now: float, motion: ContactMotion, *, released: bool) -> bool:
        """Tell whether it lies flat but slides, and will not stop while it has thrust."""
        will_slide = self.leaned or released
        lies_flat = self.pressed_s(now) > LEVEL_AFTER_S and now - self._flat_since >= STILL_S
        return will_slide and lies_flat and motion.slip < SLIDES_MPS + motion.slip_error

    def _is_dragged(self, now: float, motion: ContactMotion) -> bool:
        """Tell whether the wind that it leaned against drags it across the plate it lies on."""
        lies = now - self._lies_since >= DRAGGED_FLAT_S
        lies = lies and self.pressed_s(now) > DRAGGED_AFTER_S
        slides = DRAGGED_MPS < motion.slip < MOST_DRAGGED_MPS + motion.slip_error
        return self.leaned and lies and slides

    def _note_still(self, now: float, motion: ContactMotion, *, is_pressed: bool) -> None:
        """Note since when it has lain on the plate, has not turned or settled, and not slid."""
        lies = motion.lean < LIES_FLAT and is_pressed
        self._lies_since = min(self._lies_since, now) if lies else math.inf
        if not (motion.roll_pitch_rate < MAX_ROLL_PITCH_RATE and is_pressed):
            self._flat_since = math.inf
        elif self._flat_since == math.inf or self._settles(now, motion):
            self._settled_s = min(max(0.0, now - self._flat_since), MOST_SETTLING_S)
            self._flat_since, self._flat_at = now, (motion.feet_down, motion.pad_down)
        if motion.slip < MAX_SLIP_MPS + motion.slip_error:
            self._still_since = max(self._flat_since, min(self._still_since, now))
        else:
            self._still_since = math.inf

    def _settles(self, now: float, motion: ContactMotion) -> bool:
        """Tell whether it has sunk more than the pad, and than by sliding, since it lies flat.

        What lies flat leans as the plate does.
        """
        feet_down, pad_down = self._flat_at
        sunk_m = motion.feet_down - feet_down - max(0.0, motion.pad_down - pad_down)
        slip = motion.slip if motion.slip < math.inf else 0.0
        slid_m, slope = slip * (now - self._flat_since), math.tan(min(motion.tilt, MAX_TILT))
        return sunk_m > SETTLES_M + slid_m * slope

    def without_data(self, now: float, landed: Landed, *, released: bool = False) -> bool:
        """Tell whether to stand level while nothing is known of how the vehicle moves.

        A vehicle that stood counts as standing. One that has been pressed down for a second is on
        the pad, and levelled: with thrust left, wind drags it off. So is one that stands when
        landerd may not fly on: it is no longer pressed down then, and would be given thrust for
        want of data.

        Args:
            now: s; called at every control step from contact on without fresh data.
            landed: what the autopilot's land detector says.
            released: landerd may not fly on.
        """
        self.stands = self.stands or self._confirmed(now, landed)
        self._flies_since = math.inf
        since = math.inf if self._contact_t is None else max(self._contact_t, self._known_t)
        has_settled = now - since > LEVEL_UNKNOWN_S
        if has_settled or (released and self.stands):
            self.settle(now)
        return self._level

    def unconfirmed(self, now: float, landed: Landed) -> bool:
        """Tell whether land detector or disarming have been awaited for too long after contact.

        The time counts from the first touch: lifted and pressed down again and again, a vehicle
        may never be confirmed. Without contact it counts from commit, a second earlier: wrong
        velocities may hide it.
        """
        if now - self._awaited_since <= self._timeout_s:
            return False
        return not self.has_touched or landed is not Landed.ON_GROUND or self.is_refused(now)


def _sink_over_deck(motion: ContactMotion) -> float:
    """Return the sink rate less what the deck may be sinking by, if it sinks at all, m/s."""
    by_deck = clamp(motion.heave + 2.0 * motion.sigma_heave, 0.0, FASTEST_HEAVE_MPS)
    return motion.sink_rate - by_deck
