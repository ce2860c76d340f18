"""What failed in a campaign, and what the failures have in common."""

from typing import Any

import pytest

from landerd.campaigns.failures import failure, is_feasible, separations
from landerd.campaigns.pool import Run

GOOD: dict[str, Any] = {
    "landed": True,
    "outcome": "landed",
    "rules_broken": [],
    "touchdown_error_m": 0.02,
    "touchdown_vertical_mps": 0.3,
    "touchdown_horizontal_mps": 0.1,
    "time_s": 15.0,
}


def run(seed: int = 1, **changes: Any) -> Run:
    return Run("field", seed, GOOD | changes)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, None),
        ({"rules_broken": ["3: too fast (at 2.00 s)"]}, "rule broken"),
        ({"landed": False}, "told wrong"),
        ({"outcome": "handed_back"}, "told wrong"),
        ({"landed": False, "outcome": "handed_back", "touchdown_error_m": None}, "not landed"),
        ({"landed": False, "outcome": "landed_off_pad"}, "beside the pad"),
        ({"touchdown_vertical_mps": 0.8}, "hard contact"),
        ({"touchdown_horizontal_mps": 0.8}, "hard contact"),
        ({"time_s": 61.0}, "slow"),
    ],
)
def test_a_failure_has_the_gravest_class_that_applies(
    changes: dict[str, Any], expected: str | None
) -> None:
    assert failure(run(**changes)) == expected


def test_a_run_that_raised_is_an_exception() -> None:
    assert failure(Run("field", 1, None, "ValueError: x")) == "exception"


def test_days_beyond_the_vehicle_are_marked() -> None:
    assert is_feasible(run(infeasible=None))
    assert not is_feasible(run(infeasible="wind of 12 m/s"))


def days() -> list[Run]:
    """Forty days: those with a clock more than 15 ms off fail; wind does not matter."""
    found = []
    for seed in range(40):
        clock = (seed - 20) * 0.001
        world = {
            "clock": clock,
            "wind": float(seed * 7 % 10),
            "lens": "wide" if seed % 2 else "tele",
        }
        found.append(run(seed, world=world, time_s=90.0 if abs(clock) > 0.015 else 15.0))
    return found


def test_a_quantity_whose_size_alone_separates_the_failed_days_is_found() -> None:
    best, *others = separations(days())
    assert best.key == "|clock|"
    assert best.auc == 1.0
    assert best.failed > 0.015 > best.good
    of = {s.key: s for s in others}
    assert abs(of["wind"].z) < 2.0
    assert abs(of["clock"].z) < 2.0
    assert {"lens = wide", "lens = tele"} <= of.keys()


def test_nothing_separates_when_nothing_failed() -> None:
    assert separations([run(seed, world={"wind": float(seed)}) for seed in range(5)]) == []
