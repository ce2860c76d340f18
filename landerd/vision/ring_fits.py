"""Which fits are of a ring in an image: to its grey levels, behind a response, or to its edges."""

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel
from landerd.messages import EDGES
from landerd.pad import Ring
from landerd.vision.ring_explained import Vouches, edges_contradict, explained, is_toned
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_response import CameraResponse
from landerd.vision.ring_stages import (
    is_dark_in_white,
    is_poor,
    is_ring,
    may_be_behind,
    response_fits,
)

U8 = NDArray[np.uint8]


def is_ours(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> bool:
    """Tell whether a fit is of a ring and, where it leaves something over, of no other target."""
    if not is_ring(fit, ring, camera):
        return False
    # Motion and responses explain much, a target of several rings too.
    is_plain = fit.response is None and not np.any(fit.motion_px)
    is_doubtful = not is_plain or is_poor(fit)
    return not (is_doubtful and edges_contradict(image, camera, ring, fit))


def explained_fits(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    fits: list[RingFit],
    vouches: Vouches | None = None,
) -> list[RingFit]:
    """Return the fits of what may be a ring, others where a curve or foreign things hide it.

    Empty, if it is none.
    """
    fit = fits[0]
    is_told = is_ring(fit, ring, camera)
    if (is_told and not is_toned(fit, ring)) or not (is_told or is_dark_in_white(fit)):
        return fits if is_told else []
    behind_response = fits_behind_response(image, camera, ring, fit)
    if behind_response:
        return behind_response
    by_edges = explained(image, camera, ring, fits, vouches)
    if by_edges is not None:
        return by_edges.fits
    return fits if is_told else []


def fits_behind_response(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> list[RingFit]:
    """Return the fits behind a response that explain what a plain fit does not; empty: none."""
    if not may_be_behind(fit):
        return []
    fits = response_fits(image, camera, ring, fit)
    explains = fits and is_ours(image, camera, ring, fits[0]) and not is_toned(fits[0], ring)
    return fits if explains else []


def remember(response: CameraResponse, fit: RingFit) -> None:
    """Remember the curve of a fit that could show one."""
    if fit.stage == EDGES:
        response.learn_edges()
    elif not np.any(fit.motion_px):
        response.learn(fit.response, fit.response_chi2)
