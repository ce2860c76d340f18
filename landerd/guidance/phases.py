"""Landing phases (thesis Table 2.1) and where descent is allowed (thesis eq. 2.3)."""

import math

from landerd.config.models import DescentSection
from landerd.geometry import Vec3, angle_between, clamp, towards, unit
from landerd.guidance import pilot_texts
from landerd.guidance.footprint import MAX_LEAN
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.touchdown import CONTACT_S, MAX_BLIND_S
from landerd.messages import Phase

# Chosen by trial in the simulator where nothing else is said: with them every row of `landerd
# campaign guidance` reaches what is asked of it.
PHASE_HYSTERESIS = 1.3  # back to APPROACH at this many times the bound of CLOSE_APPROACH
COMMITTED_SINK_RATE_MPS = 0.4  # assumed for the time to touch-down; it is between 0.3 and 0.6
# Sight may end at commit. Its age then, the descent at this rate and the time to notice contact
# together stay within touchdown.MAX_BLIND_S. A slower descent needs sight to the end.
BUDGET_SINK_RATE_MPS = 0.3
ALIGNMENT_MARGIN_M = 0.1  # from the alignment height to the floor above it, for height errors
MAX_EXPONENT = 20.0  # of the descent region: a height of kilometres, as after a jump, overflows
# A go-around begins below the commit height, at more than this many radii of the region from the
# landing point, or below this share of the commit height and still not fit to commit.
GO_AROUND_RADII = 1.5
GO_AROUND_HEIGHT_SHARE = 0.5
# A vehicle on its way out of the descent region stops its descent this long before it is out, s: by
# the age of sight and the time to answer. A gust carried one out that descended on at 0.4 m/s.
LEAVES_S = 0.2
# A vehicle that climbs from the pad faster than this, m/s (more than noise), does not commit: by
# the time that it descends again it is half a metre higher, where region, heading and sight bind.
MAX_CLIMB_MPS = 0.1
MIN_DISTANCE_M = 0.01  # nearer to the landing point "outward" has no direction
# Time constant of the airframe's lean, s, so that gusts pass; and by how much, rad, a lean against
# the plate that was too large must fall below its bound before landing. A lean that grows steadily
# is known without lag: over a truck that sped up by 1 m/s2 to 10 m/s the mean was 5 degrees short,
# and 6 of 23 vehicles touched leaning 27 to 30 degrees and slid off. The plate's own tilt is not
# smoothed: with both, a vehicle that leaned by 12 degrees touched a plate that somebody had tilted
# by 24 degrees 1.3 s before, slid off it at 1.4 m/s and was thrown over by 61 degrees.
LEAN_S, UPRIGHT = 2.0, math.radians(1.0)
# A vehicle that leans too far waits for a lull at this height over the pad, m. At 0.1 m a foot was
# 3 cm into the plate before the lean was known, at 0.05 m the vehicle landed leaning 33 degrees. At
# 2 m a lull was over before the vehicle was down: of 31 windy days of the field world 22 ended in a
# landing from here, and 19 from there. The lean counts from LEANS_FROM_M down.
LULL_HEIGHT_M, LEANS_FROM_M = 0.8, 4.0
# Gusts may keep a vehicle out of the region for most of the time. After WIDENS_AFTER_S in DESCENT
# with a sink rate below WAITS_MPS the region widens, over WIDENS_S, to
# guidance.descent.widest_k1_m. With 0.12 m on the ground throughout, 2 of 115 days of the field
# world did not land in 90 s; with 0.16 from the start all did, but the median error rose from 3.9
# to 4.3 cm; with 0.2 after waiting, which is more than may be committed with, feet touched too
# soon.
WIDENS_AFTER_S, WIDENS_S = 5.0, 10.0
WAITS_MPS = 0.1
# At the alignment height, without the pad's heading, it climbs after HIGHER_AFTER_S: there a narrow
# lens has no marker but the ring in its picture. The factor on that height grows by HIGHER_PER_S
# each second up to MOST_HIGHER, until the vehicle is aligned. Of 12 days of the field world with a
# lens of 32 degrees two ended in "pad's heading not seen", or came to the ground a minute late.
HIGHER_AFTER_S, HIGHER_PER_S, MOST_HIGHER = 3.0, 0.25, 3.0
AT_WAIT_HEIGHT_M = 0.5  # above it


def descent_radius(options: DescentSection, height: float) -> float:
    """Return delta = k1 exp(k2 z) (thesis eq. 2.3), m, for a height over the pad in m."""
    return options.k1_m * math.exp(min(options.k2_per_m * max(0.0, height), MAX_EXPONENT))


def most_widening(options: DescentSection) -> float:
    """Return the largest factor on the region's radius after waiting."""
    return max(1.0, options.widest_k1_m / options.k1_m)


def region_height(options: DescentSection, radius: float) -> float:
    """Return the height over the pad at which the region has a radius, both in m; 0: the ground."""
    if radius <= options.k1_m:
        return 0.0
    return math.log(radius / options.k1_m) / max(options.k2_per_m, 1e-6)


class Phases:
    """Moves from APPROACH to LANDED (which means committed) by distance, height and heading.

    Attributes:
        phase: the current one.
        leans: the vehicle leans too far, against wind, to touch the pad.
        goes_around: it was low over the pad, unfit to land, and climbs to try again.
        widening: factor on the descent region's radius, more than 1 after waiting.
    """

    def __init__(
        self, options: DescentSection, *, has_heading: bool, most_lean: float = MAX_LEAN
    ) -> None:
        """Make them for a landing that has not begun.

        Args:
            options: bounds.
            has_heading: the pad has a heading, and the vehicle must be aligned with it.
            most_lean: largest lean from how it would stand on the pad with which it may touch, rad.
        """
        self.configure(options, most_lean)
        self._has_heading = has_heading
        self.restart()

    def configure(self, options: DescentSection, most_lean: float) -> None:
        """Take new bounds; most_lean in rad."""
        self._options = options
        self._most_lean = most_lean
        self._most_widening = most_widening(options)
        self._touchdown_s = options.commit_height_m / COMMITTED_SINK_RATE_MPS
        self._align = math.radians(options.align_deg)
        self._realign = math.radians(options.realign_deg)

    def restart(self) -> None:
        """Begin a landing."""
        self.phase = Phase.APPROACH
        self._aligned = not self._has_heading
        self._heading_known = True  # or not needed
        self._may_land = True  # as told in the last step
        # The airframe's down axis, smoothed, and the same smoothed again, local.
        self._down: Vec3 | None = None
        self._lagging: Vec3 | None = None
        self._lean = 0.0  # of that axis from how it would stand on the pad, rad
        self.leans = False
        self.goes_around = False
        self._unfit = ""  # why it goes around, for the pilot; "": because it is off
        self._waited_s = 0.0  # in DESCENT
        # At the height to wait at, without the pad's heading, since it was aligned last.
        self._headless_s = 0.0
        self.widening = 1.0

    def _radius(self, height: float) -> float:
        return self.widening * descent_radius(self._options, height)

    def may_descend(self, relative: RelativeState, off_m: float = 0.0) -> bool:
        """Tell whether it is inside the descent region with 2 sigma, and not leaving it.

        Args:
            relative: pad relative to vehicle.
            off_m: distance of the newest sighting from the estimate, m: the pad may have jumped.
        """
        return self.farthest_m(relative, off_m) < self.radius_m(relative)

    def farthest_m(self, relative: RelativeState, off_m: float = 0.0) -> float:
        """Return how far from the landing point it may be in a moment; arguments as above, m."""
        (north, east, _), (v_north, v_east, _) = relative.error, relative.error_rate
        distance = relative.distance
        outward = (north * v_north + east * v_east) / max(distance, MIN_DISTANCE_M)
        leaves = LEAVES_S * max(0.0, outward - 2.0 * relative.sigma_velocity)
        return distance + off_m + leaves + 2.0 * relative.sigma_m

    def radius_m(self, relative: RelativeState) -> float:
        """Return the descent region's radius where the vehicle is, m."""
        return self._radius(relative.least_height)

    @property
    def floor_m(self) -> float:
        """Height over the pad not to go below now, m: the alignment height until aligned."""
        if self.goes_around and self._heading_known and not self.leans:
            return self._options.retry_height_m
        may_land = self._aligned and not self.leans
        return 0.0 if may_land else self._wait_height_m + ALIGNMENT_MARGIN_M

    @property
    def _wait_height_m(self) -> float:
        """Height over the pad to wait at, m: until the heading is right, or leaning, for a lull."""
        higher = 1.0 + HIGHER_PER_S * max(0.0, self._headless_s - HIGHER_AFTER_S)
        alignment_m = min(higher, MOST_HIGHER) * self._options.alignment_height_m
        if not self.leans:
            return alignment_m
        turns = not (self._aligned and self._heading_known)
        return max(LULL_HEIGHT_M, alignment_m if turns else 0.0)

    def watch(self, down: Vec3, relative: RelativeState, dt: float) -> None:
        """Update, in each control step before `step`, the lean and the time spent waiting.

        Args:
            down: the airframe's down axis, local.
            relative: pad relative to the vehicle.
            dt: since the last step, s.
        """
        if self.phase is Phase.DESCENT and -relative.error_rate[2] < WAITS_MPS:
            self._waited_s += dt
        if self._aligned:
            self._headless_s = 0.0
        elif self._waits_for_heading(relative.height):
            self._headless_s += dt
        k = clamp((self._waited_s - WIDENS_AFTER_S) / WIDENS_S, 0.0, 1.0)
        self.widening = 1.0 + k * (self._most_widening - 1.0)
        k = min(1.0, dt / LEAN_S)
        self._down = towards(self._down or down, down, k)
        self._lagging = towards(self._lagging or down, self._down, k)
        # Both lag a steady change by LEAN_S, the one behind the other.
        unlagged = unit(towards(self._lagging, self._down, 2.0))
        self._lean = angle_between(unlagged, relative.normal)
        leans = self._lean > self._most_lean - (UPRIGHT if self.leans else 0.0)
        # Higher up the lean may be that of braking.
        self.leans = leans and relative.height < LEANS_FROM_M

    def _waits_for_heading(self, height: float) -> bool:
        """Tell whether it waits over the pad, as low as it may, for the heading to be seen."""
        is_down = height < self._wait_height_m + AT_WAIT_HEIGHT_M
        is_wanted = self._may_land and not self._heading_known
        return is_wanted and is_down and self.phase is Phase.YAW_CORRECTION

    def step(
        self,
        relative: RelativeState,
        sighting_age: float = 0.0,
        *,
        may_land: bool = True,
        arrives: bool = False,
    ) -> tuple[Phase, str]:
        """Return the phase that is in force from now on, and why.

        Args:
            relative: pad relative to the vehicle.
            sighting_age: since the exposure of the last accepted sighting, s.
            may_land: False: the pilot asks to hold; no phase beyond YAW_CORRECTION.
            arrives: it will stand on the plate before a climb takes effect, however far off.
        """
        self._may_land = may_land
        self._update_alignment(relative.heading_error)
        self._move_on(relative, may_land=may_land)
        is_low = relative.height < self._options.commit_height_m
        unfit = self._why_unfit(relative, sighting_age, arrives=arrives) if is_low else ""
        if self._commits(relative) and not unfit:
            self.phase = Phase.LANDED
        else:
            self._decide_go_around(relative, unfit)
        return self.phase, self._why(relative)

    def _move_on(self, relative: RelativeState, *, may_land: bool) -> None:
        """Step through the phases up to DESCENT; several may be passed in one control step."""
        close = self._options.close_factor * descent_radius(self._options, relative.height)
        distance = relative.distance
        if self.phase is Phase.APPROACH and distance < close:
            self.phase = Phase.CLOSE_APPROACH
        elif self.phase is not Phase.APPROACH and distance > PHASE_HYSTERESIS * close:
            self.phase = Phase.APPROACH
        if self.phase is Phase.CLOSE_APPROACH and self.may_descend(relative):
            self.phase = Phase.YAW_CORRECTION
        descends = self._aligned and may_land and not self.leans
        if self.phase is Phase.YAW_CORRECTION and descends:
            self.phase = Phase.DESCENT
        elif self.phase is Phase.DESCENT and not descends:
            self.phase = Phase.YAW_CORRECTION

    def _commits(self, relative: RelativeState) -> bool:
        return (
            self.phase is Phase.DESCENT
            and relative.height < self._options.commit_height_m
            and not self.goes_around
            and relative.error_rate[2] < MAX_CLIMB_MPS
        )

    def is_blind(self, relative: RelativeState, sighting_age: float) -> bool:
        """Tell whether it is below the commit height with sight (of this age, s) too old for it."""
        if relative.height >= self._options.commit_height_m:
            return False
        blind_s = sighting_age + relative.height / BUDGET_SINK_RATE_MPS + CONTACT_S
        return blind_s >= MAX_BLIND_S

    def _why_unfit(self, relative: RelativeState, sighting_age: float, *, arrives: bool) -> str:
        """Return why it is not fit to commit, for the pilot; "" where it is.

        Either sight is too old, or the predicted error or speed at touch-down is out of bounds.
        """
        o = self._options
        (north, east, _), (v_north, v_east, v_down) = relative.error, relative.error_rate
        if self.is_blind(relative, sighting_age):
            return pilot_texts.OLD_SIGHT_CLIMBING
        slip = math.hypot(v_north, v_east)
        if not slip < o.commit_slip_mps:
            return pilot_texts.SLIDES_CLIMBING.format(speed=slip)
        if not -v_down < o.commit_sink_mps:
            return pilot_texts.SINKS_CLIMBING.format(speed=-v_down)
        t = self._touchdown_s
        off = math.hypot(north + t * v_north, east + t * v_east) + 2.0 * relative.sigma_m
        if not (off < o.commit_miss_m or arrives):
            return pilot_texts.MAY_MISS_CLIMBING.format(distance=off)
        return ""

    def _decide_go_around(self, relative: RelativeState, unfit: str) -> None:
        """Begin or end a go-around: just over the pad, what cannot land must not wait."""
        o = self._options
        if self.goes_around:
            self.goes_around = relative.height < self.floor_m
        elif not self._heading_known or self.leans:
            # From higher up the camera sees all markers; the low foot of a leaning vehicle is
            # clear.
            self.goes_around = relative.height < self._wait_height_m
            self._unfit = ""
        elif relative.height < o.commit_height_m:
            outside = relative.distance > GO_AROUND_RADII * self._radius(relative.height)
            too_low = relative.height < GO_AROUND_HEIGHT_SHARE * o.commit_height_m
            self.goes_around = outside or too_low
            self._unfit = "" if outside else unfit

    def _update_alignment(self, heading_error: float | None) -> None:
        if not self._has_heading:
            return
        self._heading_known = heading_error is not None
        if heading_error is None:
            self._aligned = False
        else:
            self._aligned = abs(heading_error) < (self._realign if self._aligned else self._align)

    def _why(self, relative: RelativeState) -> str:
        if self.leans and self.phase is Phase.YAW_CORRECTION:
            return pilot_texts.LEANS.format(lean=math.degrees(self._lean))
        if self.goes_around and not self._heading_known:
            return pilot_texts.NO_HEADING_CLIMBING
        if self.phase is Phase.YAW_CORRECTION and not self._heading_known:
            return pilot_texts.NO_HEADING
        if self.goes_around:
            off = pilot_texts.OFF_CLIMBING.format(distance=relative.distance)
            return self._unfit or off
        error = relative.heading_error
        if self.phase is Phase.YAW_CORRECTION and error is not None and not self._aligned:
            return pilot_texts.TURNING.format(error=abs(math.degrees(error)))
        known, radius = 2.0 * relative.sigma_m, self.radius_m(relative)
        if relative.distance < radius < known:
            return pilot_texts.UNSURE.format(known=known, radius=radius)
        height = round(relative.height, 1) + 0.0  # not -0.0
        return pilot_texts.UNDER_WAY.format(distance=relative.distance, height=height)
