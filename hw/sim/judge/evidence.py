"""The facts that the rules are judged by.

They come from the bytes at both ends of the link, the pictures and gimbal angles that were
delivered, and the truth at the time of landerd's orders. Data have the time of their measurement by
truth, never the one that landerd assigns to them.
"""

import math
from collections import deque
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.sim.judge.bounds import ZERO, RuleBounds
from hw.sim.judge.truth import Truth
from landerd.geometry import Vec3, add, horizontal, scale, sub, wrap

BOUNCE_S = 0.2  # a contact ends when the feet are up for longer than this
# A vehicle stands when it has been on its feet, no faster across the pad than this, for this long.
_STILL_MPS, STILL_S = 0.2, 1.0
# How far above the commit height a falling deck may leave a committed vehicle, m.
_FALLS_AWAY_M = 0.1
_SINKS_ON_S = 0.1  # a descent goes on for this long, whatever is ordered
_HEIGHT_ERROR_M = 0.02  # of landerd's, by which it may take itself to be lower
# After the release set-points may take this long to reach the pad's velocity, as they are limited.
_LED_S = 0.5
_NEAR_M = 3.0  # farther from the landing point the plate is not below, nor will be soon
# A pad that brakes or starts may carry the vehicle at another velocity than set-points can follow.
# With 1 m/s of difference that tips over within a second; from this on, m/s, it may be levelled.
_OUTRUN_MPS = 0.3
_KEEP_S = 2.0  # how long orders are kept
_TURNS_OVER = math.radians(60.0)  # no multicopter flies so
_COURSE_S = 0.1  # over which the pad's velocity is differenced
_RESTART_S = 1.0  # step back of the boot clock that shows a restart
_WRAP_S = 2.0**32 / 1e3  # of time_boot_ms


@dataclass(frozen=True, slots=True)
class Order:
    """One set-point, or an order to stand level without thrust, with the truth at that time."""

    t: float
    velocity: Vec3  # local NED, m/s; zero for a level order
    yaw_rate: float  # rad/s
    truth: Truth
    level: bool = False  # SET_ATTITUDE_TARGET
    sound: bool = True  # False: a SET_ATTITUDE_TARGET that is not level, or has thrust
    in_body_frame: bool = False  # the set-point was sent in the body's frame

    @property
    def zero(self) -> bool:
        """Whether it is an order to stop."""
        still = math.hypot(*self.velocity) < ZERO and abs(self.yaw_rate) < ZERO
        return still and not self.level

    @property
    def sinks(self) -> bool:
        """Whether it goes down, and faster than the pad does."""
        return self.velocity[2] > max(0.0, self.truth.pad_velocity[2]) + ZERO

    @property
    def climbs(self) -> bool:
        """Whether it goes up, and faster than the pad does."""
        return self.velocity[2] < min(0.0, self.truth.pad_velocity[2]) - ZERO

    @property
    def aside_mps(self) -> float:
        """How fast it goes across the pad, m/s."""
        own, pad = self.velocity, self.truth.pad_velocity
        return math.hypot(own[0] - pad[0], own[1] - pad[1])


@dataclass(frozen=True)
class _Release:
    """The state when landerd's authority ended."""

    t: float  # s
    height: float  # over the pad, m
    bound: bool  # it must climb away: a stop would tip the vehicle over
    low: bool  # it may climb away: it is just over a pad that moves
    slides: bool  # it may climb away: it slides across the pad
    aside_mps: float  # speed of the order across the pad, m/s


class Evidence:
    """The facts. Times in s on the loop's clock; -inf: never so far, None: not so now.

    Attributes:
        armed: by the last heartbeat.
        guided: by the last heartbeat.
        authority_lost_t: when it last ceased to be armed and GUIDED.
        latched: the gate must be seen low before landerd may fly.
        gate_low_t: since when the gate has been low.
        hold_since: since when the pilot has asked to hold over the marker.
        sighting_t: exposure of the newest delivered picture with a marker really in it.
        texts: what the pilot was told, with the times.
        asked_t: when a configured ground station last asked landerd for something.
        flown_t: time of the last order under granted authority.
        last_order_t: time of the last order.
        stops_since: since when all orders have been to stop, or to stand level.
        free_t: the last time that landerd did not have to stream orders.
        barred_t: the last time that landerd might not fly, or had been silent for release_s.
        touched: a foot was down, and the vehicle has not climbed away since.
        touched_t: when a foot was last down.
        touching_since: since when a foot has been down but for bounces, with orders or without.
        touches_now: this order is the first one since the touch.
        levelled: landerd has ordered to stand level since the touch.
        turned_over: it has leaned since the touch as none flies.
        on_ground_t: since when the autopilot has reported ON_GROUND.
        disarm_t: time of the last order to disarm.
        blind_since: since when sight or data have been too old to fly on.
        stale_t: when data were last too old to fly on, or frozen.
        missing_since: since when it has been descending onto a pad that it will miss.
        released_t: time of the last order while landerd might not fly on.
        aside_since: since when all orders have gone across the pad, not with it.
        climbs_since: since when all orders have climbed.
        landing_since: since when it has flown without coming to commit.
        low_t: last time that its lowest foot was below the commit height.
        committed: it was ordered down below the commit height, and at every order since.
        hidden_heading: error of the pad's heading that sight cannot show, by the mounting of gimbal
            and camera, rad; positive: the heading shows too large.
    """

    def __init__(self, bounds: RuleBounds) -> None:
        self._b = bounds
        self.armed = self.guided = False
        self.authority_lost_t = 0.0
        self.latched = True
        self.gate_low_t: float | None = 0.0
        self.hold_since: float | None = None
        self.sighting_t = -math.inf
        self.texts: list[tuple[float, str]] = []
        self.asked_t = -math.inf
        self.flown_t: float | None = None
        self.last_order_t: float | None = None
        self.stops_since: float | None = None
        self.free_t = 0.0
        self.barred_t = -math.inf
        self.touched = self.touches_now = self.levelled = self.turned_over = False
        self.touched_t = -math.inf
        self.touching_since = 0.0
        self.on_ground_t: float | None = None
        self.disarm_t = -math.inf
        self.blind_since: float | None = None
        self.stale_t = -math.inf
        self.missing_since: float | None = None
        self.released_t = -math.inf
        self.aside_since: float | None = None
        self.climbs_since: float | None = None
        self.landing_since: float | None = None
        self.low_t: float | None = None
        self.committed = False
        self.hidden_heading = 0.0
        self._beat_t = self._rc_t = -math.inf
        self._ended_t = math.inf  # handed back, told to stop, or the autopilot has restarted
        self._boot_s = self._boot_t = -math.inf
        self._suspected_s: float | None = None  # boot time less t, that did not fit
        self._boot_of: dict[int, float] = {}  # of the newest message of each kind
        self._content: dict[str, object] = {}
        self._measured: dict[str, float] = {}
        self._lately: deque[Order] = deque()
        self._still_since: float | None = None
        self._released: _Release | None = None
        self._climbed_away_t = -math.inf  # the last order of a wave-off after the release

    # ---- what the autopilot says ---------------------------------------------------------------

    def on_heartbeat(self, t: float, message: mavlink.MAVLink_message) -> None:
        """Take a heartbeat; it has no time of its own, and counts from its arrival, t."""
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        guided = message.custom_mode == mavlink.COPTER_MODE_GUIDED
        if (self.armed and not armed) or (self.guided and not guided):
            self.latched = True
        if self.armed and self.guided and not (armed and guided):
            self.authority_lost_t = t
        if armed and not self.armed:
            # A new flight: an order that was on its way when the motors stopped is none of it.
            self._forget_contact()
        self.armed, self.guided, self._beat_t = armed, guided, t

    def on_rc(self, t: float, measured_t: float, message: mavlink.MAVLink_message) -> None:
        """Take the receiver's channels, which arrive at t; dropped if measured before the last."""
        if measured_t < self._rc_t:
            return
        pulse = getattr(message, f"chan{self._b.gate_channel}_raw")
        present = pulse not in (0, 65535)
        high = present and pulse > self._b.gate_threshold_us
        if present and not high:
            self.latched = False
            self._ended_t = math.inf
        if not (high and pulse <= self._b.land_threshold_us):
            self.hold_since = None
        elif self.hold_since is None:
            self.hold_since = t
        if high:
            self.gate_low_t = None
        elif self.gate_low_t is None:
            self.gate_low_t = t
        self._rc_t = measured_t

    def on_boot_time(self, t: float, boot_s: float, *, is_answer: bool = False) -> bool:
        """Take the autopilot's time since boot; tell whether it is believed.

        After a restart it is less than before. A single such report may be wrong: two in a row are
        believed, and any answer to TIMESYNC.
        """
        boot_s = boot_s if is_answer else self._unwrapped(t, boot_s)
        is_back = boot_s < self._boot_s - _RESTART_S
        is_ahead = boot_s > self._boot_s + t - self._boot_t + _RESTART_S
        if (is_back and not is_answer) or (is_ahead and self._boot_s > -math.inf):
            suspected, self._suspected_s = self._suspected_s, boot_s - t
            if suspected is None or abs(self._suspected_s - suspected) > _RESTART_S:
                return False
        self._suspected_s = None
        if is_back:
            self.latched = True
            self._ended_t = min(self._ended_t, t)
        self._boot_s, self._boot_t = boot_s, t
        return True

    def _unwrapped(self, t: float, boot_s: float) -> float:
        """Return the boot time (s) that 32 bits of ms stand for: the nearest to the expected one.

        TIMESYNC's time does not wrap. A clock that steps back over its own wrap has stepped back,
        not 49 days ahead; but no boot time is negative.
        """
        if self._boot_s == -math.inf:
            return boot_s
        expected = self._boot_s + t - self._boot_t
        nearest = boot_s + _WRAP_S * round((expected - boot_s) / _WRAP_S)
        return nearest if nearest >= 0.0 else boot_s

    def on_feet(self, t: float, *, down: bool) -> None:
        """Take whether a foot is down at time t of the world."""
        if down:
            if t - self.touched_t > BOUNCE_S:
                self.touching_since = t
            self.touched_t = t

    def held_back_s(self, kind: int, boot_s: float) -> float:
        """Return how long a message was held back before it left, by others that passed it, s.

        Args:
            kind: id of the message; those of one kind come in order.
            boot_s: its time since boot. Later by more than _RESTART_S it was not held back: the
                clock was set back.
        """
        newest = max((s for k, s in self._boot_of.items() if k != kind), default=-math.inf)
        self._boot_of[kind] = boot_s
        return newest - boot_s if 0.0 < newest - boot_s <= _RESTART_S else 0.0

    def on_measured(self, what: str, t: float, content: object) -> None:
        """Take a measurement of time t; one that is equal to the bit is the old one again."""
        if content != self._content.get(what):
            self._content[what] = content
            self._measured[what] = max(t, self._measured.get(what, -math.inf))

    def on_landed_state(self, t: float, *, on_ground: bool) -> None:
        """Take whether the autopilot reports ON_GROUND."""
        if not on_ground:
            self.on_ground_t = None
        elif self.on_ground_t is None:
            self.on_ground_t = t

    def tell(self, t: float, text: str) -> None:
        """Take a text to the pilot; with the words "take over" landerd's authority ends."""
        self.texts.append((t, text))
        if "take over" in text:
            self._ended_t = min(self._ended_t, t)

    def on_death(self, t: float) -> None:
        """Note that landerd's process is killed; an order may still be on its way."""
        self.latched, self.authority_lost_t = True, t
        self.flown_t = self.stops_since = self.landing_since = None
        self.blind_since = self.missing_since = self.aside_since = self.climbs_since = None
        self.free_t = t

    # ---- what follows from it ------------------------------------------------------------------

    @property
    def closed_t(self) -> float:
        """The time from which landerd may not fly on, s; in the future while it may."""
        b = self._b
        low = math.inf if self.gate_low_t is None else self.gate_low_t
        return min(self._ended_t, low, self._rc_t + b.rc_s, self._beat_t + b.heartbeat_s)

    def granted(self, t: float) -> bool:
        """Tell whether landerd may fly."""
        return self.armed and self.guided and not self.latched and t < self.closed_t

    def owes_landing(self, t: float) -> bool:
        """Tell whether landerd may fly and must know it: it may judge data stale a little early."""
        return self.granted(t) and t < self.closed_t - self._b.early_s

    @property
    def lands_since(self) -> float:
        """Since when a foot is down with landerd flying: the duties of rule 4 run from then."""
        return max(self.touching_since, self.barred_t)

    def stale(self, order: Order) -> bool:
        """Tell whether data are too old for an order, or frozen."""
        return self.stale_at(order.t, self.sighting_limit_s(order.truth))

    def stale_at(self, t: float, sighting_s: float) -> bool:
        """Tell whether attitude, position or gimbal angles are too old to fly on, or frozen.

        Without new gimbal angles earlier sightings may be flown on, for as long as any sighting. A
        gimbal that never reports (servos, a bolted camera) does not count.

        Args:
            t: s.
            sighting_s: how old a sighting may be.
        """
        b, measured = self._b, self._measured
        return (
            t - measured.get("attitude", -math.inf) > b.attitude_s + b.tick_s
            or t - measured.get("position", -math.inf) > b.position_s + b.tick_s
            or t - measured.get("gimbal", math.inf) > b.gimbal_s + sighting_s + b.tick_s
        )

    def surprise_m(self, order: Order, noticed_s: float) -> float:
        """Return the horizontal distance of the pad from where landerd can expect it, m.

        That is where it would be had it gone straight on since noticed_s before the exposure of the
        last sighting.
        """
        course = self._course(noticed_s)
        if course is None:
            return 0.0
        before, last = course
        point = last.truth.landing_point
        way = sub(point, before.truth.landing_point)
        ahead = scale(way, (order.t - last.t) / (last.t - before.t))
        return horizontal(sub(order.truth.landing_point, add(point, ahead)))

    def surprise_rad(self, order: Order, noticed_s: float) -> float:
        """Return the same of its heading, had it gone on turning at a constant rate, rad."""
        course = self._course(noticed_s)
        if course is None:
            return 0.0
        before, last = course
        heading = last.truth.pad_heading
        turned = wrap(heading - before.truth.pad_heading)
        ahead = turned * (order.t - last.t) / (last.t - before.t)
        return abs(wrap(order.truth.pad_heading - heading - ahead))

    def _course(self, noticed_s: float) -> tuple[Order, Order] | None:
        """Return two orders by whose truth the pad's velocity and turn rate are known.

        The second is the last one noticed_s before the exposure of the last sighting, the first
        _COURSE_S earlier. None: there were no orders then.
        """
        seen = [each for each in self._lately if each.t <= self.sighting_t - noticed_s]
        before = [each for each in seen if each.t <= seen[-1].t - _COURSE_S]
        return (before[-1], seen[-1]) if before else None

    def sighting_limit_s(self, truth: Truth) -> float:
        """Return how old the last sighting may be, s."""
        low = truth.height < self._b.commit_height_m
        return self._b.blind_commit_s if low else self._b.sighting_s

    def stands(self, t: float) -> bool:
        """Tell whether the vehicle stands on the pad, or landerd has ordered it to."""
        still = self._still_since is not None and t - self._still_since > STILL_S
        return self.touched and (self.levelled or still)

    def must_climb_away(self, t: float, truth: Truth) -> bool:
        """Tell whether a stop relative to the ground would tip the vehicle over on the pad."""
        released, b = self._released, self._b
        return (
            released is not None
            and released.bound
            and t - released.t < b.wave_off_s - b.early_s
            and truth.height - released.height < 0.5 * b.wave_off_m
        )

    def climbs_away(self, order: Order) -> bool:
        """Tell whether an order is that of a wave-off from a pad that moves, after the release."""
        released, b = self._released, self._b
        return (
            released is not None
            and (released.low or released.slides)
            and order.t - released.t <= b.wave_off_s + 2.0 * b.tick_s
            and order.truth.height - released.height <= b.wave_off_m
            and order.velocity[2] <= ZERO
            and (released.slides or order.aside_mps <= self._most_aside_mps(released, order.t))
        )

    def _most_aside_mps(self, released: _Release, t: float) -> float:
        """Return how fast the orders of a wave-off may go across the pad at t, m/s."""
        is_led = t - released.t < _LED_S
        return max(self._b.ride_mps, released.aside_mps) if is_led else self._b.ride_mps

    @property
    def release_t(self) -> float:
        """The time from which only stop orders may come, s."""
        return max(self.closed_t, self._climbed_away_t)

    def ends_climb(self, order: Order) -> bool:
        """Tell whether an order neither climbs nor sinks, and the one before it climbed."""
        since = order.t - self._b.stream_s
        return abs(order.velocity[2]) <= ZERO and any(
            before.climbs for before in self._lately if since <= before.t < order.t
        )

    def waves_off(self, order: Order) -> bool:
        """Tell whether an order climbs from just over the pad: exempt from acceleration limits."""
        if self.low_t is None or not order.climbs:
            return False
        b = self._b
        near = order.truth.height <= b.commit_height_m + b.wave_off_m
        return near and order.t - self.low_t <= b.wave_off_s

    # ---- orders --------------------------------------------------------------------------------

    def note(self, order: Order) -> None:
        """Update the facts by an order, before the rules are applied to it."""
        self._note_contact(order)
        self._note_release(order)
        self._note_sight(order)
        self._note_pad(order)
        t, truth, b = order.t, order.truth, self._b
        if not (order.zero or order.level):
            self.stops_since = None
        elif self.stops_since is None:
            self.stops_since = t
        if t < self.closed_t and not self.latched:
            self.flown_t = t
        low = truth.height < b.commit_height_m
        goes_down = order.level or order.velocity[2] > ZERO
        high = truth.height >= b.commit_height_m + _FALLS_AWAY_M
        self.committed = goes_down and not high and (low or self.committed)
        if truth.height - truth.lean_m < b.commit_height_m or self._is_just_over(truth):
            self.low_t = t
        if low or self.touched or self.hold_since is not None or not self.granted(t):
            self.landing_since = None
        elif self.landing_since is None:
            self.landing_since = t
        seen = t - self.sighting_t < b.sighting_s
        missing = truth.misses or truth.slip > b.commit_slip_mps + 0.1
        committed = truth.height < b.commits_at_m and not self.touched
        if not (committed and order.sinks and seen and missing):
            self.missing_since = None
        elif self.missing_since is None:
            self.missing_since = t

    def _is_just_over(self, truth: Truth) -> bool:
        """Tell whether landerd may take the vehicle to be just over the pad."""
        sinking = max(0.0, truth.velocity[2] - truth.pad_velocity[2])
        sunk_m = truth.height - _SINKS_ON_S * sinking
        return sunk_m < self._b.commit_height_m + _HEIGHT_ERROR_M

    def is_outrun(self, order: Order) -> bool:
        """Tell whether its velocity is so far off the last ordered one that thrust tips it over."""
        asked = next((each for each in reversed(self._lately) if not each.level), None)
        if asked is None:
            return False
        return horizontal(sub(asked.velocity, order.truth.velocity)) > _OUTRUN_MPS

    def _note_pad(self, order: Order) -> None:
        t = order.t
        self._lately.append(order)
        while self._lately[0].t < t - _KEEP_S:
            self._lately.popleft()
        if order.level or order.aside_mps <= self._b.ride_mps:
            self.aside_since = None
        elif self.aside_since is None:
            self.aside_since = t
        if not order.climbs:
            self.climbs_since = None
        elif self.climbs_since is None:
            self.climbs_since = t

    def _forget_contact(self) -> None:
        self.touched = self.levelled = self.turned_over = False
        self.on_ground_t = None

    def _note_contact(self, order: Order) -> None:
        t, truth = order.t, order.truth
        self.touches_now = bool(truth.feet_down) and not self.touched
        if truth.feet_down:
            self.touched = True
        elif truth.height > self._b.commit_height_m:
            self._forget_contact()
        if self.touched and truth.tilt > _TURNS_OVER:
            self.turned_over = True
        if truth.feet_down < 3 or truth.slip > _STILL_MPS:
            self._still_since = None
        elif self._still_since is None:
            self._still_since = t
        if order.level and truth.feet_down:
            self.levelled = True

    def _note_release(self, order: Order) -> None:
        t, truth, b = order.t, order.truth, self._b
        closed_t = self.closed_t
        if t >= closed_t:
            self.released_t = t
        if t < closed_t or not (self.armed and self.guided):
            self._released = None
        elif self._released is None:
            low = self._is_just_over(truth) or self.touched
            near = truth.distance < _NEAR_M
            fast = horizontal(truth.pad_velocity) > b.wave_off_pad_mps
            flies = fast and not self.stands(t) and self.flown_t is not None
            # Above its own commit height a vehicle can be stopped in time.
            committed = truth.height < b.commits_at_m or self.touched
            self._released = _Release(
                closed_t,
                truth.height,
                bound=committed and near and flies,
                low=low and near and flies,
                slides=low and near and truth.slip > b.wave_off_pad_mps,
                aside_mps=order.aside_mps,
            )
        if self.climbs_away(order) and not order.zero:
            self._climbed_away_t = t

    def _note_sight(self, order: Order) -> None:
        t = order.t
        limit = self.sighting_limit_s(order.truth) + self._b.tick_s
        stale = self.stale(order)
        if stale:
            self.stale_t = t
        blind = t - self.sighting_t > limit or stale
        if order.zero or self.touched:
            return
        if not blind:
            self.blind_since = None
        elif self.blind_since is None:
            self.blind_since = t
