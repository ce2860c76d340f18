"""Tone curves: from light on the sensor to the grey level that a camera delivers.

Grossberg and Nayar, "Modeling the Space of Camera Response Functions" (PAMI 2004), measured 201
real curves: most lie between linear and a gamma of 2.5, many with an S shape.
"""

import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import ToneOptions

F64 = NDArray[np.float64]

STEPS = 4096  # number of steps of light in a table


def tone(light: F64, options: ToneOptions) -> F64:
    """Return the grey of light, both from 0 (none) to 1 (full scale), in the same shape."""
    grey = light
    if options.curve in ("srgb", "contrast"):
        grey = _srgb(light)
    elif options.curve == "gamma":
        grey = light ** (1.0 / options.gamma)
    if options.curve == "contrast":
        grey = _s_curve(grey)
    return (1.0 - options.contrast) * grey + options.contrast * _s_curve(grey)


def tone_levels(options: ToneOptions, black_level: float) -> F64:
    """Return the grey levels (STEPS,) of light from none, `black_level`, to full scale, 255."""
    share = tone(np.linspace(0.0, 1.0, STEPS), options)
    return black_level + (255.0 - black_level) * share


def _srgb(light: F64) -> F64:
    """Return the transfer function of IEC 61966-2-1 (sRGB)."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def _s_curve(grey: F64) -> F64:
    """Return a curve of higher contrast, with a slope of 1.5 in the middle and 0 at the ends."""
    return grey * grey * (3.0 - 2.0 * grey)
