"""From commit to disarmed motors (design rule 4)."""

import math
from enum import Enum

from landerd.messages import Landed

BELOW_ORDER = 0.4  # contact: sinking slower than this part of the order, as measured on ArduCopter
CONTACT_S = 0.2  # for so long
ANSWER_S = 0.4  # after commit: a vehicle that hovered needs it to sink at that part of the order
BLIND_S = 0.9  # longest descent after commit without a sighting; the rule allows 1.0
# After contact: by then ArduCopter has said ON_GROUND unless lean keeps it from it.
LEVEL_AFTER_S = 2.5
DISARM_EVERY_S = 0.5  # the command is repeated: one may be lost


class Step(Enum):
    """What to do before contact."""

    DESCEND = "descend onto the pad"
    ABORT = "lost sight before touch-down"
    CONTACT = "on the pad"


class Touchdown:
    """Watches for contact, for the land detector, and for the time that each may take."""

    def __init__(self, timeout_s: float) -> None:
        self.configure(timeout_s)
        self.begin(-math.inf)

    def configure(self, timeout_s: float) -> None:
        """Take a new time limit."""
        self._timeout_s = timeout_s

    def begin(self, now: float) -> None:
        """Start at commit, at time now."""
        self._watch_from = now + ANSWER_S
        self._slow_since = math.inf
        self._contact_t: float | None = None
        self._level = False
        self._disarm_t = -math.inf

    @property
    def in_contact(self) -> bool:
        """Whether contact was detected."""
        return self._contact_t is not None

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

    def level_due(self, now: float, sinking: float, ordered: float, landed: Landed) -> bool:
        """Tell whether to stand level without thrust rather than to go with the pad.

        ArduCopter's land detector does not trust in a landing while more than 15 degrees of lean
        are asked for, as a velocity kept in wind does. Once level it stays so, but never while it
        sinks: what sinks is in the air, whatever was taken for contact, and needs its thrust.

        Args:
            now: s; called at every control step from contact on.
            sinking: measured downward speed, m/s; infinity when not known.
            ordered: downward speed that presses it onto the pad, m/s.
            landed: what the autopilot's land detector says.
        """
        self._watch(now, sinking, ordered)
        late = self._contact_t is not None and now - self._contact_t > LEVEL_AFTER_S
        due = self._level or (late and landed is not Landed.ON_GROUND)
        self._level = due and now - self._slow_since >= CONTACT_S
        return self._level

    def unconfirmed(self, now: float, landed: Landed) -> bool:
        """Tell whether the land detector has been silent for too long after contact."""
        late = self._contact_t is not None and now - self._contact_t > self._timeout_s
        return late and landed is not Landed.ON_GROUND
