"""How a pad's markers may differ from the pad file, and what is learned about that in flight.

The error of a marker is seven numbers: its displacement from its place (m, pad frame, three), the
rotation of its plane against that at the landing point (rotation vector, rad, pad frame, three),
and by what share it is larger than the pad file says (one). The pad file states how large these may
be. Pictures that show two markers tell how these lie relative to one another; this is remembered
for pictures that show only one. `pad_pose` estimates the errors together with the pad's pose.
"""

import math

import numpy as np

from landerd.camera_model import F64
from landerd.pad import Marker, PadLayout, size_m
from landerd.vision.linear import inverse, solved

ERRORS = 7  # numbers for each marker
TILT, SCALE = slice(3, 6), 6  # indices of rotation and size among them
# Tilt of a marker that covers the landing point against the plane there, 1 sigma, rad.
_SAME_PLANE_SIGMA = math.radians(0.1)
# Size error of one marker against the others, as a share of the print's size error: a pad comes
# from one printer, so that its markers err mostly alike.
_OWN_SCALE = 0.5
# Time constant with which what was learned is forgotten, s. Nothing about a pad changes in flight,
# but errors that are taken for noise (of a lens slightly off its calibration, say) are the same in
# many frames.
_FORGET_S = 60.0
LEARN_EVERY_S = 0.2  # saves time: what is learned changes slowly
# Share of a frame's information that is learned, for the reason given at _FORGET_S.
LEARNED_SHARE = 0.5


class MarkerErrors:
    """The errors of all n markers of a pad: mean (7 n,) and covariance (7 n, 7 n).

    Attributes:
        scale_sigma: share by which all markers together may be too large, 1 sigma.
        focal_sigma: share by which the focal length may be longer than calibrated, 1 sigma. No
            picture shows either of these two.
    """

    def __init__(self, layout: PadLayout, focal_sigma: float) -> None:
        """Begin with the uncertainties that the pad file states."""
        self.focal_sigma = focal_sigma
        self.scale_sigma = layout.print_scale_sigma
        count = len(layout.markers)
        self._first = np.zeros((ERRORS * count, ERRORS * count))
        for i, marker in enumerate(layout.markers):
            at = slice(ERRORS * i, ERRORS * (i + 1))
            self._first[at, at] = np.diag(_variances(marker, layout))
        self._mean = np.zeros(ERRORS * count)
        self._covariance = self._first.copy()
        self._known: dict[tuple[int, ...], tuple[F64, F64]] = {}  # cache of `of`
        self._t: float | None = None  # time of the last frame that was learned from, s

    def of(self, markers: list[int]) -> tuple[F64, F64]:
        """Return mean (7 k,) and information (7 k, 7 k) for k markers, given by index."""
        found = self._known.get(tuple(markers))
        if found is None:
            at = _places(markers)
            found = self._mean[at], inverse(_block(self._covariance, at))
            self._known[tuple(markers)] = found
        return found

    def first(self, markers: list[int]) -> F64:
        """Return the covariance (7 k, 7 k) of k markers according to the pad file alone."""
        at = _places(markers)
        return _block(self._first, at)

    def is_due(self, t: float) -> bool:
        """Tell whether it is time to learn from a frame of time t (s) again."""
        return self._t is None or not 0.0 <= t - self._t < LEARN_EVERY_S

    def learn(self, t: float, markers: list[int], mean: F64, covariance: F64) -> None:
        """Take the errors of some markers as a frame shows them; correlated ones are updated too.

        Args:
            t: of the exposure, s.
            markers: indices of k markers.
            mean: of their errors, (7 k,).
            covariance: of their errors, (7 k, 7 k), what was known before included.
        """
        self._forget(t)
        self._known.clear()
        at = _places(markers)
        known = _block(self._covariance, at)
        gain = solved(known, self._covariance[at]).T
        self._mean = self._mean + gain @ (mean - self._mean[at])
        changed = self._covariance + gain @ (covariance - known) @ gain.T
        self._covariance = 0.5 * (changed + changed.T)

    def _forget(self, t: float) -> None:
        past = 0.0 if self._t is None else max(0.0, t - self._t)
        self._t = t
        kept = math.exp(-past / _FORGET_S)
        self._mean = kept * self._mean
        self._covariance = self._first + kept * (self._covariance - self._first)


def _places(markers: list[int]) -> list[int]:
    return [ERRORS * m + k for m in markers for k in range(ERRORS)]


def _block(matrix: F64, at: list[int]) -> F64:
    """Return rows and columns of a matrix, in a third of the time of `np.ix_`."""
    return matrix[at].take(at, axis=1)


def _variances(marker: Marker, layout: PadLayout) -> list[float]:
    """Return the variances (7,) of a marker's errors.

    A plate that bends somewhere between landing point and marker turns the marker by an angle, and
    lifts it, on average, by half of that angle times the distance.
    """
    place, flat = layout.placement_sigma_m, math.radians(layout.flatness_deg)
    size = size_m(marker)
    distance = math.hypot(*marker.position_m)
    is_beside = distance > 0.5 * size
    lifted = math.hypot(place, 0.5 * distance * flat) if is_beside else place
    tilt = max(flat, _SAME_PLANE_SIGMA) if is_beside else _SAME_PLANE_SIGMA
    # A marker that was placed by its edges is turned by the error of their ends over its size.
    heading = max(min(place / size, flat), _SAME_PLANE_SIGMA)
    sigmas = (place, place, lifted, tilt, tilt, heading, _OWN_SCALE * layout.print_scale_sigma)
    return [max(s, 1e-6) ** 2 for s in sigmas]
