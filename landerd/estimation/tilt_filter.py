"""Kalman filter of the pad's tilt: its normal's lean to north and east, with one variance for both.

Its constants were chosen like those of `pad_filter`.
"""

import math

from landerd.estimation.observation import PadObservation
from landerd.geometry import Vec3, unit

SIGMA_INITIAL_TILT = math.radians(6.0)  # rad, from level
TILT_RANDOM_WALK = math.radians(2.0)  # rad per sqrt(s): how decks roll


class TiltFilter:
    """For each frame: `predict`, compare its pose solutions by `cost`, `update` with the chosen.

    Attributes:
        normal: unit vector into the pad, local NED.
    """

    def __init__(self, sigma_bearing: float) -> None:
        """Make one that assumes a level pad; sigma_bearing: of the lens's direction, rad."""
        self._sigma_bearing = sigma_bearing
        self.reset()

    def reset(self) -> None:
        """Forget the tilt."""
        self._tilt = (0.0, 0.0)  # of the normal from gravity, local north and east, rad
        self._variance = SIGMA_INITIAL_TILT**2
        self.normal: Vec3 = (0.0, 0.0, 1.0)

    def predict(self, dt: float) -> None:
        """Predict over dt, s."""
        self._variance += TILT_RANDOM_WALK**2 * dt

    def cost(self, seen: PadObservation) -> float:
        """Return the chi-square of a pose: of its fit to the picture, and of its tilt."""
        north, east = seen.normal[0] - self._tilt[0], seen.normal[1] - self._tilt[1]
        variance = self._variance + seen.sigma_tilt**2 + self._sigma_bearing**2
        return seen.cost + (north * north + east * east) / variance

    def update(self, seen: PadObservation) -> None:
        """Correct by an observed normal, its noise white and alike in both directions."""
        s = self._variance + seen.sigma_tilt**2 + self._sigma_bearing**2
        k = self._variance / s
        north, east = self._tilt
        self._tilt = (
            north + k * (seen.normal[0] - north),
            east + k * (seen.normal[1] - east),
        )
        self._variance *= 1.0 - k
        self.normal = unit((*self._tilt, 1.0))


def cost_by_level(seen: PadObservation) -> float:
    """Return the chi-square of a pose: of its fit to the picture, and of its tilt from level."""
    return seen.cost + (seen.tilt / math.hypot(SIGMA_INITIAL_TILT, seen.sigma_tilt)) ** 2
