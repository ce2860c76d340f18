"""The safety rules in the order of docs/safety.md, each with its number there.

`ORDER_RULES` are applied to every order to fly, `TIME_RULES` at every step of the world and when
anything arrives at landerd. Each function tells whether its rule is broken. Elsewhere are what may
be sent at all (hw.sim.judge.allowed), the limits of set-points (rule 3: hw.sim.judge.limits), and
what a STATUSTEXT or a disarm order may break (hw.sim.judge.rules).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from hw.sim.judge.bounds import ZERO, RuleBounds
from hw.sim.judge.evidence import BOUNCE_S, STILL_S, Evidence, Order
from landerd.geometry import horizontal, wrap

CONTACT_LATE_S = 0.6  # from true contact until landerd must behave as on the pad
CONTACT_S = 0.3  # from true contact until it can be known
# Time after contact in which orders need not go with the pad yet, also with one that brakes or
# starts under the feet: it is seen late, and the limits (rule 3) change no order at once.
RIDES_S = 1.0
LEVEL_AFTER_S = 0.5  # least time of going with the pad before the vehicle may be levelled
HOVER_MPS = 0.02  # an order with a smaller horizontal velocity is one to hover
TOLD_S = 1.0  # within which, before or after an abort, the pilot must be told of it
MISS_S = 0.25  # within which it must be noticed that the pad will be missed
# Longest time from an order to climb until a vehicle pressed onto a deck lifts: its autopilot has
# taken the thrust away, and gives it back as gently. Flown: 1.1 and 1.5 s.
THRUST_BACK_S = 1.6
DISARMS_S = 1.0  # within which landerd must disarm after ON_GROUND
_PHASE_NEWS = ("approach:", "yaw correction:", "descent:", "landed:")
_LOSS_NEWS = ("not in sight", "stale", "no pictures")
_UNCONFIRMED = "not confirmed"


class OrderRule(NamedTuple):
    """One rule about orders to fly."""

    text: str
    is_broken: Callable[[Evidence, Order, RuleBounds], bool]


class TimeRule(NamedTuple):
    """One rule about what must come in time, at a time in s."""

    text: str
    is_broken: Callable[[Evidence, float, RuleBounds], bool]


# ---- 1: who flies ------------------------------------------------------------------------------


def _without_authority(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return not (e.armed and e.guided) and o.t - e.authority_lost_t > b.tick_s


def _flies_on(e: Evidence, o: Order, b: RuleBounds) -> bool:
    stops = o.zero or o.level or e.climbs_away(o)
    return o.t - e.closed_t > b.tick_s and not stops


def _never_silent(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return o.t - e.release_t > b.release_s + 2.0 * b.tick_s + 0.05


def _stops_on_moving_pad(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return o.zero and e.must_climb_away(o.t, o.truth)


def _knows_to_stand(e: Evidence, o: Order) -> bool:
    """Tell whether it stands: of stale data it cannot know, unless it did before."""
    return e.stands(o.t) and (e.levelled or o.t - e.stale_t > STILL_S)


def _gets_up(e: Evidence, o: Order, b: RuleBounds) -> bool:
    released = o.t - e.closed_t > b.tick_s and e.flown_t is not None
    return released and not o.level and _knows_to_stand(e, o)


def _latched(e: Evidence, o: Order, b: RuleBounds) -> bool:
    may_fly = e.armed and e.guided and o.t < e.closed_t
    # Orders that were on their way when authority was lost are judged by rule 1a.
    late = o.t - e.authority_lost_t > b.tick_s
    return e.latched and not o.zero and may_fly and late


def _never_seen(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return e.sighting_t == -math.inf


def _out_of_sight(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return o.t - e.sighting_t > e.sighting_limit_s(o.truth) + b.tick_s


def _blind_for_s(e: Evidence, o: Order) -> float:
    """Return how long landerd has flown without sight or fresh data, s; -1: it has both."""
    if o.zero or e.touched or e.blind_since is None:
        return -1.0
    return o.t - e.blind_since


def _turns_blind(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return _blind_for_s(e, o) > b.tick_s and abs(o.yaw_rate) > ZERO


def _sinks_blind(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return _blind_for_s(e, o) >= 0.0 and o.velocity[2] > ZERO


def _wanders_blind(e: Evidence, o: Order, b: RuleBounds) -> bool:
    # Full braking, and its end, which the jerk limit draws out.
    braking_s = b.speed_mps / b.braking_mps2 + 5.0 * b.braking_mps2 / b.jerk_mps3
    too_long = _blind_for_s(e, o) > braking_s + b.tick_s
    return too_long and horizontal(o.velocity) > HOVER_MPS


def _silent_at_once(e: Evidence, t: float, b: RuleBounds) -> bool:
    return t >= e.closed_t and _owes_order(e, t, b)


# ---- 2: never blind ----------------------------------------------------------------------------


def _sinks(e: Evidence, o: Order) -> bool:
    """Tell whether it is an order to descend before contact."""
    return o.sinks and not e.touched


def _no_sighting(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return _sinks(e, o) and o.t - e.sighting_t > e.sighting_limit_s(o.truth)


def _blind_budget(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return e.touches_now and o.t - e.sighting_t + b.notice_s > b.blind_commit_s


def _outside_region(e: Evidence, o: Order, b: RuleBounds) -> bool:
    radius = b.k1_m * math.exp(b.k2_per_m * o.truth.height)
    if e.committed or not (_sinks(e, o) and o.truth.distance > radius):
        return False
    # landerd cannot know what a braking or starting pad has done since the last picture, nor at
    # once what that picture shows.
    return o.truth.distance - e.surprise_m(o, MISS_S) > radius


def _heading_off(e: Evidence, o: Order, b: RuleBounds) -> bool:
    low = not e.committed and o.truth.height < b.alignment_height_m
    # Sight cannot show an error of the mounting of gimbal and camera (docs/safety.md).
    shown = wrap(o.truth.heading_error - e.hidden_heading)
    off = min(abs(o.truth.heading_error), abs(shown))
    if not (_sinks(e, o) and low and b.has_heading and off > b.heading):
        return False
    # As in _outside_region: landerd cannot know at once that a pad turns otherwise.
    return off - e.surprise_rad(o, MISS_S) > b.heading


def _too_fast_for_timeout(e: Evidence, o: Order, b: RuleBounds) -> bool:
    """Tell whether the autopilot's timeout would brake too late, were this the last order."""
    high = o.truth.height >= b.commit_height_m
    if b.guid_timeout_s is None or not (_sinks(e, o) and high):
        return False
    speed = o.velocity[2] - o.truth.pad_velocity[2]
    left_m = max(0.0, o.truth.height - speed * b.guid_timeout_s)
    braked = speed * speed - 2.0 * b.vertical_braking_mps2 * left_m
    return braked > 1.05 * b.dead_companion_mps**2


def _sinks_below_hold(e: Evidence, o: Order, b: RuleBounds) -> bool:
    if e.hold_since is None:
        return False
    # Just over the pad landerd may take it for contact for a moment.
    late_s = b.tick_s + (CONTACT_S if o.truth.height < b.commit_height_m else 0.0)
    low = o.truth.height < b.least_hold_height_m
    return _sinks(e, o) and low and o.t - e.hold_since > late_s


def _misses(e: Evidence, o: Order, b: RuleBounds) -> bool:
    # By pictures exposed since: with none landerd cannot know.
    return e.missing_since is not None and e.sighting_t - e.missing_since > MISS_S


# ---- 3: limits (the others: hw.sim.judge.limits) -----------------------------------------------


def _owes_order(e: Evidence, t: float, b: RuleBounds) -> bool:
    """Tell whether the last order is too long ago."""
    flown = e.flown_t is not None and e.flown_t > e.free_t
    return flown and e.last_order_t is not None and t - e.last_order_t > b.stream_s + 1e-6


def _too_seldom(e: Evidence, t: float, b: RuleBounds) -> bool:
    return t < e.closed_t and _owes_order(e, t, b)


# ---- 4: after contact --------------------------------------------------------------------------


def _pressed(e: Evidence, o: Order) -> bool:
    """Tell whether landerd has to press the vehicle down and go with the pad.

    Not at once after stale data, with which it cannot know of contact; nor after a release, when a
    climb away from the touched pad does not end at once.
    """
    known = o.t - max(e.lands_since, e.stale_t, e.released_t) > CONTACT_LATE_S
    return bool(o.truth.feet_down) and known and e.on_ground_t is None and e.owes_landing(o.t)


def _goes_around(e: Evidence, o: Order) -> bool:
    """Tell whether it was ordered to climb before it could know of the touch, and has to lift yet.

    Until its thrust is back it brushes the pad; ordered to descend meanwhile it would hop, and
    fall.
    """
    since = e.climbs_since
    if since is None or since >= max(e.touching_since, e.stale_t):
        return False
    return o.t - since <= THRUST_BACK_S


def _no_descent(e: Evidence, o: Order, b: RuleBounds) -> bool:
    waiting = _pressed(e, o) and o.t - e.lands_since < b.settle_s
    # A vehicle that is blown off the pad while its feet brush it must climb away (rule 2).
    away = (o.climbs and o.truth.misses) or _goes_around(e, o) or e.ends_climb(o)
    return waiting and not away and not o.level and o.velocity[2] <= ZERO


def _does_not_ride(e: Evidence, o: Order, b: RuleBounds) -> bool:
    if e.aside_since is None or o.level or not _pressed(e, o):
        return False
    return o.t - max(e.aside_since, e.touching_since) > RIDES_S


def _climbs_from_pad(e: Evidence, o: Order, b: RuleBounds) -> bool:
    climbs = bool(o.truth.feet_down) and o.climbs and not _goes_around(e, o)
    return climbs and _knows_to_stand(e, o)


def _level_in_air(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return o.level and o.t - e.touched_t > BOUNCE_S


def _level_at_once(e: Evidence, o: Order, b: RuleBounds) -> bool:
    if not o.level:
        return False
    # A released vehicle may not go with the pad any more, and once levelled stays level. One that
    # is dragged across the plate, lying flat, would soon be off it. One whose pad brakes or starts
    # faster than set-points may follow would tip over.
    is_dragged = o.truth.slip > b.ride_mps and o.truth.lean_m <= b.rocks_m
    may_level = e.released_t >= e.touching_since or is_dragged or e.is_outrun(o)
    rides = o.t - e.touched_t <= BOUNCE_S and not may_level
    return rides and o.t - e.touching_since < LEVEL_AFTER_S


def _level_sliding(e: Evidence, o: Order, b: RuleBounds) -> bool:
    # The slower of centre and foot: a vehicle that falls from an edge onto its other feet turns
    # about a foot that stands. One that slides flat on all feet, or rocks there, may be levelled:
    # its steering thrust would carry half of its weight, and let it slide on.
    slip = min(o.truth.slip, o.truth.foot_slip)
    stands_on_edge = 0 < o.truth.feet_down < 4 and o.truth.lean_m > b.rocks_m
    slides = o.level and stands_on_edge and slip > b.ride_mps
    return slides and not e.turned_over  # thrust would throw that about


def _not_level(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return o.level and not o.sound


def _never_disarms(e: Evidence, t: float, b: RuleBounds) -> bool:
    said_t = e.on_ground_t
    # While it may not fly it may not disarm either (rule 1).
    waits = said_t is not None and t - max(said_t, e.lands_since) > DISARMS_S
    return waits and e.touched and e.granted(t) and e.disarm_t < e.touching_since


# ---- 5: freshness (RC and heartbeats: rule 1b) -------------------------------------------------


def _sinks_stale(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return e.stale(o) and _sinks_blind(e, o, b)


def _turns_stale(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return e.stale(o) and _turns_blind(e, o, b)


def _wanders_stale(e: Evidence, o: Order, b: RuleBounds) -> bool:
    return e.stale(o) and _wanders_blind(e, o, b)


# ---- 6: every abort has an outcome that is told ------------------------------------------------


def _untold(e: Evidence, o: Order, b: RuleBounds) -> bool:
    # A marker that came in sight and went, unaccepted, is no news: the pilot knows of the loss.
    since = e.blind_since
    if _blind_for_s(e, o) <= TOLD_S or since is None:
        return False
    return not (_last_news_is_bad(e) or any(at >= since - TOLD_S for at, _ in e.texts))


def _last_news_is_bad(e: Evidence) -> bool:
    """Tell whether the pilot was last told that the pad is lost, not of a phase."""
    for _, text in reversed(e.texts):
        if any(words in text for words in _PHASE_NEWS):
            return False
        if any(words in text for words in _LOSS_NEWS):
            return True
    return False


def _unconfirmed_untold(e: Evidence, o: Order, b: RuleBounds) -> bool:
    late_s = b.settle_s + CONTACT_LATE_S + TOLD_S
    waits = bool(o.truth.feet_down) and e.on_ground_t is None and e.granted(o.t)
    told = any(at > e.touching_since and _UNCONFIRMED in text for at, text in e.texts)
    return waits and o.t - e.lands_since > late_s and not told


def _never_hands_back(e: Evidence, o: Order, b: RuleBounds) -> bool:
    since = e.landing_since
    return since is not None and o.t - since > b.total_s + TOLD_S and not o.zero


ORDER_RULES = (
    OrderRule("1a: a set-point while not armed or not GUIDED", _without_authority),
    OrderRule("1b: a set-point other than zero with the gate low or stale", _flies_on),
    OrderRule("1b: set-points after the release time", _never_silent),
    OrderRule("1b: a stop relative to the ground over a moving pad", _stops_on_moving_pad),
    OrderRule("1b: released on the pad and not level without thrust", _gets_up),
    OrderRule("1: a set-point before the gate was seen low again", _latched),
    OrderRule("1c: a set-point before the first sighting", _never_seen),
    OrderRule(
        "1d: turning while the pad is out of sight",
        lambda e, o, b: _out_of_sight(e, o, b) and _turns_blind(e, o, b),
    ),
    OrderRule(
        "1d: descending while the pad is out of sight",
        lambda e, o, b: _out_of_sight(e, o, b) and _sinks_blind(e, o, b),
    ),
    OrderRule(
        "1d: not hovering while the pad is out of sight",
        lambda e, o, b: _out_of_sight(e, o, b) and _wanders_blind(e, o, b),
    ),
    OrderRule("2: a downward set-point without a young sighting", _no_sighting),
    OrderRule("2: contact too long after the last sighting", _blind_budget),
    OrderRule("2: a downward set-point outside the descent region", _outside_region),
    OrderRule("2: a downward set-point with the heading off", _heading_off),
    OrderRule("2: sinking faster than the autopilot's timeout allows", _too_fast_for_timeout),
    OrderRule("2: descending below the height to hold at", _sinks_below_hold),
    OrderRule("2: descending to a pad that will be missed", _misses),
    OrderRule("4: no descent ordered after contact", _no_descent),
    OrderRule("4: not going with the pad after contact", _does_not_ride),
    OrderRule("4: a climb ordered while standing on the pad", _climbs_from_pad),
    OrderRule("4: level and without thrust while no foot is down", _level_in_air),
    OrderRule("4: did not go with the pad after contact", _level_at_once),
    OrderRule("4: level and without thrust while it slides", _level_sliding),
    OrderRule("4: an attitude ordered other than level and without thrust", _not_level),
    OrderRule("5: descending on stale or frozen data", _sinks_stale),
    OrderRule("5: turning on stale or frozen data", _turns_stale),
    OrderRule("5: not hovering on stale or frozen data", _wanders_stale),
    OrderRule("6: an abort that the pilot was not told of", _untold),
    OrderRule("6: a touch-down not confirmed, and the pilot not told", _unconfirmed_untold),
    OrderRule("6: not handed back although no landing comes about", _never_hands_back),
)

TIME_RULES = (
    TimeRule("1b: silent without stop orders first", _silent_at_once),
    TimeRule("3: set-points less often than 20 Hz", _too_seldom),
    TimeRule("4: no disarm ordered after ON_GROUND", _never_disarms),
)
