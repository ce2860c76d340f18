"""95 % confidence intervals of shares and means, and tests of paired results."""

import math
from collections.abc import Sequence
from statistics import NormalDist, fmean, stdev

_Z = NormalDist().inv_cdf(0.975)
# 97.5 % quantiles of Student's t by degrees of freedom, where the series below is not good enough.
_T_OF_FEW = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776}


def wilson(successes: int, runs: int) -> tuple[float, float]:
    """Return the 95 % interval of a share of successes (Wilson 1927)."""
    z, n = 1.96, max(runs, 1)
    p = successes / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, middle - half), min(1.0, middle + half)


def mean_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """Return the 95 % interval of a mean (Student's t); None: there are fewer than two values."""
    if len(values) < 2:
        return None
    half = t_quantile(len(values) - 1) * stdev(values) / math.sqrt(len(values))
    return fmean(values) - half, fmean(values) + half


def t_quantile(degrees: int) -> float:
    """Return the 97.5 % quantile of Student's t for some degrees of freedom, to 0.004.

    Abramowitz and Stegun, 26.7.5.
    """
    if degrees in _T_OF_FEW:
        return _T_OF_FEW[degrees]
    z, n = _Z, float(degrees)
    return (
        z
        + (z**3 + z) / (4 * n)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * n**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * n**3)
    )


def mcnemar(only_a: int, only_b: int) -> float:
    """Return the p-value of McNemar's exact two-sided test (1947) that neither is better.

    It is the probability of a split of the differing pairs that is at least as uneven, if each of
    them goes either way with the same probability.

    Args:
        only_a: number of pairs in which only the first succeeded.
        only_b: number of pairs in which only the second succeeded.
    """
    n = only_a + only_b
    tail = sum(math.comb(n, k) for k in range(min(only_a, only_b) + 1))
    return min(1.0, 2.0 * tail / 2.0**n)


def paired_difference(only_a: int, only_b: int, pairs: int) -> tuple[float, float]:
    """Return the 95 % interval of the second share of successes minus the first, for pairs.

    It is Wald's interval after half a pair of each of the four kinds has been added (Agresti and
    Min 2005), which also holds for few pairs, and if none differ.

    Args:
        only_a: number of pairs in which only the first succeeded.
        only_b: number of pairs in which only the second succeeded.
        pairs: number of all pairs.
    """
    n, more, differ = pairs + 2.0, only_b - only_a, only_a + only_b + 1.0
    half = _Z * math.sqrt(differ - more * more / n) / n
    return max(-1.0, more / n - half), min(1.0, more / n + half)


def percentile(values: Sequence[float], percent: float) -> float | None:
    """Return a percentile, linearly interpolated between values; None: there are no values."""
    if not values:
        return None
    ordered = sorted(values)
    at = (len(ordered) - 1) * percent / 100.0
    below = math.floor(at)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (at - below) * (ordered[above] - ordered[below])


def with_interval(mean: float | None, interval: tuple[float, float] | None, digits: int) -> str:
    """Return the text of a mean and the half width of its 95 % interval, as far as known."""
    if interval is None:
        return "-" if mean is None else f"{mean:.{digits}f}"
    return f"{mean:.{digits}f} ±{0.5 * (interval[1] - interval[0]):.{digits}f}"


def in_percent(interval: tuple[float, float]) -> str:
    """Return the text of an interval of a share, in per cent."""
    low, high = (100.0 * share for share in interval)
    return f"{low:.0f}-{high:.0f} %"
