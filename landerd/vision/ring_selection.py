"""Which fits are of the ring: to its grey levels, behind a camera's response, or to its edges.

Each is tried if the one before does not explain the ring. `ring_search` and `whycon.track_ring` use
this for a fit that `ring_checks` has not ruled out.
"""

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import EDGES
from landerd.pad import Ring
from landerd.vision.arrays import U8
from landerd.vision.edge_profile import medians
from landerd.vision.patch import levels_at
from landerd.vision.pose import circle, px_per_m, rotation_from
from landerd.vision.ring_checks import is_dark_in_white, is_poor, is_ring, may_be_behind
from landerd.vision.ring_edges import rise_within
from landerd.vision.ring_explained import Vouches, edges_contradict, explained, is_toned
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_fit_stages import response_fits
from landerd.vision.ring_response import CameraResponse

# Circles within the stroke on which a target of several rings shows, as shares of its width.
_CIRCLES: F64 = np.linspace(0.1, 0.9, 16)
# Points on each; width below which a stroke is all edge, px; and largest height of a brighter
# circle over the others, a share of the contrast: of 1675 true rings in all kinds of light none had
# more than 0.09.
_CIRCLE_POINTS, _LEAST_STROKE_PX, _MOST_RISE = 24, 6.0, 0.2

# Up to this share of the noise the coherent residual of a plain fit is noise itself: in even light
# it is 0.4 at most, on rings with a weak spot of glare 0.6 and more. What light that is uneven
# about the ring does to a fit, residuals do not tell: the fit has followed it.
_EVEN_SHARE = 0.5


def is_ours(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> bool:
    """Tell whether a fit is of a ring and, if it leaves much unexplained, of no other target."""
    if not is_ring(fit, ring, camera) or _has_rings_within(image, camera, ring, fit):
        return False
    # Motion, responses and clipped white explain much, a target of several rings too.
    is_plain = fit.response is None and fit.is_told is None and not fit.motion_px.any()
    is_doubtful = not is_plain or is_poor(fit)
    return not (is_doubtful and edges_contradict(image, camera, ring, fit))


def _has_rings_within(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> bool:
    """Tell whether brighter circles lie in the stroke, away from the edges that are fitted.

    Something that lies across the stroke is no circle: levels are taken relative to the mean of
    their ray, and each circle counts by its median.
    """
    width = ring.radius_m * (1.0 - ring.inner_ratio)
    if width * px_per_m(camera, fit.position, fit.normal) < _LEAST_STROKE_PX:
        return False
    axes = rotation_from(fit.normal)[:, :2]
    radii = ring.radius_m * ring.inner_ratio + width * _CIRCLES
    points = (radii[:, None, None] * circle(1.0, _CIRCLE_POINTS)).reshape(-1, 2)
    levels = levels_at(image, camera, fit.position + points @ axes.T).reshape(-1, _CIRCLE_POINTS)
    levels = levels[:, ~np.isnan(levels).any(axis=0)]
    if not levels.size:
        return False
    level = medians(levels - levels.mean(axis=0))
    return rise_within(level) > _MOST_RISE * fit.contrast


def explained_fits(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    fits: list[RingFit],
    vouches: Vouches | None = None,
    *,
    are_full: bool = False,
) -> list[RingFit]:
    """Return the fits that explain what may be a ring; empty: it is none.

    Those given, or if they do not explain it, fits behind a response or to edges. So they are if
    light is uneven, which only full fits (`are_full`) tell: what tracked ones leave over is partly
    the ground beyond a small ring's plate.
    """
    fit = fits[0]
    is_told = is_ring(fit, ring, camera)
    is_plain = is_told and not is_toned(fit, ring)
    if (is_plain and not (are_full and _is_uneven(fit))) or not (is_told or is_dark_in_white(fit)):
        return fits if is_told else []
    behind_response = [] if is_plain else fits_behind_response(image, camera, ring, fit)
    if behind_response:
        return behind_response
    by_edges = explained(image, camera, ring, fits, vouches)
    if by_edges is not None:
        return by_edges.fits
    return fits if is_told else []


def _is_uneven(fit: RingFit) -> bool:
    """Tell whether a plain fit has followed uneven light; one behind a response is inflated."""
    return fit.response is None and fit.coherent * fit.contrast > _EVEN_SHARE * fit.noise


def fits_behind_response(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> list[RingFit]:
    """Return the fits behind a response that explain what a plain fit does not; empty: none."""
    if not may_be_behind(fit):
        return []
    fits = response_fits(image, camera, ring, fit)
    explains = fits and is_ours(image, camera, ring, fits[0]) and not is_toned(fits[0], ring)
    return fits if explains else []


def remember(response: CameraResponse, fit: RingFit) -> None:
    """Let the camera's response learn from an accepted fit."""
    # Beside clipped white rings are tracked by their edges.
    if fit.stage == EDGES or fit.is_told is not None:
        response.learn_edges()
    elif not fit.motion_px.any():
        response.learn(fit.response, fit.response_chi2)
