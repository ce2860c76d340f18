"""Landing phases (thesis Table 2.1) and where descent is allowed (thesis eq. 2.3)."""

import math

from landerd.config import DescentSection
from landerd.guidance.relative import Relative
from landerd.messages import Phase

BACK = 1.3  # a phase is left backwards only this much outside the bound it was entered at
ALIGNMENT_MARGIN_M = 0.1  # the floor kept over the alignment height, for the height's own error


def descent_radius(options: DescentSection, height: float) -> float:
    """Return delta = k1 exp(k2 z) (thesis eq. 2.3), m, for a height over the pad in m."""
    return options.k1_m * math.exp(options.k2_per_m * max(0.0, height))


def region_height(options: DescentSection, radius: float) -> float:
    """Return the height (m) over the pad at which the region is so wide (m); 0 on the ground."""
    if radius <= options.k1_m:
        return 0.0
    return math.log(radius / options.k1_m) / max(options.k2_per_m, 1e-6)


class Phases:
    """Moves from APPROACH to LANDED by distance, height and heading."""

    def __init__(self, options: DescentSection, *, has_heading: bool) -> None:
        self.configure(options)
        self._has_heading = has_heading
        self.restart()

    def configure(self, options: DescentSection) -> None:
        """Take new bounds."""
        self._options = options
        self._align = math.radians(options.align_deg)
        self._realign = math.radians(options.realign_deg)

    def restart(self) -> None:
        """Begin a landing."""
        self.phase = Phase.APPROACH
        self._aligned = not self._has_heading

    def may_descend(self, relative: Relative) -> bool:
        """Tell whether the vehicle is inside the descent region, its own uncertainty counted."""
        radius = descent_radius(self._options, relative.height)
        return relative.distance + 2.0 * relative.sigma_m < radius

    @property
    def floor_m(self) -> float:
        """Height over the pad not to go below now: the alignment height until aligned."""
        return 0.0 if self._aligned else self._options.alignment_height_m + ALIGNMENT_MARGIN_M

    def step(self, relative: Relative) -> tuple[Phase, str]:
        """Return the phase that holds from now on and why."""
        self._update_alignment(relative.heading_error)
        radius = descent_radius(self._options, relative.height)
        close = self._options.close_factor * radius
        distance = relative.distance
        if self.phase is Phase.APPROACH and distance < close:
            self.phase = Phase.CLOSE_APPROACH
        elif self.phase is not Phase.APPROACH and distance > BACK * close:
            self.phase = Phase.APPROACH
        if self.phase is Phase.CLOSE_APPROACH and self.may_descend(relative):
            self.phase = Phase.YAW_CORRECTION
        if self.phase is Phase.YAW_CORRECTION and self._aligned:
            self.phase = Phase.DESCENT
        elif self.phase is Phase.DESCENT and not self._aligned:
            self.phase = Phase.YAW_CORRECTION
        if (
            self.phase is Phase.DESCENT
            and relative.height < self._options.commit_height_m
            and self.may_descend(relative)
        ):
            self.phase = Phase.LANDED
        return self.phase, self._why(relative)

    def _update_alignment(self, heading_error: float | None) -> None:
        if not self._has_heading:
            return
        if heading_error is None:
            self._aligned = False
        else:
            self._aligned = abs(heading_error) < (self._realign if self._aligned else self._align)

    def _why(self, relative: Relative) -> str:
        if self.phase is Phase.YAW_CORRECTION and relative.heading_error is None:
            return "pad's heading not seen"
        return f"{relative.distance:.1f} m away, {relative.height:.1f} m up"
