"""Turns a ring's fits into the message that vision reports.

The covariances include errors that residuals do not show, so that they are as large as the errors
are on rendered images. Real vision and the simulation's modelled sight both use it.
"""

import math

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.messages import MarkerSighting, PoseSolution
from landerd.pad import Ring
from landerd.vision.linear import length, outer
from landerd.vision.pad_pose import MAX_RING_CHI2_ABOVE_BEST
from landerd.vision.pose import gravity_cost, mat3, vec3
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_pixels import MARGIN, edge_pixels
from landerd.vision.tone import edge_shift

# Shifts of edges by what the edge model leaves out, and residuals do not show: of all edges alike,
# and as they differ from side to side. They are chosen so that the stated 95 % regions of
# `bench.vision_ring` hold about 95 % of its positions.
_EDGE_BIAS_PX = 0.004
_LATERAL_BIAS_PX = 0.003
# What lies beyond the white margin shines into it, the more the narrower the margin is in the
# image: shift of all edges without any margin, and width of the margin that reduces it by a factor
# of e. Measured on exact images of 20 to 30 m at 0 to 70 degrees.
_SURROUNDINGS_BIAS_PX = 0.18
_SURROUNDINGS_DECAY_PX = 0.33
_TONE_BIAS = 0.2  # error of a tone curve's shift of edges, a share of it: no curve is a cubic
_MIN_SIGMA_M = 1.5e-5  # no pad is printed or measured more exactly than to this sigma
_OUTLINE_POINTS = 32  # of the outline in the message


def ring_sighting(
    fits: list[RingFit], ring: Ring, camera: CameraModel, down: Vec3 | None
) -> MarkerSighting:
    """Return the message of a ring that has one or two fits.

    Args:
        fits: at least one; those much worse than the best are left out.
        ring: its true size.
        camera: the lens.
        down: unit vector of gravity, camera frame, by which the more level pose comes first if the
            image does not distinguish them; None: unknown.
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
    """Return a fit as one of the message's solutions."""
    C = _covariance(fit, radius, camera.focal)
    # If the other pose is the true one, the error is the difference of both positions.
    for other in fits:
        chance = 1.0 / (1.0 + math.exp(min(0.5 * abs(other.cost - fit.cost), 50.0)))
        way = other.position - fit.position
        C = C + chance * outer(way, way)
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
    """Return the covariance of a fit's position (3, 3), m^2, with errors residuals do not show."""
    distance = length(fit.position)
    sight = fit.position / distance
    # A shift of the whole outline inwards or outwards changes the range; one that differs from side
    # to side, the direction.
    bias_px = _EDGE_BIAS_PX + _SURROUNDINGS_BIAS_PX * math.exp(
        -MARGIN * focal * radius / distance * float(fit.normal @ sight) / _SURROUNDINGS_DECAY_PX
    )
    if fit.response is not None:
        bias_px += _TONE_BIAS * abs(edge_shift(fit.response, fit.blur_px**2))
    radial = bias_px * distance * distance / (focal * radius)
    lateral = _LATERAL_BIAS_PX * distance / focal
    biases = np.eye(3) * (lateral**2 + _MIN_SIGMA_M**2)
    covariance: F64 = fit.covariance + outer(sight, sight) * radial**2 + biases
    return covariance
