"""The direction for the camera: to which point of the pad, and where that will be."""

import math
from collections.abc import Sequence

from landerd.config.models import AimSection
from landerd.estimation.camera_pose import PoseHistory
from landerd.estimation.estimator import Estimator
from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import Vec3, add, dot, norm, rotate, scale, sub, transpose, unit
from landerd.pad import Marker, PadLayout, Ring, size_m

# Largest angle between markers, rad, at which they count as in one picture: chosen by hand for the
# thesis's camera (78 by 63 degrees), with room for a gimbal that lags.
MAX_GROUP_ANGLE = math.radians(50.0)
# The camera stays on what may be a pad for this long after its last sighting, s: until a slow
# computer has searched the pictures with it in the centre.
GLANCE_S = 1.0
MIN_RANGE_M = 0.05  # nearer than this the pad has no direction
# Nearer than this, m, the lens does not lead by the pad's vertical velocity. Where pictures are
# stamped late, the lens's turning looks like just that: 80 ms late, over a tag seen at a flat angle
# they swung each other up to 1.3 m/s, and a vehicle climbed away that stood on the pad.
NEAR_M = 1.0


class LookDirection:
    """Keeps as many of the pad's markers in the picture as fit.

    Near the pad first the rings are given up, then all but the smallest marker.
    """

    def __init__(self, layout: PadLayout) -> None:
        telling: list[Marker] = [m for m in layout.markers if not isinstance(m, Ring)]
        telling = telling or list(layout.markers)
        groups = [layout.markers, telling, [min(telling, key=size_m)]]
        self._groups = [_corners(group) for group in groups]

    def ahead(self, estimator: Estimator, now: float, options: AimSection) -> Vec3 | None:
        """Return the direction (as of `direction`) for the gimbal's lead time; None: search.

        Args:
            estimator: where vehicle and pad are.
            now: s.
            options: the gimbal's lead, and how long a pad out of sight is remembered.
        """
        # Stale data would turn the lens away from a pad that is still in the picture.
        if not estimator.has_fresh_vehicle(now):
            return None
        remembered = now - estimator.sighting_t < options.search_after_s
        pad = estimator.pad(now) if remembered else None
        if pad is None:
            maybe = estimator.unconfirmed(now, GLANCE_S)
            pad = None if _flies_away(estimator.vehicle(now), maybe) else maybe
        return None if pad is None else self.direction(estimator.poses, pad, options.lead_s)

    def direction(self, poses: PoseHistory, pad: PadEstimate, lead_s: float) -> Vec3 | None:
        """Return the direction to look in, a unit vector in the gimbal's base frame.

        Args:
            poses: where vehicle and gimbal are.
            pad: now.
            lead_s: until the gimbal will have turned, s.

        Returns:
            None without position or attitude, or nearer than MIN_RANGE_M.
        """
        base = poses.gimbal_base(poses.attitude.age(pad.t) + lead_s)
        if base is None:
            return None
        pivot, R_local_base = base
        north, east, down = pad.velocity
        is_near = norm(sub(pad.position, pivot)) < NEAR_M
        velocity = (north, east, 0.0 if is_near else down)
        to_pad = sub(add(pad.position, scale(velocity, lead_s)), pivot)
        look = to_pad if pad.heading is None else self._look(to_pad, pad.heading)
        if dot(look, look) < MIN_RANGE_M * MIN_RANGE_M:
            return None
        return rotate(transpose(R_local_base), unit(look))

    def _look(self, to_pad: Vec3, heading: float) -> Vec3:
        """Return the vector to the centre of the largest group of markers that fits the picture.

        Args:
            to_pad: from the gimbal's pivot to the landing point, local, m.
            heading: of the pad, local, rad.
        """
        x, y, z = to_pad
        c, s = math.cos(heading), math.sin(heading)
        middle = to_pad
        for corners in self._groups:
            rays = [unit((x + c * n - s * e, y + s * n + c * e, z)) for n, e in corners]
            # Cosines of the rectangle's diagonals: the wider one counts.
            first, second = dot(rays[0], rays[2]), dot(rays[1], rays[3])
            middle = add(rays[0], rays[2]) if first <= second else add(rays[1], rays[3])
            if min(first, second) > math.cos(MAX_GROUP_ANGLE):
                break
        return scale(middle, 0.5)


def _flies_away(vehicle: VehicleState | None, pad: PadEstimate | None) -> bool:
    """Tell whether the vehicle flies away from what may be a pad: pilots fly towards theirs.

    Other boards, passed on the way and refused again and again, kept the camera turned back while
    the pad ahead came and went.
    """
    if pad is None or vehicle is None or vehicle.course is None:
        return False
    north, east, _ = sub(pad.position, vehicle.feet)
    return north * vehicle.velocity[0] + east * vehicle.velocity[1] < 0.0


def _corners(markers: Sequence[Marker]) -> list[tuple[float, float]]:
    """Return the corners of the rectangle around markers, north and east of the pad's, m."""
    north, east = [], []
    for m in markers:
        (x, y), half = m.position_m, 0.5 * size_m(m)
        north += [x - half, x + half]
        east += [y - half, y + half]
    n, s, e, w = max(north), min(north), max(east), min(east)
    return [(n, e), (n, w), (s, w), (s, e)]
