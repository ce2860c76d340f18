"""The print of a WhyCode, which `print_fit` fits to pixels; `whycode` uses it."""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.pad import WHYCODE_BAND, WHYCODE_CORE, WhyCode
from landerd.vision.print_fit import MarkerPrint

_SAMPLES_PER_RADIUS = 96  # samples of the print per outer radius
_OVERSAMPLING = 4  # points along each axis of which a sample is the mean
_MARGIN_SAMPLES = 32  # samples of white round the print
# Print and image are compared between two distances from the centre, in outer radii. The white core
# is left out, as another marker may stand there.
_OUTER_REACH = 1.12
_INNER_REACH = 0.26


class WhyCodePrint(MarkerPrint):
    """The print of one WhyCode, ready to be compared with images."""

    def __init__(self, code: WhyCode) -> None:
        """Draw the print of a code."""
        self._radius = code.radius_m
        super().__init__(
            _drawn(code),
            code.outer_diameter_m,
            _SAMPLES_PER_RADIUS / self._radius,
            _OUTER_REACH * self._radius,
        )

    def _is_used(self, north: F64, east: F64) -> NDArray[np.bool_]:
        rho = np.hypot(north, east) / self._radius
        used: NDArray[np.bool_] = (rho < _OUTER_REACH) & (rho > _INNER_REACH)
        return used


def bits_of(code: WhyCode) -> NDArray[np.intp]:
    """Return the bits (bits,) of a code's id, the highest first, in their order round its band."""
    return np.array([code.id >> i & 1 for i in reversed(range(code.bits))], dtype=np.intp)


@cache
def _drawn(code: WhyCode) -> F64:
    """Return the print (n, n), the top row first: 1 white, 0 black, and between at edges."""
    half = _SAMPLES_PER_RADIUS + _MARGIN_SAMPLES
    points = np.arange(2 * half * _OVERSAMPLING) + 0.5
    p = points / (_OVERSAMPLING * _SAMPLES_PER_RADIUS) - half / _SAMPLES_PER_RADIUS
    east, north = np.meshgrid(p, -p)
    rho = np.hypot(north, east)
    # Angle anticlockwise from the east, in slots: each bit has two.
    at = (np.arctan2(north, east) * (code.bits / math.pi)) % (2 * code.bits)
    slot = np.floor(at).astype(np.intp) % (2 * code.bits)
    tooth = slot % 2 == bits_of(code)[slot // 2]
    black = (rho < 1.0) & (rho > WHYCODE_CORE) & ((rho > WHYCODE_BAND) | tooth)
    white: F64 = 1.0 - black.reshape(2 * half, _OVERSAMPLING, 2 * half, _OVERSAMPLING).mean(
        axis=(1, 3)
    )
    return white
