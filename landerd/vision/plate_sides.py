"""Fit of a plate's place, heading and size on a known plane to where its white ends."""

from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.vision.arrays import Image
from landerd.vision.linear import inverse, solved
from landerd.vision.patch import levels_at
from landerd.vision.plate_outline import Outlines
from landerd.vision.pose import normal_of, px_per_m, rotation_2d

# How far across the outline white's end is looked for, of the ring's radius, round by round.
_REACHES, _LEAST_REACH_PX, _PLACES = (0.28, 0.18, 0.14), 3.0, 21
_LEAST_FALL, _LEAST_ENDS = 4.0, 12  # grey levels, and of the places on the outline
_ROUNDS = 5
_SIGMA, _SIGMA_PX = 0.04, 0.7  # of a place's distance: of the ring's radius, and px


@dataclass(frozen=True, slots=True)
class SidesFit:
    """A plate on its plane, as its sides have it."""

    heading: float  # of its north about the plane's axes, rad
    middle: F64  # (2,), of the ring on it, by the plane's axes, from where it was expected, m
    size: float  # over that in the pad file, at the range that was expected
    covariance: F64  # (4, 4), of heading, north and east in the plate's axes, and size


class PlateSides:
    """The sides of a plate about a ring on it."""

    def __init__(self, about: Outlines, radius_m: float) -> None:
        """Prepare the places; radius_m: of the ring."""
        self._radius = radius_m
        self._places = about.places[about.is_plate]
        out = -about.ways[about.is_plate]
        self._out: F64 = out / np.hypot(*out.T)[:, None]
        # How an end of the plate's white moves along the way out with a turn (rad), north and east
        # of the plate (m), and its size (share).
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
        """Return the plate whose sides are where white ends; None: it does not on enough of them.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: where the ring is expected, (3,), camera frame, m.
            axes: two unit vectors (3, 2) of the plane.
            heading: expected, about them, rad.
            off_sigma: of the ring's place on the plane, of its radius, and
            size_sigma: of the size.
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
            ends = weight > _LEAST_FALL**2  # not so what is partly out of the picture: NaN
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
    """Return parameters (k,) and their information (k, k), weighted after Cauchy.

    Args:
        slopes: (n, k), of what is measured by the parameters.
        off: (n,), measured, with
        sigma: of each that is none of the far ones.
        known: information (k, k) before.
    """
    step: F64 = np.zeros(len(known))
    information, beyond = known, np.zeros(len(off))
    for _ in range(_ROUNDS):
        weighted = slopes.T / (sigma**2 * (1.0 + beyond * beyond))
        information = weighted @ slopes + known
        step = solved(information, weighted @ off)
        beyond = (off - slopes @ step) / sigma
    return step, information
