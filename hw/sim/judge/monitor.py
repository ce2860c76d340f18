"""Watches truth and wire for dangers that are no breach of a rule by any single message.

The rules (hw.sim.judge.table) say what landerd may order. The monitor checks what comes of it, and
that what the pilot is told comes true.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from hw.sim.judge.bounds import RuleBounds
from hw.sim.judge.evidence import BOUNCE_S, Order
from hw.sim.judge.truth import Feet
from hw.sim.physics.world import World
from landerd.geometry import horizontal, norm

OFF_PAD_MPS = 0.5  # against the ground; ArduCopter's own landing touches with as much
TIPS_DEG = 30.0
OLD_ORDER_S, MOVES_MPS = 0.2, 0.3
LOW_M, ERROR_M, SINKS_MPS = 1.0, 1.0, 0.15
TIPPED_BY_OTHERS = "tipped over in the hands of others"
TIPS_ON_DEG = 5.0  # a vehicle that leans against wind as it touches tips from there on
TOUCHED_S = 1.0  # so long after a touch a tilt is that of a vehicle that tips over,
CLIMBS_MPS = 0.5  # unless it climbs so fast with all feet up: then it leans as it flies
ANOTHER_S = 0.1  # feet up for longer: the next touch is judged by itself
# Flown by others, or by nobody after them, for longer they have tipped it over; or for so long
# before the first foot was down, s: it is their stop that a pad that drives tips it over with.
OTHERS_S, OTHERS_AIRBORNE_S = 1.0, 0.2
OURS_S = 3.0  # an order is flown for so long; then ArduCopter hovers, even over a deck that rises
# What wind, gusts and the lag of the inner loops may add to what is ordered.
_SPEED_SHARE, _SPEED_MPS, _ACCELERATION_MPS2, _LEAN_DEG = 1.2, 1.0, 6.0, 15.0
_LIKELY_LEAN_DEG = 45.0  # where no ANGLE_MAX is given
# A stop takes no longer than the autopilot's braking does, and this much to begin and to settle, s.
_STOPS_S = 2.0


@dataclass
class Worst:
    """The hardest of all contacts of a flight, against what was touched."""

    down_mps: float = 0.0
    across_mps: float = 0.0
    tilt_deg: float = 0.0  # while a foot was down, or shortly after


class Promise(NamedTuple):
    """What the pilot was told, and what must be so after a while, if nothing else is told.

    What is told of now, within 0 s, must be so as it is told.
    """

    words: str
    within_s: float
    finding: str
    is_kept: Callable[["SafetyMonitor"], bool]
    stops: bool = False  # it may fly fast, and stop as slowly as its autopilot brakes


PROMISES = (  # the first whose words are in a text counts
    Promise("holding over", 6.0, "told to hold over the pad, and it does not", lambda m: m.stays),
    Promise("holding", 6.0, "told to hold, and it does not hover", lambda m: m.hovers, stops=True),
    Promise("climbing away", 1.0, "told to climb away, and it sinks", lambda m: not m.sinks),
    Promise("landed and disarmed", 0.0, "told to have landed, and it flies", lambda m: m.stands),
    Promise("beside the pad", 0.0, "told to have missed, and it stands on it", lambda m: m.missed),
    Promise("not confirmed", 0.0, "told to have touched, and no foot is down", lambda m: m.touches),
)


class SafetyMonitor:
    """Hangs on the world's steps and on landerd's orders and texts.

    Attributes:
        found: each finding once with the time when it came first, s.
        worst: contacts.
    """

    def __init__(
        self,
        world: World,
        feet: Feet,
        bounds: RuleBounds,
        flies: Callable[[], bool],
        others_fly: Callable[[], bool],
    ) -> None:
        """Watch from now on.

        Args:
            world: the truth.
            feet: over the plate.
            bounds: what may be ordered.
            flies: the vehicle is armed and in GUIDED, and landerd has not heard otherwise.
            others_fly: it is armed and in another mode.
        """
        self.found: dict[str, float] = {}
        self.worst = Worst()
        self._world, self._feet, self._b, self._flies = world, feet, bounds, flies
        self._others_fly = others_fly
        self._ours_t = world.t  # last, that landerd's young order was flown, or it had disarmed
        lean = world.options.airframe.angle_max_deg or _LIKELY_LEAN_DEG
        self._lean = math.radians(lean + _LEAN_DEG)
        self._order: Order | None = None
        self._taken_over_mps = math.inf  # the least since then; 0: it was within the limits
        self._touched_t = self._set_down_t = -math.inf  # a foot down, last and after a flight
        self._leant_deg = 0.0  # in the air, last
        self._has_tipped = False  # it leans as one that tips over, and who did that is known
        self._by_others = False  # others have tipped it over since it last flew
        self._promise: tuple[float, Promise] | None = None  # until when, what
        world.on_step.append(self._on_step)

    # ---- what is so ----------------------------------------------------------------------------

    @property
    def hovers(self) -> bool:
        """It stands still in the air, or its feet are down."""
        return norm(self._world.vehicle.velocity) < 1.0 or self.touches

    @property
    def stays(self) -> bool:
        """It goes with the pad, or its feet are down."""
        return norm(self._world.relative_velocity) < 1.0 or self.touches

    @property
    def sinks(self) -> bool:
        """It sinks, against the pad."""
        return self._world.relative_velocity[2] > SINKS_MPS

    @property
    def stands(self) -> bool:
        """It stands somewhere with its motors off."""
        return self.touches and not self._world.vehicle.motors

    @property
    def missed(self) -> bool:
        """A foot is beside the plate."""
        return not self._feet.over_plate()

    @property
    def touches(self) -> bool:
        """A foot is down, or was a moment ago."""
        return self._world.t - self._touched_t <= TOUCHED_S

    # ---- what passes on the wire ---------------------------------------------------------------

    def on_order(self, order: Order) -> None:
        """landerd orders something."""
        self._order = order

    def on_text(self, t: float, text: str) -> None:
        """The pilot is told something: what was told before is over."""
        self._promise = None
        promises = [p for p in PROMISES if p.words in text]
        if not promises:
            return
        promise = promises[0]
        if promise.within_s > 0.0:
            within_s = promise.within_s
            if promise.stops:
                speed_mps = norm(self._world.vehicle.velocity)
                within_s = max(within_s, speed_mps / self._b.braking_mps2 + _STOPS_S)
            self._promise = (t + within_s, promise)
        elif not promise.is_kept(self):  # nothing may come after it: neither text nor step
            self._find(t, promise.finding)

    # ---- what comes of it ----------------------------------------------------------------------

    def _on_step(self, world: World) -> None:
        vehicle = world.vehicle
        if any(vehicle.feet):
            self._touch(world)
        flies = self._flies()
        if not flies:
            self._order, self._taken_over_mps = None, math.inf
        is_ours = self._order is not None and world.t - self._order.t < OURS_S
        if is_ours or not (flies or self._others_fly()):
            self._ours_t = world.t
        tilt = math.hypot(vehicle.roll, vehicle.pitch)
        self._by_others &= self.touches
        climbs = not any(vehicle.feet) and world.relative_velocity[2] < -CLIMBS_MPS
        if self.touches and not climbs:
            self._watch_tilt(world.t, tilt)
        else:
            self._leant_deg = math.degrees(tilt)
            if flies and self._order is not None:
                self._watch_air(world, tilt)
        if flies and self._order is not None:
            self._watch_order(world, self._order)
        if self._promise is not None and world.t >= self._promise[0]:
            _, promise = self._promise
            self._promise = None
            # Who flies it otherwise keeps no promise of landerd's.
            if not promise.is_kept(self) and flies:
                self._find(world.t, promise.finding)

    def _touch(self, world: World) -> None:
        t, before = world.t, self._touched_t
        self._touched_t = t
        if t - before > TOUCHED_S:
            self._set_down_t = t
        if t - before <= ANOTHER_S:
            return
        on_pad = world.vehicle.on_pad
        velocity = self._feet.touching_velocity() if on_pad else world.vehicle.velocity
        self.worst.down_mps = max(self.worst.down_mps, velocity[2])
        self.worst.across_mps = max(self.worst.across_mps, horizontal(velocity))
        # One that lies where others have tipped it over may be thrown about.
        by_landerd = self._flies() and not self._by_others
        if not on_pad and norm(velocity) > OFF_PAD_MPS and by_landerd:
            self._find(t, f"ground contact off the pad above {OFF_PAD_MPS:g} m/s")

    def _watch_tilt(self, t: float, tilt: float) -> None:
        tilt_deg = math.degrees(tilt)
        self.worst.tilt_deg = max(self.worst.tilt_deg, tilt_deg)
        tipped_before = self._has_tipped
        self._has_tipped = tilt_deg > max(TIPS_DEG, self._leant_deg + TIPS_ON_DEG)
        if self._has_tipped and not tipped_before:  # whoever flies it while it lies there
            by_others = t - self._ours_t > OTHERS_S
            by_others |= self._set_down_t - self._ours_t > OTHERS_AIRBORNE_S
            self._by_others |= by_others
            self._find(t, TIPPED_BY_OTHERS if by_others else f"tipped over {TIPS_DEG:g} degrees")

    def _watch_air(self, world: World, tilt: float) -> None:
        b, t = self._b, world.t
        vn, ve, vd = world.vehicle.velocity
        speed = math.hypot(vn, ve)
        if speed <= _SPEED_SHARE * b.speed_mps + _SPEED_MPS:
            self._taken_over_mps = 0.0
        # It may have been taken over faster than it may fly: then it must not grow.
        elif speed > self._taken_over_mps + _SPEED_MPS:
            self._find(t, "faster than the limits")
        else:
            self._taken_over_mps = min(self._taken_over_mps, speed)
        if (
            not -_SPEED_SHARE * b.climb_mps - _SPEED_MPS
            <= vd
            <= (_SPEED_SHARE * b.descent_mps + _SPEED_MPS)
        ):
            self._find(t, "climbs or sinks faster than the limits")
        if horizontal(world.vehicle.acceleration) > b.acceleration_mps2 + _ACCELERATION_MPS2:
            self._find(t, "accelerates more than the limits")
        if tilt > self._lean:
            self._find(t, "leans more than the limits")

    def _watch_order(self, world: World, order: Order) -> None:
        t, vehicle = world.t, world.vehicle
        # At every step of the world: what costs least comes first.
        is_old = t - order.t > self._b.jitter_s + self._b.stall_s + OLD_ORDER_S
        if is_old and not (order.zero or order.level) and norm(vehicle.velocity) > MOVES_MPS:
            self._find(t, f"motion on a set-point older than {OLD_ORDER_S:g} s")
        # Of an old one the autopilot has made an end meanwhile.
        may_sink = not is_old and order.sinks and t - self._touched_t > BOUNCE_S
        low = may_sink and not world.is_above(LOW_M) and world.height < LOW_M
        if low and self.sinks and math.hypot(*world.offset) > ERROR_M:
            self._find(t, f"descends below {LOW_M:g} m, more than {ERROR_M:g} m off")

    def _find(self, t: float, finding: str) -> None:
        self.found.setdefault(finding, t)
