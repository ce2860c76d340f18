"""From commit to disarmed motors (design rule 4)."""

import math
from enum import Enum

from landerd.messages import Landed

BELOW_ORDER = 0.4  # contact: sinking slower than this part of the order, as measured on ArduCopter
CONTACT_S = 0.2  # for so long
ANSWER_S = 0.4  # after commit: a vehicle that hovered needs it to sink at that part of the order
BLIND_S = 0.9  # longest descent after commit without a sighting; the rule allows 1.0
EDGE_S = 0.1  # from the first foot's touch to the last one's, in wind
FASTEST_MPS = 0.6  # of the descent for that, m/s
# After contact it is levelled once it has stood still on the pad for a while, or at the latest:
LEVEL_AFTER_S = 0.6
STILL_S = 0.3
LEVEL_AT_LATEST_S = 2.5
SLIPPING_MPS = 0.1  # across the pad: thrust and wind still carry it;
UNKNOWN_SHARE = 0.05  # of a fast pad's speed may be an error
TIPPING = 0.3  # rad/s of roll and pitch: not all feet are down yet
DISARM_EVERY_S = 0.5  # the command is repeated: one may be lost


class Step(Enum):
    """What to do before contact."""

    DESCEND = "descend onto the pad"
    ABORT = "lost sight before touch-down"
    CONTACT = "on the pad"


class Touchdown:
    """Watches for contact, for the land detector, and for the time that each may take."""

    def __init__(self, timeout_s: float, descent_mps: float, reach_m: float) -> None:
        """Reach: from the centre of the feet to the furthest edge of the footprint, m."""
        self._reach_m = reach_m
        self.configure(timeout_s, descent_mps)
        self.begin(-math.inf)

    def configure(self, timeout_s: float, descent_mps: float) -> None:
        """Take a new time limit and a new gentle descent."""
        self._timeout_s = timeout_s
        self._descent_mps = descent_mps

    def begin(self, now: float) -> None:
        """Start at commit, at time now."""
        self._watch_from = now + ANSWER_S
        self._slow_since = self._still_since = math.inf
        self._contact_t: float | None = None
        self._level = False
        self._lean = 0.0
        self._disarm_t = -math.inf

    @property
    def in_contact(self) -> bool:
        """Whether contact was detected."""
        return self._contact_t is not None

    def descent(self, lean: float) -> float:
        """Return the downward speed to order against the pad's, m/s; called from commit on.

        A vehicle that leans against wind touches with one edge first. From then on it stands too
        upright to hold against the wind and too lightly not to slide, until all feet are down and
        the thrust is gone: the more it leans, the quicker that must be. So it stays when the pad
        has levelled it.

        Args:
            lean: angle from level, rad.
        """
        self._lean = max(self._lean, lean)
        quick = self._reach_m * math.tan(min(self._lean, 1.0)) / EDGE_S
        return max(self._descent_mps, min(quick, FASTEST_MPS))

    def step(
        self, now: float, sinking: float, ordered: float, sighting_age: float, landed: Landed
    ) -> Step:
        """Return what to do; called until contact.

        Args:
            now: s.
            sinking: measured downward speed, m/s.
            ordered: downward speed of the last set-point, m/s.
            sighting_age: s since the exposure of the last accepted sighting.
            landed: what the autopilot's land detector says.
        """
        self._watch(now, sinking, ordered)
        if landed is Landed.ON_GROUND or now - self._slow_since >= CONTACT_S:
            self._contact_t = now
            return Step.CONTACT
        return Step.ABORT if sighting_age > BLIND_S else Step.DESCEND

    def _watch(self, now: float, sinking: float, ordered: float) -> None:
        slow = now >= self._watch_from and sinking < BELOW_ORDER * ordered
        self._slow_since = min(self._slow_since, now) if slow else math.inf

    def disarm_due(self, now: float, landed: Landed) -> bool:
        """Tell whether the disarm command is to be sent now."""
        if landed is not Landed.ON_GROUND or now - self._disarm_t < DISARM_EVERY_S:
            return False
        self._disarm_t = now
        return True

    def level_due(
        self,
        now: float,
        sinking: float,
        slip: float,
        tipping: float,
        pad_speed: float,
        landed: Landed,
    ) -> bool:
        """Tell whether to stand level without thrust rather than to go with the pad.

        ArduCopter's land detector does not trust in a landing while more than 15 degrees of lean
        are asked for, as a velocity kept in wind does. It waits until the vehicle stands still:
        levelled on one edge, with thrust left, it would be blown away. Once level it stays so,
        but never while it sinks: what sinks is in the air, whatever was taken for contact, and
        needs its thrust.

        Args:
            now: s; called at every control step from contact on.
            sinking: measured downward speed, m/s; infinity when not known.
            slip: measured speed across the pad, m/s; infinity when not known.
            tipping: measured rate of roll and pitch, rad/s; infinity when not known.
            pad_speed: horizontal, against which slip is measured, m/s.
            landed: what the autopilot's land detector says.
        """
        self._watch(now, sinking, self._descent_mps)
        still = slip < SLIPPING_MPS + UNKNOWN_SHARE * pad_speed and tipping < TIPPING
        self._still_since = min(self._still_since, now) if still else math.inf
        waited = now - self._contact_t if self._contact_t is not None else -math.inf
        stands = waited > LEVEL_AFTER_S and now - self._still_since >= STILL_S
        late = stands or waited > LEVEL_AT_LATEST_S
        due = self._level or (late and landed is not Landed.ON_GROUND)
        self._level = due and now - self._slow_since >= CONTACT_S
        return self._level

    def unconfirmed(self, now: float, landed: Landed) -> bool:
        """Tell whether the land detector has been silent for too long after contact."""
        late = self._contact_t is not None and now - self._contact_t > self._timeout_s
        return late and landed is not Landed.ON_GROUND
