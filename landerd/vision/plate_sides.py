"""Fit of a plate's place, heading and size on a known plane to where its white ends.

Robust least squares on the distances between the expected sides and the steepest fall of grey
levels across them. `plate_heading` takes the heading of it, `plate_ring` also place and range.
"""

from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.vision.arrays import Image
from landerd.vision.linear import inverse, solved
from landerd.vision.patch import levels_at
from landerd.vision.plate_outline import Outlines
from landerd.vision.pose import normal_of, px_per_m, rotation_2d

# How far to either side of the outline the end of the white is looked for: shares of the ring's
# radius, round by round, but at least this many px; and the number of samples across.
_REACHES, _LEAST_REACH_PX, _PLACES = (0.28, 0.18, 0.14), 3.0, 21
# Least fall of the grey level that counts as an end of white, and least number of places on the
# outline with one.
_LEAST_FALL, _LEAST_ENDS = 4.0, 12
_ROUNDS = 5  # reweighted least squares solutions for one set of distances
# Sigma of a measured distance: the larger of a share of the ring's radius, and px.
_SIGMA, _SIGMA_PX = 0.04, 0.7


@dataclass(frozen=True, slots=True)
class SidesFit:
    """A plate on its plane, as fitted to its sides."""

    heading: float  # of its north about the plane's axes, rad
    middle: F64  # offset of the ring on it from where it was expected, by the plane's axes, m, (2,)
    size: float  # relative to the pad file, if the expected range were right
    covariance: F64  # (4, 4), of heading, north and east in the plate's axes, and size


class PlateSides:
    """The sides of a plate about a ring on it."""

    def __init__(self, about: Outlines, radius_m: float) -> None:
        """Prepare the places on the plate's outline; radius_m is the ring's."""
        self._radius = radius_m
        self._places = about.places[about.is_plate]
        out = -about.ways[about.is_plate]
        self._out: F64 = out / np.hypot(*out.T)[:, None]
        # Derivatives of the distance of white's end, outwards, by a turn (rad), by a move to the
        # plate's north and east (m), and by its size (share).
        p, out = self._places, self._out
        turn = p[:, 0] * out[:, 1] - p[:, 1] * out[:, 0]
        self._slopes: F64 = np.column_stack([turn, out, (p * out).sum(axis=1)])

    def fit(
        self,
        image: Image,
        camera: CameraModel,
        t: F64,
        axes: F64,
        heading: float,
        off_sigma: float,
        size_sigma: float,
    ) -> SidesFit | None:
        """Return the plate whose sides are where white ends; None: it ends at too few places.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: where the ring is expected, (3,), camera frame, m.
            axes: two unit vectors (3, 2) of the plane.
            heading: expected, about these axes, rad.
            off_sigma: sigma of the ring's place on the plane, in its radii.
            size_sigma: sigma of the size, as a share.
        """
        px = px_per_m(camera, t, normal_of(axes))
        sigma = max(_SIGMA * self._radius, _SIGMA_PX / px)
        known = np.diag([1e-9, *[1.0 / (off_sigma * self._radius) ** 2] * 2, 1.0 / size_sigma**2])
        middle: F64 = np.zeros(2)
        size, information = 1.0, known
        for reach in _REACHES:
            farthest = max(reach * self._radius, _LEAST_REACH_PX / px)
            across = np.linspace(-farthest, farthest, _PLACES)
            R = rotation_2d(heading)
            at = size * self._places[:, None] + across[:, None] * self._out[:, None]
            points = t + (at.reshape(-1, 2) @ R.T + middle) @ axes.T
            grey = levels_at(image, camera, points).reshape(len(at), -1)
            falls = np.maximum(grey[:, :-1] - grey[:, 1:], 0.0) ** 2
            weight = falls.sum(axis=1)
            ends = weight > _LEAST_FALL**2  # False for NaN: partly out of the picture
            if int(ends.sum()) < _LEAST_ENDS:
                return None
            between = 0.5 * (across[:-1] + across[1:])
            off = (falls[ends] * between).sum(axis=1) / weight[ends]
            step, information = _robust(self._slopes[ends], off, sigma, known)
            heading += float(step[0])
            middle = middle + R @ step[1:3]
            size += float(step[3])
        return SidesFit(heading, middle, size, inverse(information))


def _robust(slopes: F64, off: F64, sigma: float, known: F64) -> tuple[F64, F64]:
    """Return parameters (k,) and their information (k, k) by least squares with Cauchy's weights.

    Args:
        slopes: derivatives of the measurements by the parameters, (n, k).
        off: measurements, (n,).
        sigma: of a measurement that is no outlier.
        known: information before, (k, k).
    """
    step: F64 = np.zeros(len(known))
    information, beyond = known, np.zeros(len(off))
    for _ in range(_ROUNDS):
        weighted = slopes.T / (sigma**2 * (1.0 + beyond * beyond))
        information = weighted @ slopes + known
        step = solved(information, weighted @ off)
        beyond = (off - slopes @ step) / sigma
    return step, information
