"""The output `landing_target`: the pad for the autopilot's own precision landing."""

from collections.abc import Sequence

from landerd.estimation.estimator import Estimator
from landerd.estimation.observation import PadObservation
from landerd.geometry import norm, rot_zyx, rotate, sub, transpose
from landerd.messages import LandingTarget


def landing_target(estimator: Estimator, seen: Sequence[PadObservation]) -> LandingTarget | None:
    """Return one frame's sighting in the body frame; None where a history does not reach.

    The autopilot has a filter of its own, so it gets the measurement and not the estimate; the
    estimate only decides between a frame's two pose solutions. The angles of gimbal and airframe at
    exposure are accounted for.
    """
    estimate = estimator.pad(estimator.sighting_t)
    if estimate is None:
        return None
    pad = min(seen, key=lambda s: norm(sub(s.position, estimate.position)))
    poses = estimator.poses
    position, attitude = poses.position.at(pad.t), poses.attitude.at(pad.t)
    if position is None or attitude is None:
        return None
    roll, pitch, yaw = attitude[:3]
    arm = sub(pad.position, (position[0], position[1], position[2]))
    return LandingTarget(pad.t, rotate(transpose(rot_zyx(yaw, pitch, roll)), arm))
