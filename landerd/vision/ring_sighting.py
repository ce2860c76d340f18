"""What a ring's fits say, as a message: both poses, with covariances as large as the errors are."""

import math

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.messages import MarkerSighting, PoseSolution
from landerd.pad import Ring
from landerd.vision.pad_pose import MAX_RING_CHI2_ABOVE_BEST
from landerd.vision.pose import gravity_cost, mat3, vec3
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_pixels import MARGIN, edge_pixels
from landerd.vision.tone import edge_shift

# Errors that no residual shows, chosen so that the stated 95 % regions of `bench.vision_ring` hold
# about 95 % of its positions.
_EDGE_BIAS_PX = 0.004  # what the edge model leaves out, of every edge alike
_LATERAL_BIAS_PX = 0.003  # and as it differs from side to side
# What lies beyond the white margin shines into it, the more the narrower the margin is in the
# image. Measured on exact images of 20 to 30 m at 0 to 70 degrees.
_SURROUNDINGS_BIAS_PX = 0.18  # of every edge if there were no margin
_SURROUNDINGS_DECAY_PX = 0.33  # a margin wider by this lets in e times less
_TONE_BIAS = 0.2  # of what a tone curve moves edges by: no camera's is a cubic
_MIN_SIGMA_M = 1.5e-5  # nobody prints or measures a pad more truly
_OUTLINE_POINTS = 32


def ring_sighting(
    fits: list[RingFit], ring: Ring, camera: CameraModel, down: Vec3 | None
) -> MarkerSighting:
    """Return the message of a ring with its one or two fits.

    Args:
        fits: at least one.
        ring: its true size.
        camera: the lens.
        down: unit vector of gravity, camera frame: puts the pose that lies more level first where
            the image cannot tell them apart.
    """
    most = min(f.cost for f in fits) + MAX_RING_CHI2_ABOVE_BEST
    likely = [f for f in fits if f.cost <= most]
    fits = sorted(likely, key=lambda f: f.cost + gravity_cost(f.normal, down))
    pose = (fits[0].position, fits[0].normal)
    edge = edge_pixels(camera, pose, (ring.radius_m,), _OUTLINE_POINTS)[0]
    return MarkerSighting(
        kind="whycon",
        id=None,
        solutions=tuple(_solution(f, fits, ring.radius_m, camera) for f in fits),
        outline_px=tuple((x, y) for x, y in edge.tolist()),
        stage=fits[0].stage,
    )


def _solution(
    fit: RingFit, fits: list[RingFit], radius: float, camera: CameraModel
) -> PoseSolution:
    C = _covariance(fit, radius, camera.focal)
    # As far as the other pose may be the true one, the error may be the way to it.
    for other in fits:
        chance = 1.0 / (1.0 + math.exp(min(0.5 * abs(other.cost - fit.cost), 50.0)))
        way = other.position - fit.position
        C = C + chance * np.outer(way, way)
    return PoseSolution(
        position=vec3(fit.position),
        normal=vec3(fit.normal),
        north=None,
        covariance=mat3(C),
        sigma_yaw=None,
        sigma_tilt=fit.sigma_tilt,
        cost=fit.cost,
    )


def _covariance(fit: RingFit, radius: float, focal: float) -> F64:
    """Return a fit's covariance of position (3, 3), m^2, and of errors that no residual shows."""
    distance = float(np.linalg.norm(fit.position))
    sight = fit.position / distance
    # An edge error that is common to the whole outline moves the range, one that differs from
    # side to side the direction.
    bias_px = _EDGE_BIAS_PX + _SURROUNDINGS_BIAS_PX * math.exp(
        -MARGIN * focal * radius / distance * float(fit.normal @ sight) / _SURROUNDINGS_DECAY_PX
    )
    if fit.response is not None:
        bias_px += _TONE_BIAS * abs(edge_shift(fit.response, fit.blur_px**2))
    radial = bias_px * distance * distance / (focal * radius)
    lateral = _LATERAL_BIAS_PX * distance / focal
    biases = np.eye(3) * (lateral**2 + _MIN_SIGMA_M**2)
    covariance: F64 = fit.covariance + np.outer(sight, sight) * radial**2 + biases
    return covariance
