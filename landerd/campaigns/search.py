"""Finds the best place in a unit cube by a grid or by CMA-ES, independent of what it stands for.

All places meet the same seeds (common random numbers), and the worse half of them only a third of
those: CMA-ES asks only which places are the better ones.
"""

import importlib.util
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from landerd.campaigns.tuning import Cost

Place = tuple[float, ...]
CostsOf = Callable[[Sequence[Place], Sequence[int]], list[Cost]]  # over these seeds together
PATIENCE = 5  # generations without a better place after which the search ends
SIGMA = 0.25  # standard deviation of the first generation, share of the range
SEED = 1  # of CMA-ES's own random numbers
MINIMISE_PLACES = 320  # most places tried by `minimised`, whose function is cheap


class SearchError(Exception):
    """The search cannot be made; the text is for the user."""


@dataclass(frozen=True)
class Tried:
    """A place and its cost; if it was given up early, over a part of the seeds."""

    place: Place
    cost: Cost
    whole: bool  # flown with all seeds


def race(places: Sequence[Place], seeds: Sequence[int], costs_of: CostsOf) -> list[Tried]:
    """Return all places, the best first; the worse half is given up after a third of the seeds."""
    first = seeds[: max(1, len(seeds) // 3)]
    early = sorted(zip(costs_of(places, first), places, strict=True))
    count = (len(places) + 1) // 2
    kept = [place for _, place in early[:count]]
    ended = sorted(zip(costs_of(kept, seeds), kept, strict=True))
    return [
        *(Tried(place, cost, True) for cost, place in ended),
        *(Tried(place, cost, False) for cost, place in early[count:]),
    ]


def grid(dimensions: int, steps: int, seeds: Sequence[int], costs_of: CostsOf) -> Iterator[Tried]:
    """Try every combination of this number of steps per dimension; yield all, best first."""
    shares = [i / (steps - 1) for i in range(steps)]
    yield from race(list(itertools.product(shares, repeat=dimensions)), seeds, costs_of)


def cma_es(
    start: Place,
    sets: int,
    seeds: Sequence[int],
    costs_of: CostsOf,
    patience: int = PATIENCE,
) -> Iterator[list[Tried]]:
    """Search from a place by CMA-ES (Hansen 2016); yield the generations, each the best first.

    Args:
        start: middle of the first generation.
        sets: most places that are tried.
        seeds: seeds with which every place is flown.
        costs_of: flies places and returns their costs.
        patience: generations without a better place after which it ends.

    Raises:
        SearchError: cmaes is not installed, or the places are fewer than a generation.
    """
    check_cma_es(len(start), sets)
    from cmaes import CMA

    bounds = np.array([[0.0, 1.0]] * len(start))
    optimiser = CMA(mean=np.array(start), sigma=SIGMA, bounds=bounds, seed=SEED)
    best: Cost | None = None
    waited = tried = 0
    while tried + optimiser.population_size <= sets and waited < patience:
        places = [_as_place(optimiser.ask()) for _ in range(optimiser.population_size)]
        tried += len(places)
        ordered = race(places, seeds, costs_of)
        # Only ranks count: costs over different seeds cannot be compared.
        optimiser.tell([(np.array(t.place), float(rank)) for rank, t in enumerate(ordered)])
        yield ordered
        waited = 0 if best is None or ordered[0].cost < best else waited + 1
        best = ordered[0].cost if best is None else min(best, ordered[0].cost)
        if optimiser.should_stop():
            return


def check_cma_es(dimensions: int, sets: int) -> None:
    """Refuse a search that cannot be made, before anything is flown.

    Raises:
        SearchError: cmaes is not installed, or the places are fewer than a generation.
    """
    if importlib.util.find_spec("cmaes") is None:
        raise SearchError("this search needs cmaes: pip install cmaes")
    generation = 4 + int(3.0 * math.log(dimensions))  # Hansen's default, which cmaes takes
    if sets < generation:
        raise SearchError(
            f"sets: found {sets}, expected {generation} or more: CMA-ES tries so many at a time"
        )


def _as_place(x: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> Place:
    return tuple(float(each) for each in x)


def minimised(function: Callable[[Sequence[float]], float], start: Sequence[float]) -> Place:
    """Return the best place that CMA-ES finds for a function that is not costly.

    Raises:
        SearchError: cmaes is not installed.
    """
    known = {tuple(start): function(start)}

    def costs_of(found: Sequence[Place], seeds: Sequence[int]) -> list[Cost]:
        known.update((place, function(place)) for place in found if place not in known)
        return [Cost(0.0, known[place]) for place in found]

    for _ in cma_es(tuple(start), MINIMISE_PLACES, (0,), costs_of, patience=15):
        pass
    return min(known, key=known.__getitem__)
