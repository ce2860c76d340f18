"""Finds the failures of a campaign, and what they have in common.

Every seed of a drawn world is another day; what was drawn for it (`world` of a result) tells in
what the days that failed differ from those that did not.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

from landerd.analysis.intervals import wilson
from landerd.campaigns.pool import Run

SLOW_S = 60.0  # from the first sighting to disarm; the thesis took 35 to 61 s
HARD_MPS = 0.7  # first contact, downwards; ArduCopter's own landing touches at 0.5
SLIDING_MPS = 0.7  # first contact, across the pad: from about there a gear of 0.26 m tips
SHOWN = 10  # number shown of the worst days, and of the quantities that separate best
# Classes of failure that count even on a day on which no vehicle could have landed.
GRAVE = ("exception", "rule broken", "told wrong")
CLASSES = (
    "exception",
    "rule broken",
    "told wrong",
    "not landed",
    "beside the pad",
    "hard contact",
    "slow",
)


def failure(run: Run) -> str | None:
    """Return the class of a run's failure, the gravest if there are several; None of a good run."""
    result = run.result
    if result is None:
        return "exception"
    if result["rules_broken"]:
        return "rule broken"
    if (result["outcome"] == "landed") != result["landed"]:
        return "told wrong"
    if result["touchdown_error_m"] is None:
        return "not landed"
    if not result["landed"]:
        return "beside the pad"
    if (
        result["touchdown_vertical_mps"] > HARD_MPS
        or result["touchdown_horizontal_mps"] > SLIDING_MPS
    ):
        return "hard contact"
    return "slow" if result["time_s"] is not None and result["time_s"] > SLOW_S else None


def is_feasible(run: Run) -> bool:
    """Tell whether the vehicle could have landed on that day at all (judged from truth alone)."""
    return run.result is None or run.result.get("infeasible") is None


@dataclass(frozen=True)
class Separation:
    """How well one drawn quantity separates the failed days from the good ones.

    Attributes:
        key: of the quantity; "KEY = word" where words are drawn.
        auc: probability that it is larger on a failed day than on a good one (Mann-Whitney); 0.5
            tells nothing.
        z: deviation of `auc` from 0.5, in standard deviations of an irrelevant quantity.
        failed: its median over the failed days.
        good: its median over the good ones.
    """

    key: str
    auc: float
    z: float
    failed: float
    good: float


def separations(runs: Sequence[Run]) -> list[Separation]:
    """Return every drawn quantity, the one that separates best first.

    For a quantity that may have either sign its magnitude is examined, too, as "|KEY|".
    """
    days = [
        (failure(run) is not None, _numbers(run.result.get("world", {})))
        for run in runs
        if run.result is not None
    ]
    keys = {key for _, world in days for key in world}
    signed = {key for key in keys if any(world.get(key, 0.0) < 0.0 for _, world in days)}
    looks: list[tuple[str, str, Callable[[float], float]]] = [(key, key, float) for key in keys]
    looks += [(f"|{key}|", key, abs) for key in signed]
    found = []
    for name, key, look in sorted(looks, key=lambda each: each[0]):
        a = [look(world.get(key, 0.0)) for failed, world in days if failed]
        b = [look(world.get(key, 0.0)) for failed, world in days if not failed]
        if a and b and len({*a, *b}) > 1:
            auc = _auc(a, b)
            sigma = math.sqrt((len(a) + len(b) + 1) / (12.0 * len(a) * len(b)))
            separation = Separation(name, auc, (auc - 0.5) / sigma, median(a), median(b))
            found.append(separation)
    return sorted(found, key=lambda s: -abs(s.z))


def _numbers(world: dict[str, Any]) -> dict[str, float]:
    """Return the drawn values as numbers; of words, 1 for the word that was drawn."""
    return {
        key if isinstance(value, (int, float)) else f"{key} = {value}": (
            float(value) if isinstance(value, (int, float)) else 1.0
        )
        for key, value in world.items()
    }


def _auc(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the probability that a value of a is above one of b; equal ones count half."""
    order = sorted({*a, *b})
    below = dict.fromkeys(order, 0)
    for x in b:
        below[x] += 1
    total, counts = 0, {}
    for x in order:
        counts[x] = total + 0.5 * below[x]
        total += below[x]
    return sum(counts[x] for x in a) / (len(a) * len(b))


def summary(runs: Sequence[Run]) -> dict[str, Any]:
    """Return the summary of flights in drawn worlds; infeasible days are counted separately."""
    flown = [run for run in runs if is_feasible(run)]
    classes: dict[str, list[int]] = {}
    for run in flown:
        kind = failure(run)
        if kind is not None:
            classes.setdefault(kind, []).append(run.seed)
    good = len(flown) - sum(len(seeds) for seeds in classes.values())
    low, high = wilson(good, len(flown))
    beyond = [run for run in runs if not is_feasible(run)]
    return {
        "feasible": len(flown),
        "good": good,
        "good_percent_95": [100.0 * low, 100.0 * high],
        "failures": {kind: classes[kind] for kind in CLASSES if kind in classes},
        "infeasible_seeds": [run.seed for run in beyond],
        "infeasible_told_wrong": [r.seed for r in beyond if failure(r) in GRAVE],
        "separations": [asdict(s) for s in separations(flown)[:SHOWN]],
        "worst": [_last_words(run) for run in _worst(flown)],
    }


def _worst(runs: Sequence[Run]) -> list[Run]:
    """Return the failed runs, the gravest first, SHOWN at most."""
    failed = [run for run in runs if failure(run) is not None]
    return sorted(failed, key=lambda run: CLASSES.index(failure(run) or CLASSES[-1]))[:SHOWN]


def _last_words(run: Run) -> dict[str, Any]:
    result = run.result or {}
    return {
        "seed": run.seed,
        "failure": failure(run),
        "outcome": result.get("outcome", run.error),
        "again": f"landerd sim {run.scenario} --seed {run.seed} --picture {run.seed}.png",
    }


def as_lines(found: dict[str, Any]) -> list[str]:
    """Return a summary in words."""
    low, high = found["good_percent_95"]
    lines = [
        f"{found['good']} of {found['feasible']} feasible days good (95 %: {low:.0f} to "
        f"{high:.0f} %), {len(found['infeasible_seeds'])} days beyond the vehicle"
    ]
    for kind, seeds in found["failures"].items():
        lines.append(f"  {kind:15} {len(seeds):4}  seeds {', '.join(map(str, seeds[:15]))}")
    if found["separations"]:
        lines.append("what tells failed days from good ones (z, median failed, median good):")
    for s in found["separations"]:
        lines.append(f"  {s['z']:+6.1f}  {s['failed']:10.4g} {s['good']:10.4g}  {s['key']}")
    for worst in found["worst"]:
        lines.append(f"  {worst['failure']}: {worst['outcome']}: {worst['again']}")
    return lines
