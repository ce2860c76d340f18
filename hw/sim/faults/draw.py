"""Draws random faults, one or two per flight."""

import math
from random import Random

from hw.sim.fault_options import FAULTS, PHASES, FaultOptions, OnsetOptions

_PAIRS = 0.5  # share of flights with two faults
_TOGETHER = 0.5  # share of these in which the second begins within _SECOND_AFTER_S of the first
_LASTS_S = (0.2, 10.0)
_SECOND_AFTER_S = 3.0
_LATEST_S, _HIGHEST_M = 15.0, 3.0
# Of faults just over the pad: share that begins with the phase LANDED, within the time, s; and
# below which height, m, the others begin.
_IN_LANDED, _LANDED_AFTER_S, _LOW_M = 0.6, 0.8, 0.5


def draw_faults(seed: int, *, low: bool = False) -> list[FaultOptions]:
    """Return the faults of the flight with this seed; low: those that begin just over the pad."""
    rng = Random(f"{seed}:faults")
    onset = _low_onset if low else _onset
    first = _drawn(rng, onset(rng))
    if rng.random() >= _PAIRS:
        return [first]
    at = onset(rng)
    if rng.random() < _TOGETHER:
        after_s = _rounded(first.at.after_s + rng.uniform(0.0, _SECOND_AFTER_S))
        at = first.at.model_copy(update={"after_s": after_s})
    return [first, _drawn(rng, at)]


def as_setting(faults: list[FaultOptions]) -> str:
    """Return faults as an argument of `--set`."""
    inner = ", ".join(_flow(fault) for fault in faults)
    return f"sim.faults=[{inner}]"


def _flow(fault: FaultOptions) -> str:
    at = ", ".join(
        f"{key}: {value}" for key, value in fault.at.model_dump(exclude_defaults=True).items()
    )
    lasts = "" if fault.for_s is None else f", for_s: {fault.for_s:g}"
    return f"{{fault: {fault.fault}, at: {{{at}}}{lasts}, severity: {fault.severity:g}}}"


def _drawn(rng: Random, at: OnsetOptions) -> FaultOptions:
    least, most = (math.log(x) for x in _LASTS_S)
    return FaultOptions(
        fault=rng.choice(list(FAULTS)),
        at=at,
        for_s=_rounded(math.exp(rng.uniform(least, most))),
        severity=_rounded(rng.random()),
    )


def _onset(rng: Random) -> OnsetOptions:
    after_s = _rounded(rng.uniform(0.0, 2.0))
    kind = rng.choice(("phase", "phase", "height", "time"))
    if kind == "phase":
        return OnsetOptions.model_validate({"phase": rng.choice(PHASES), "after_s": after_s})
    if kind == "height":
        return OnsetOptions(height_m=_rounded(rng.uniform(0.0, _HIGHEST_M)))
    return OnsetOptions(time_s=_rounded(rng.uniform(0.5, _LATEST_S)))


def _low_onset(rng: Random) -> OnsetOptions:
    if rng.random() < _IN_LANDED:
        after_s = _rounded(rng.uniform(0.0, _LANDED_AFTER_S))
        return OnsetOptions.model_validate({"phase": "LANDED", "after_s": after_s})
    return OnsetOptions(height_m=_rounded(rng.uniform(0.0, _LOW_M)))


def _rounded(x: float) -> float:
    """Round a number as it is printed, so that the printed faults give the same flight."""
    return round(x, 2)
