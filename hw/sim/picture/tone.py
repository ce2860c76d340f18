"""Tone curves: from light on the sensor to the grey level that a camera delivers.

Grossberg and Nayar, "Modeling the Space of Camera Response Functions" (PAMI 2004), measured 201
real ones: most lie between linear and a gamma of 2.5, many with an S at both ends.
"""

import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import ToneOptions

F64 = NDArray[np.float64]

STEPS = 4096  # of light in a table


def tone(light: F64, options: ToneOptions) -> F64:
    """Return the grey of light, both from 0 (none) to 1 (full scale), same shape."""
    grey = light
    if options.curve in ("srgb", "contrast"):
        grey = _srgb(light)
    elif options.curve == "gamma":
        grey = light ** (1.0 / options.gamma)
    if options.curve == "contrast":
        grey = _s_curve(grey)
    return (1.0 - options.contrast) * grey + options.contrast * _s_curve(grey)


def tone_levels(options: ToneOptions, black_level: float) -> F64:
    """Return the grey levels (STEPS,) of light from 0 to full scale, those of no light lifted."""
    share = tone(np.linspace(0.0, 1.0, STEPS), options)
    return black_level + (255.0 - black_level) * share


def _srgb(light: F64) -> F64:
    """The transfer function of IEC 61966-2-1."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def _s_curve(grey: F64) -> F64:
    """Darker below the middle and brighter above; slope 1.5 in the middle, 0 at the ends."""
    return grey * grey * (3.0 - 2.0 * grey)
