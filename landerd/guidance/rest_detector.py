"""Whether the vehicle is seen to rest on the pad, whoever flies it."""

import math

from landerd.config.models import GuidanceSection
from landerd.geometry import horizontal
from landerd.guidance.footprint import Footprint
from landerd.guidance.relative_state import Sight
from landerd.guidance.touchdown import MAX_CONTACT_HEIGHT_M
from landerd.messages import Landed

# Height by sight at which a foot may be down, m: gear and camera are measured to 2 cm each. Without
# this allowance a vehicle that stood on one foot climbed away, as its pad seemed to slide.
BUILD_ERROR_M = 0.04
# Vertical speed, m/s, and duration, s, by which a vehicle that is told to climb rests on the pad:
# the reversal from descent to climb takes half as long. On a tilted pad standing feet may seem
# higher than BUILD_ERROR_M: at up to the height at which contact is believed, and moving with the
# pad, no vehicle flies for RESTS_HIGHER_S. Nor does one whose height by sight does not change for
# as long, whatever its autopilot says of its climb rate: with a constant error of 0.3 m/s in that,
# it stood under thrust for ever, said to be on the ground.
RESTS_MPS = 0.1
RESTS_S, RESTS_HIGHER_S = 0.35, 1.0
# Time constant of the height by sight, s, differenced where the autopilot's climb rate is wrong:
# its noise of some millimetres then makes less than RESTS_MPS. Chosen by hand.
HEIGHT_CHANGES_S = 0.3


class RestDetector:
    """Tells from sight of the pad whether the vehicle rests on it.

    Attributes:
        is_possible: it may rest there, the uncertainty of its velocities counted.
    """

    def __init__(self, options: GuidanceSection, footprint: Footprint) -> None:
        self.configure(options)
        self._footprint = footprint
        self.out_of_sight()

    def configure(self, options: GuidanceSection) -> None:
        """Take changed parameters."""
        self._options = options

    def out_of_sight(self) -> None:
        """Start afresh: the pad is out of sight."""
        # Since when it has been at rest over the pad, and since when also low enough to stand, s.
        self._since = self._low_since = math.inf
        # Since when it has been as low and its height by sight has not changed, s.
        self._unchanged_since = math.inf
        self.is_possible = False
        self._height_m: float | None = None  # over the pad by sight, low-passed, m

    def watch(self, now: float, dt: float, sight: Sight, landed: Landed) -> None:
        """Take one control step with the pad in sight.

        Args:
            now: s.
            dt: since the last control step, s.
            sight: of the pad.
            landed: what the autopilot's land detector says.
        """
        relative, o = sight.relative, self._options
        is_there = relative.height <= MAX_CONTACT_HEIGHT_M and not self._footprint.will_miss(
            relative, sight.heading, o.touchdown_descent_mps, o.descent.commit_miss_m
        )
        changes = self._height_rate(relative.height, dt)
        if not is_there:
            self._since = self._low_since = self._unchanged_since = math.inf
            self.is_possible = False
            return
        # Early in a flight the lens's errors are not known yet: ON_GROUND serves as well.
        is_low = relative.least_height <= BUILD_ERROR_M or landed is Landed.ON_GROUND
        up = abs(changes if sight.climb_rate_is_wrong else relative.error_rate[2])
        across = horizontal(relative.error_rate)
        goes_along = across < o.descent.commit_slip_mps
        rests = up < RESTS_MPS and goes_along
        # After a gap the first pictures leave the pad's velocity uncertain.
        self.is_possible = (
            up < RESTS_MPS + 2.0 * relative.sigma_heave
            and across < o.descent.commit_slip_mps + 2.0 * relative.sigma_velocity
        )
        self._since = min(self._since, now) if rests else math.inf
        self._low_since = min(self._low_since, now) if is_low and rests else math.inf
        is_unchanged = is_low and goes_along and abs(changes) < RESTS_MPS
        self._unchanged_since = min(self._unchanged_since, now) if is_unchanged else math.inf

    def _height_rate(self, height: float, dt: float) -> float:
        """Return the rate of the height over the pad by sight, low-passed, m/s; up is positive."""
        last = height if self._height_m is None else self._height_m
        self._height_m = last + min(1.0, dt / HEIGHT_CHANGES_S) * (height - last)
        return (height - self._height_m) / HEIGHT_CHANGES_S

    def is_seen(self, now: float) -> bool:
        """Tell whether by sight it has rested on the pad for long enough, at now (s)."""
        if now - self._low_since >= RESTS_S:
            return True
        return now - min(self._since, self._unchanged_since) >= RESTS_HIGHER_S
