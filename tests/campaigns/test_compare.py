from collections.abc import Sequence
from random import Random

import pytest

from landerd.campaigns.compare import as_text, compare
from landerd.campaigns.pool import Run, Task
from tests.campaigns.landings import landing


def flown(scenario: str = "radial", **series: Sequence[object]) -> dict[Task, Run]:
    """Return runs with seeds 1, 2, 3 and so on, whose results have these values."""
    count = len(next(iter(series.values())))
    return {
        (scenario, n + 1): Run(
            scenario, n + 1, landing(scenario, n + 1, **{k: v[n] for k, v in series.items()})
        )
        for n in range(count)
    }


def test_a_small_gain_shows_in_pairs_though_the_days_differ_by_much() -> None:
    rng = Random(1)
    days = [20.0 + rng.gauss(0.0, 5.0) for _ in range(20)]
    faster = [t - 0.5 + rng.gauss(0.0, 0.3) for t in days]
    (row,) = compare(flown(time_s=days), flown(time_s=faster))
    time = row["figures"]["time_s"]
    assert time["verdict"] == "better"
    assert time["change"] == pytest.approx(-0.5, abs=0.2)
    assert time["change_95"][1] < 0.0
    assert row["figures"]["energy_hj"]["verdict"] == "same"


def test_a_difference_within_noise_is_reported_as_the_same() -> None:
    rng = Random(2)
    a, b = ([20.0 + rng.gauss(0.0, 1.0) for _ in range(10)] for _ in range(2))
    (row,) = compare(flown(time_s=a), flown(time_s=b))
    assert row["figures"]["time_s"]["verdict"] == "same"


def test_fewer_landings_are_worse_only_if_significant() -> None:
    good = flown(landed=[True] * 10)
    few = flown(landed=[False] * 3 + [True] * 7)
    many = flown(landed=[False] * 7 + [True] * 3)
    assert compare(good, few)[0]["succeeded"]["verdict"] == "same"
    (row,) = compare(good, many)
    assert row["succeeded"]["verdict"] == "worse"
    assert row["succeeded"]["only_a_seeds"] == [1, 2, 3, 4, 5, 6, 7]
    assert compare(many, good)[0]["succeeded"]["verdict"] == "better"


def test_a_broken_rule_is_no_success() -> None:
    broken = [["3: too fast (at 4.21 s)"]] * 6
    (row,) = compare(flown(rules_broken=[[]] * 6), flown(rules_broken=broken))
    assert (row["succeeded"]["a"], row["succeeded"]["b"]) == (6, 0)
    assert row["succeeded"]["verdict"] == "worse"


def test_errors_are_compared_by_their_size() -> None:
    a, b = flown(yaw_error_deg=[-4.0, 4.0, -4.1]), flown(yaw_error_deg=[1.0, -1.0, 1.1])
    assert compare(a, b)[0]["figures"]["yaw_error_deg"]["change"] == pytest.approx(-3.0)


def test_several_rows_are_also_taken_together() -> None:
    a = flown("radial", time_s=[20.0, 21.0]) | flown("moving", time_s=[20.0, 21.0])
    b = flown("radial", time_s=[19.0, 20.1]) | flown("moving", time_s=[19.0, 20.1])
    b["hover", 1] = Run("hover", 1, landing("hover", 1))
    assert [row["scenario"] for row in compare(a, b)] == ["radial", "moving", "all rows"]
    text = as_text(compare(a, b))
    assert "radial (2 pairs)\n" in text
    assert "4/4 (51 to 100 %)" in text
    assert "better" in text


def test_pairs_without_a_figure_are_left_out_of_it() -> None:
    a = flown(time_s=[None, 20.0])
    a["radial", 1] = Run("radial", 1, None, "ValueError: no (world.py:1)")
    (row,) = compare(a, flown(time_s=[18.0, 19.0]))
    assert row["figures"]["time_s"]["pairs"] == 1
    assert row["figures"]["time_s"]["change_95"] is None
    assert row["succeeded"]["only_b_seeds"] == [1]
