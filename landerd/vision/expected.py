"""Where the pad is expected in a frame, before the frame is searched.

|             | the estimator predicts it | else it was seen in the last 0.5 s                   |
|-------------|---------------------------|------------------------------------------------------|
| position    | as predicted              | as seen                                              |
| uncertainty | its sigma, and 4 px       | 2 m/s of distance and 1 rad/s of image motion since  |
| normal      | as predicted, else along  | as seen                                              |
|             | gravity, else as seen,    |                                                      |
|             | else along the line of    |                                                      |
|             | sight                     |                                                      |
| north       | as predicted, else as     | as seen                                              |
|             | seen                      |                                                      |

A pad that was not seen often enough to be flown to yet (`Prior.maybe`) is predicted like any other.
In all other cases the pad is not expected anywhere, and the whole image is searched.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np

from landerd.camera_model import F64
from landerd.geometry import Vec3
from landerd.messages import PadPrior, PoseSolution, Prior
from landerd.pad import Marker
from landerd.vision.pose import rotation_from

_MAX_SIGHTING_AGE_S = 0.5  # older sightings tell nothing about where the pad is now
_MAX_IMAGE_RATE = 1.0  # rad/s: how fast a pad may move across the image
_MAX_RANGE_RATE_MPS = 2.0  # how fast its distance may change
_PRIOR_MARGIN_PX = 4.0  # error of a prediction in the image in addition to its sigma


@dataclass(frozen=True, slots=True)
class SeenPad:
    """The pad as the frame of time t showed it."""

    t: float
    pose: PoseSolution


@dataclass(frozen=True)
class Expected:
    """Where the pad should be, camera frame."""

    position: F64  # landing point, m, (3,)
    normal: F64  # unit, (3,)
    north: F64 | None  # unit, (3,); None: the heading is not known
    sigma_m: float
    margin_px: float  # error in the image in addition to sigma_m
    # For each marker the offset of where the last frame showed it from where it was expected, m,
    # (3,): an error of the camera's predicted attitude is much the same in the next frame.
    drift: Mapping[Marker, F64] = field(default_factory=dict)

    def starts(self, marker: Marker) -> "list[Expected]":
        """Return expectations to start a marker's fit from, the likelier first."""
        drift = self.drift.get(marker)
        if drift is None:
            return [self]
        position = self.position + drift
        drifted = Expected(
            position, self.normal, self.north, self.sigma_m, self.margin_px, self.drift
        )
        return [drifted, self]

    def centre(self, marker: Marker) -> F64 | None:
        """Return where a marker's centre (3,) should be; None: that needs the unknown heading."""
        if marker.position_m == (0.0, 0.0):
            return self.position
        points = self.points(marker.position_m, np.zeros((1, 2)))
        return None if points is None else np.asarray(points[0])

    def points(self, place: tuple[float, float], outline: F64) -> F64 | None:
        """Return where a marker's outline should be, points (n, 3), camera frame, m.

        None: the pad's heading is unknown, and the marker lies beside the landing point.

        Args:
            place: the marker's centre in the pad frame, m.
            outline: about the centre, (n, 2), pad's axes, m.
        """
        is_centred = place == (0.0, 0.0)
        if self.north is None and not is_centred:
            return None
        points: F64 = self.position + (outline + np.array(place)) @ self._axes.T
        return points

    @cached_property
    def _axes(self) -> F64:
        """North and east, (3, 2), camera frame; any two axes if the heading is not known."""
        axes: F64 = rotation_from(self.normal, self.north)[:, :2]
        return axes


def expected_pad(
    t: float,
    prior: Prior,
    last: SeenPad | None,
    focal: float,
    drift: Mapping[Marker, F64] = MappingProxyType({}),
) -> Expected | None:
    """Return where the pad should be in the frame of time t; None: it may be anywhere.

    Args:
        t: of the frame's exposure, s.
        prior: what the estimator predicts.
        last: the pad as last seen.
        focal: focal length of the camera, px.
        drift: see `Expected`.
    """
    if last is not None and not 0.0 <= t - last.t <= _MAX_SIGHTING_AGE_S:
        last = None
    predicted = prior.pad or prior.maybe
    if predicted is not None:
        return _as_predicted(predicted, prior.down, last, drift)
    if last is None:
        return None
    dt, pad = t - last.t, last.pose
    return Expected(
        np.array(pad.position),
        np.array(pad.normal),
        None if pad.north is None else np.array(pad.north),
        _MAX_RANGE_RATE_MPS * dt,
        _MAX_IMAGE_RATE * dt * focal,
        drift,
    )


def _as_predicted(
    pad: PadPrior, down: Vec3 | None, last: SeenPad | None, drift: Mapping[Marker, F64]
) -> Expected:
    position = np.array(pad.position)
    level = pad.normal or down
    if level is not None:
        normal = np.array(level)
    elif last is not None:
        normal = np.array(last.pose.normal)
    else:
        normal = position / np.linalg.norm(position)
    known = pad.north or (last.pose.north if last is not None else None)
    north = None if known is None else np.array(known)
    return Expected(position, normal, north, pad.sigma_m, _PRIOR_MARGIN_PX, drift)
