from collections.abc import Sequence

import pytest

from landerd.campaigns.search import Place, cma_es, grid, minimised, race
from landerd.campaigns.tuning import Cost

SEEDS = range(1, 7)


class Valley:
    """A cost function with one minimum; counts the runs that it is asked for."""

    def __init__(self, least_at: Place) -> None:
        self.least_at = least_at
        self.flown = 0

    def __call__(self, places: Sequence[Place], seeds: Sequence[int]) -> list[Cost]:
        self.flown += len(places) * len(seeds)
        return [Cost(0.0, self.at(place)) for place in places]

    def at(self, place: Sequence[float]) -> float:
        return sum((x - y) ** 2 for x, y in zip(place, self.least_at, strict=True))


def test_the_worse_half_is_given_up_early() -> None:
    valley = Valley((0.5,))
    tried = race([(0.0,), (0.4,), (0.9,), (0.6,)], SEEDS, valley)
    assert [t.whole for t in tried] == [True, True, False, False]
    assert {t.place for t in tried[:2]} == {(0.4,), (0.6,)}
    assert valley.flown == 4 * 2 + 2 * 6


def test_a_grid_tries_every_combination() -> None:
    tried = list(grid(2, 3, SEEDS, Valley((0.5, 1.0))))
    assert len({t.place for t in tried}) == 9
    assert tried[0].place == (0.5, 1.0)


def test_cma_es_comes_near_the_least_and_stops_when_told() -> None:
    pytest.importorskip("cmaes")
    valley = Valley((0.8, 0.3, 0.6))
    generations = list(cma_es((0.2, 0.9, 0.1), 300, SEEDS, valley))
    first, best = (min(t.cost.mean for g in gs for t in g) for gs in (generations[:1], generations))
    assert best < 0.03 < first
    assert sum(len(g) for g in generations) <= 300
    assert all(0.0 <= x <= 1.0 for g in generations for t in g for x in t.place)


def test_the_same_search_tries_the_same_places_so_that_it_can_go_on() -> None:
    pytest.importorskip("cmaes")
    once, again = (
        [t.place for g in cma_es((0.5, 0.5), 60, SEEDS, Valley((0.8, 0.3))) for t in g]
        for _ in range(2)
    )
    assert once == again


def test_a_minimum_of_a_function_is_found() -> None:
    pytest.importorskip("cmaes")
    place = minimised(Valley((0.7, 0.2)).at, (0.1, 0.9))
    assert place == pytest.approx((0.7, 0.2), abs=0.01)
