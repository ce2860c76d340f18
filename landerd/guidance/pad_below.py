"""The pad under the vehicle: its height, speed and heave, also once out of sight or touched."""

import math

from landerd.config.models import GuidanceSection
from landerd.estimation.estimator import Estimator
from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import ZERO, horizontal, sub, turned
from landerd.guidance.footprint import Footprint
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.sink_rate import LEAD_S
from landerd.guidance.slip_detector import SlipDetector

# Below this height over a pad faster than FAST_PAD_MPS a stop relative to the ground would tip the
# vehicle over (rule 1b), m.
JUST_OVER_PAD_M = 0.20
FAST_PAD_MPS = 0.5
SINKS_ON_S = 0.1  # a descent goes on for this long at least, whatever is ordered
STOPS_OVER_PAD_M = 0.10  # height at the end of a stop at which a foot of a leaning vehicle touches
# Height below which a deck's heave counts, m; higher up errors of the range look like heave. Down
# from the alignment height only, one that had heaved at 0.3 m/s for 8 s was taken to stand where,
# 1 m up, the estimate missed its reversal by 3 sigma: it was met faster than the timeout stops.
HEAVE_SEEN_M = 4.0
# A vehicle that stands and is slower than the pad was by this, m/s, has slid off, or its pad has
# braked: the pad is looked for and followed again.
LEFT_BEHIND_MPS = 1.5
# With feet on it the pad is taken to drive as it is seen to once that has differed from its known
# velocity by this, m/s, for this long, s: the touch turns the airframe faster than the lens's
# direction is known. A pad sped up to 2 m/s just before the touch, at which the filter said 2.3 m/s
# for a moment: the vehicle was kept at that for as long as the pad slid under it.
DIFFERS_MPS, DIFFERS_S = 0.25, 0.3
# With the pad out of sight for this long, s, a vehicle that has been held up for this long, s, and
# departs from the pad's known velocity by DIFFERS_MPS for this long, s, is taken to be carried: its
# pad has braked or started. Of 70 field days with a pad that did, at 1 to 3 m/s^2 and out of sight
# from just before the touch, 27 ended on their side, as the old velocity was kept. Now 2 do.
BLIND_S, HELD_S, DEPARTS_S = 0.3, 0.4, 0.15


class PadBelow:
    """Keeps what was last seen of the pad; follows its velocity while the feet are on it.

    Attributes:
        low: whether the vehicle was below the alignment height when the pad was last in sight.
        may_touch: whether it was so low then that a foot of a leaning vehicle may all but touch.
        velocity: of the pad, as last seen, or as followed from contact on, local NED, m/s.
        fastest_heave: largest vertical speed of the pad that was certain while the vehicle was
            below HEAVE_SEEN_M over it, m/s.
    """

    def __init__(
        self,
        options: GuidanceSection,
        braking_mps2: float,
        estimator: Estimator,
        footprint: Footprint,
    ) -> None:
        self.configure(options, braking_mps2)
        self._estimator = estimator
        self._footprint = footprint
        self._slip = SlipDetector()
        self._is_carried_unseen = False
        self.low = self.may_touch = False
        self._is_just_over = self._sinks_onto = False
        self.velocity = ZERO
        self._known_velocity = ZERO  # of the pad by sight before contact, turned on, m/s
        self._course_rate = 0.0  # at which that turns, rad/s
        self._differs_since = math.inf  # since when it has been seen to drive otherwise, s
        self._departs_since = math.inf  # since when the vehicle has moved otherwise, unseen, s
        self.fastest_heave = 0.0
        self._seen = 0.0, 0.0  # when the pad was last in sight, s, and its local z then, m

    def configure(self, options: GuidanceSection, braking_mps2: float) -> None:
        """Take changed parameters; braking_mps2: with which the autopilot brakes a descent."""
        self._options = options
        self._braking_mps2 = braking_mps2

    # ---- in the air ----------------------------------------------------------------------------

    def in_sight(self, now: float, down_m: float) -> None:
        """Note the pad's local z (m) in a control step with sight of it."""
        self._seen = now, down_m

    def note(self, relative: RelativeState) -> None:
        """Note height and pad's motion: what to do when sight or authority ends depends on them."""
        self.low = relative.height < self._options.descent.alignment_height_m
        sinking = max(0.0, -relative.error_rate[2])
        self.may_touch = relative.height < JUST_OVER_PAD_M
        self._is_just_over = relative.height - SINKS_ON_S * sinking < JUST_OVER_PAD_M
        stops_m = LEAD_S * sinking + sinking * sinking / (2.0 * self._braking_mps2)
        self._sinks_onto = relative.height - stops_m < STOPS_OVER_PAD_M
        self.velocity = relative.pad_velocity
        self._course_rate = relative.course_rate
        surely = abs(relative.pad_velocity[2]) - 2.0 * relative.sigma_heave
        is_near = relative.height < HEAVE_SEEN_M
        self.fastest_heave = max(self.fastest_heave, surely) if is_near else 0.0

    def leave(self) -> None:
        """Note that the vehicle has climbed away: it is not just over the pad any more."""
        self._is_just_over = self._sinks_onto = False

    @property
    def is_fast(self) -> bool:
        """Whether the pad, as last seen, is too fast to stop on."""
        return horizontal(self.velocity) > FAST_PAD_MPS

    @property
    def is_fast_and_close(self) -> bool:
        """Whether the vehicle is just over such a pad."""
        return self._is_just_over and self.is_fast

    @property
    def sinks_onto_fast(self) -> bool:
        """Whether the vehicle would touch such a pad before a stop has ended its descent."""
        return self._sinks_onto and self.is_fast

    @property
    def heaves(self) -> bool:
        """Whether the pad certainly heaved while the vehicle was below HEAVE_SEEN_M over it."""
        return self.fastest_heave > 0.0

    def heave(self, now: float) -> tuple[float, float]:
        """Return the pad's vertical velocity and its sigma, m/s.

        A deck out of sight may heave as fast as it ever did, up or down.
        """
        pad = self._pad_in_sight(now)
        return (0.0, self.fastest_heave) if pad is None else (pad.velocity[2], pad.sigma_heave)

    def _pad_in_sight(self, now: float) -> PadEstimate | None:
        pad = self._estimator.pad(now)
        is_lost = self._estimator.sight_age(now) > self._options.lost.after_s
        return None if is_lost else pad

    def down(self, now: float) -> float:
        """Return local z of the pad, m; out of sight, the lowest that it may be by now.

        A drift of the autopilot's height moves pad and vehicle alike.
        """
        t, down = self._seen
        return down + max(2.0 * self.fastest_heave, self.velocity[2]) * (now - t)

    # ---- with feet on it -----------------------------------------------------------------------

    def touch(self, now: float) -> None:
        """Begin to follow the pad at time now (s), with its velocity as known at the touch."""
        self._known_velocity = self.velocity
        self._differs_since = self._departs_since = math.inf
        self._is_carried_unseen = False
        self._slip.begin(now)

    def ride(self, now: float, dt: float, held_s: float) -> None:
        """Follow the pad: as it drove and turned when last seen, or as the vehicle it carries.

        Args:
            now: s.
            dt: since the last control step, s.
            held_s: how long something has held the vehicle up, s.
        """
        self._known_velocity = turned(self._known_velocity, self._course_rate * dt)
        self._correct_by_sight(now)
        self.look(now)
        vehicle = self._estimator.fresh_vehicle(now)
        self._note_carried_unseen(now, vehicle, held_s)
        if not self.carries:
            self.velocity = self._known_velocity
        elif vehicle is not None:  # else the last velocity stands: the known one has proved wrong
            north, east, _ = vehicle.velocity
            self.velocity = (north, east, self._known_velocity[2])

    def look(self, now: float) -> None:
        """Take the newest fix of the pad: whether it stays under the feet, and how far below."""
        fix = self._estimator.last_fix
        if fix is not None and self._slip.look(fix, self._known_velocity):
            pad = self._estimator.pad(now)
            self._footprint.see(fix.to_pad, None if pad is None else pad.heading)

    def _correct_by_sight(self, now: float) -> None:
        """Take the pad's horizontal velocity from sight where it differs from the known one."""
        pad = self._pad_in_sight(now)
        if pad is None:
            self._differs_since = math.inf
            return
        differs = horizontal(sub(pad.velocity, self._known_velocity)) > DIFFERS_MPS
        self._differs_since = min(self._differs_since, now) if differs else math.inf
        if now - self._differs_since >= DIFFERS_S:
            north, east, _ = pad.velocity
            self._known_velocity = (north, east, self._known_velocity[2])

    def _note_carried_unseen(self, now: float, vehicle: VehicleState | None, held_s: float) -> None:
        """Note whether the pad, out of sight, must have changed its velocity under the feet."""
        fix = self._estimator.last_fix
        is_seen = fix is not None and now - fix.t < BLIND_S
        if is_seen or held_s < HELD_S:
            self._departs_since, self._is_carried_unseen = math.inf, False
        elif vehicle is not None:
            off = horizontal(sub(vehicle.velocity, self._known_velocity))
            self._departs_since = min(self._departs_since, now) if off > DIFFERS_MPS else math.inf
            if now - self._departs_since >= DEPARTS_S:
                self._is_carried_unseen = True

    @property
    def rise_m(self) -> float:
        """How far the feet are seen to have risen from the pad since contact was noticed, m."""
        return self._slip.rise_m

    @property
    def carries(self) -> bool:
        """Whether the pad carries the vehicle at another velocity than the known one."""
        return self._slip.is_carried or self._is_carried_unseen

    def leaves_behind(self, now: float) -> bool:
        """Tell whether the vehicle is much slower or faster than the pad was when last seen."""
        vehicle = self._estimator.fresh_vehicle(now)
        if vehicle is None:
            return False
        return horizontal(sub(vehicle.velocity, self.velocity)) > LEFT_BEHIND_MPS
