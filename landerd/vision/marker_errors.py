"""How the markers of a pad may really be against its file, and what is learned of it.

A marker errs by seven numbers: it lies beside its place (m, pad frame, three), on a plane turned
against the one at the landing point (rotation vector, rad, pad frame, three), and is larger than
its file says (a share). The pad file states how large these are; pictures that show two markers
tell how they lie to one another, which is remembered for those that show one.
"""

import math

import numpy as np

from landerd.camera_model import F64
from landerd.pad import Marker, PadLayout, size_m
from landerd.vision.linear import inverse, solved

ERRORS = 7  # numbers a marker
TILT, SCALE = slice(3, 6), 6  # places among them
_SAME_PLANE_SIGMA = math.radians(0.1)  # tilt of a marker on the landing point against it
# A pad comes from one printer: its markers err alike, and one against another by this much of it.
_OWN_SCALE = 0.5
# How soon what was learned is forgotten, s: nothing about a pad changes in flight, but what is
# taken for noise (a lens a little off its calibration) is not new in every frame.
_FORGET_S = 60.0
LEARN_EVERY_S = 0.2  # saves time: what is learned changes slowly
# Share of a frame's information that is learned; for the same reason.
LEARNED_SHARE = 0.5


class MarkerErrors:
    """The errors of all markers of a pad: mean and covariance, (7 n,) and (7 n, 7 n).

    Attributes:
        scale_sigma: share by which all markers may be too large together, and
        focal_sigma: share by which the lens may be longer than calibrated: no picture shows them.
    """

    def __init__(self, layout: PadLayout, focal_sigma: float) -> None:
        """Begin with what the pad file says."""
        self.focal_sigma = focal_sigma
        self.scale_sigma = layout.print_scale_sigma
        count = len(layout.markers)
        self._first = np.zeros((ERRORS * count, ERRORS * count))
        for i, marker in enumerate(layout.markers):
            at = slice(ERRORS * i, ERRORS * (i + 1))
            self._first[at, at] = np.diag(_variances(marker, layout))
        self._mean = np.zeros(ERRORS * count)
        self._covariance = self._first.copy()
        self._known: dict[tuple[int, ...], tuple[F64, F64]] = {}  # what `of` has returned
        self._t: float | None = None

    def of(self, markers: list[int]) -> tuple[F64, F64]:
        """Return mean (7 k,) and information (7 k, 7 k) of k markers, by place in the file."""
        found = self._known.get(tuple(markers))
        if found is None:
            at = _places(markers)
            found = self._mean[at], inverse(self._covariance[np.ix_(at, at)])
            self._known[tuple(markers)] = found
        return found

    def first(self, markers: list[int]) -> F64:
        """Return the covariance (7 k, 7 k) of k markers as the pad file alone has it."""
        at = _places(markers)
        return self._first[np.ix_(at, at)]

    def is_due(self, t: float) -> bool:
        """Tell whether a frame of time t (s) may be learned from."""
        return self._t is None or not 0.0 <= t - self._t < LEARN_EVERY_S

    def learn(self, t: float, markers: list[int], mean: F64, covariance: F64) -> None:
        """Take what a frame of time t (s) says of some markers; the others follow.

        Args:
            t: of the exposure.
            markers: k of them, by their place in the file.
            mean: (7 k,) and
            covariance: (7 k, 7 k), what was known before included.
        """
        self._forget(t)
        self._known.clear()
        at = _places(markers)
        known = self._covariance[np.ix_(at, at)]
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


def _variances(marker: Marker, layout: PadLayout) -> list[float]:
    """Return the variances (7,) of a marker's errors.

    A plate that bends anywhere between landing point and marker lifts the marker by half of what it
    turns it, times the distance.
    """
    place, flat = layout.placement_sigma_m, math.radians(layout.flatness_deg)
    size = size_m(marker)
    distance = math.hypot(*marker.position_m)
    is_beside = distance > 0.5 * size
    lifted = math.hypot(place, 0.5 * distance * flat) if is_beside else place
    tilt = max(flat, _SAME_PLANE_SIGMA) if is_beside else _SAME_PLANE_SIGMA
    # What is laid out or glued by its edges is turned by the error of their ends.
    heading = max(min(place / size, flat), _SAME_PLANE_SIGMA)
    sigmas = (place, place, lifted, tilt, tilt, heading, _OWN_SCALE * layout.print_scale_sigma)
    return [max(s, 1e-6) ** 2 for s in sigmas]
