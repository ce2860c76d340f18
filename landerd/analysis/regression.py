"""Polynomial regression of errors over the distance, as in the thesis (eq. 3.3 to 3.5)."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from landerd.analysis.intervals import t_quantile

# Of the powers of the distances, beyond which their products are singular in floating point: as of
# a vehicle that hovered in one place.
_WORST_CONDITION = 1e7


def regression(x: Sequence[float], y: Sequence[float], degree: int) -> dict[str, Any] | None:
    """Return the fit of a polynomial; None: there are too few points, or they lie too close.

    Args:
        x: distances, m.
        y: errors at these distances.
        degree: of the polynomial.

    Returns:
        the coefficients (`polynomial`), the highest power first; the 95 % interval of each
        (`polynomial_95`); the standard error (`sigma`); and the number of `samples`.
    """
    if len(x) <= degree + 1 or len(x) != len(y):
        return None
    powers = np.vander(x, degree + 1)
    if np.linalg.cond(powers / np.linalg.norm(powers, axis=0)) > _WORST_CONDITION:
        return None
    fit, covariance = np.polyfit(x, y, degree, cov=True)
    rest = np.asarray(y) - np.polyval(fit, x)
    freedom = len(x) - degree - 1
    half = t_quantile(freedom) * np.sqrt(np.diag(covariance))
    return {
        "polynomial": [float(c) for c in fit],
        "polynomial_95": [[float(c - h), float(c + h)] for c, h in zip(fit, half, strict=True)],
        "sigma": math.sqrt(float(rest @ rest) / freedom),
        "samples": len(x),
    }


def in_words(fit: Mapping[str, Any]) -> str:
    """Return a result of `regression` as a line of text."""
    ends = zip(fit["polynomial"], fit["polynomial_95"], strict=True)
    terms = " ".join(f"{c:+.3g} ±{high - c:.2g}" for c, (_, high) in ends)
    return (
        f"over distance, highest power first: {terms}; sigma {fit['sigma']:.4f} of "
        f"{fit['samples']} samples"
    )
