"""Whether the vehicle is seen to rest on the pad, whoever flies it."""

import math

from landerd.config.models import GuidanceSection
from landerd.geometry import horizontal
from landerd.guidance.footprint import Footprint
from landerd.guidance.relative_state import Sight
from landerd.guidance.touchdown import MAX_CONTACT_HEIGHT_M
from landerd.messages import Landed

# A foot may be down with the lowest one so high by what is seen, m: what a builder measures gear
# and camera to, 2 cm each. Else a vehicle that stood on one foot climbed away: its pad seemed to
# slide.
BUILD_ERROR_M = 0.04
# Told to climb, only on the pad it is so slow up and down for so long, m/s and s: from sinking to
# climbing takes half of it. Feet that stand may seem to be higher than BUILD_ERROR_M on a tilted
# pad: as low over one as contact is believed, and going with it, nothing flies for so long.
RESTS_MPS = 0.1
RESTS_S, RESTS_HIGHER_S = 0.35, 1.0
# What is seen of the height tells up and down where the autopilot's climb rate is wrong; over so
# long, s, its noise of some millimetres is less than RESTS_MPS. Chosen by hand.
HEIGHT_CHANGES_S = 0.3


class Rest:
    """Watches the pad in sight for a vehicle that goes with it, as low over it as on it.

    Attributes:
        is_possible: it may rest there, for all that is known of its velocities.
    """

    def __init__(self, options: GuidanceSection, footprint: Footprint) -> None:
        self.configure(options)
        self._footprint = footprint
        self.out_of_sight()

    def configure(self, options: GuidanceSection) -> None:
        """Take changed parameters."""
        self._options = options

    def out_of_sight(self) -> None:
        """Begin anew: nothing is seen of the pad."""
        # On the pad, as far as is seen: since then, and low enough for it, s.
        self._since = self._low_since = math.inf
        self.is_possible = False
        self._height_m: float | None = None  # over the pad as seen, smoothed

    def watch(self, now: float, dt: float, sight: Sight, landed: Landed) -> None:
        """Look at the pad in a control step that sees it.

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
        # Just begun, it may not know yet how the lens errs; the autopilot knows what stands.
        is_low = relative.least_height <= BUILD_ERROR_M or landed is Landed.ON_GROUND
        changes = self._height_rate(relative.height, dt)
        up = abs(changes if sight.climb_rate_is_wrong else relative.error_rate[2])
        across = horizontal(relative.error_rate)
        rests = is_there and up < RESTS_MPS and across < o.descent.commit_slip_mps
        # The first pictures after a while without any tell little of the pad's velocity.
        self.is_possible = (
            is_there
            and up < RESTS_MPS + 2.0 * relative.sigma_heave
            and across < o.descent.commit_slip_mps + 2.0 * relative.sigma_velocity
        )
        self._since = min(self._since, now) if rests else math.inf
        self._low_since = min(self._low_since, now) if is_low and rests else math.inf

    def _height_rate(self, height: float, dt: float) -> float:
        """Return how fast the height over the pad is seen to change lately, m/s; up is positive."""
        last = height if self._height_m is None else self._height_m
        self._height_m = last + min(1.0, dt / HEIGHT_CHANGES_S) * (height - last)
        return (height - self._height_m) / HEIGHT_CHANGES_S

    def is_seen(self, now: float) -> bool:
        """Tell whether it is seen to have rested on the pad for some time, at now (s)."""
        low_s, higher_s = now - self._low_since, now - self._since
        return low_s >= RESTS_S or higher_s >= RESTS_HIGHER_S
