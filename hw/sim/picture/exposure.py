"""Exposure time and gain, and the control loop that chooses them in a camera."""

import math
from dataclasses import dataclass

import numpy as np

from hw.sim.camera_options import SimCameraOptions
from hw.sim.picture.tone import STEPS, tone_levels

SHORTEST_S = 5e-5  # shortest exposure
# Steps of the exposure per doubling of the light: sensors set whole row times, and gain in steps of
# about 3 %.
STEPS_PER_STOP = 24
# Limits of a picture's mean light, share of full scale: beyond them, near black or white, it shows
# only that the exposure is far off, not how far.
DARKEST, BRIGHTEST = 0.002, 0.98


@dataclass(frozen=True, slots=True)
class Exposure:
    """How one picture is exposed."""

    time_s: float
    gain: float = 1.0


class AutoExposure:
    """Controls the mean light of the pictures to its target, with a first-order lag in stops.

    A stop is a factor of 2 of the light.
    """

    def __init__(self, options: SimCameraOptions) -> None:
        """Start at the fixed exposure and gain 1."""
        self._options = options
        self._stops = 0.0  # light relative to that of the fixed exposure, in stops
        self._t: float | None = None  # time of the last picture, s
        o = options.auto_exposure
        self._most = math.log2(o.longest_s * o.gain_max / options.exposure_s)
        self._least = math.log2(SHORTEST_S / options.exposure_s)
        self._levels = tone_levels(options.tone, options.black_level)
        self._lights = np.linspace(0.0, 1.0, STEPS)
        self._wanted = o.target

    @property
    def exposure(self) -> Exposure:
        """Exposure of the next picture; the gain is above 1 only at the longest exposure time."""
        o = self._options.auto_exposure
        stops = round(self._stops * STEPS_PER_STOP) / STEPS_PER_STOP
        product = self._options.exposure_s * 2.0**stops
        time_s = min(product, o.longest_s)
        return Exposure(time_s, product / time_s)

    def see(self, mean: float, t: float) -> None:
        """Adapt the exposure to the mean of a picture, share of full scale, exposed at t, s."""
        past = t - self._t if self._t is not None else 0.0
        self._t = t
        missing = math.log2(self._wanted / self._light(mean))
        share = -math.expm1(-past / self._options.auto_exposure.lag_s)
        self._stops = min(max(self._stops + share * missing, self._least), self._most)

    def _light(self, mean: float) -> float:
        """Return the light, share of full scale, that gives an evenly lit picture this mean."""
        light = float(np.interp(255.0 * mean, self._levels, self._lights))
        return min(max(light, DARKEST), BRIGHTEST)
