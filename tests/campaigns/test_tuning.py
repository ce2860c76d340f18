import math
from pathlib import Path

import pytest
import yaml

from landerd.campaigns.compare import Pair
from landerd.campaigns.pool import Run
from landerd.campaigns.tuning import Objective, Tuning, check, cost_of, load_tuning, overlay
from landerd.config.files import ConfigError, config_dir, config_files
from landerd.drivers import read_configuration
from tests.campaigns.landings import landing

TIME = Objective(time_s=1.0)


def runs(*times: float, **changes: object) -> list[Run]:
    return [
        Run("radial", n, landing("radial", n, time_s=t, **changes))
        for n, t in enumerate(times, start=1)
    ]


@pytest.mark.parametrize("name", list(config_files("tunings")))
def test_both_ends_of_every_packaged_range_are_good_configuration(name: str) -> None:
    tuning = load_tuning(name)
    for end in (0.0, 1.0):
        (row, *_) = tuning.rows(tuning.at([end] * len(tuning.parameters)))
        read_configuration(config_dir() / "default.yaml", overrides=row.settings)


def test_the_cost_is_the_weighted_sum_of_the_results_figures() -> None:
    objective = Objective(time_s=1.0, touchdown_error_m=10.0)
    assert cost_of(runs(20.0, 22.0, touchdown_error_m=0.1), objective).mean == pytest.approx(22.0)


def test_a_failed_flight_costs_more_than_any_slow_one() -> None:
    slow = cost_of(runs(60.0, 60.0), TIME)
    fast = runs(10.0, 10.0)
    failing = cost_of([fast[0], Run("radial", 2, None, "ValueError: no (x.py:1)")], TIME)
    breaking = cost_of(runs(10.0, rules_broken=["3: too fast (at 4.21 s)"]), TIME)
    assert sorted([breaking, failing, slow]) == [slow, failing, breaking]
    assert breaking.mean == math.inf


def test_a_day_beyond_the_vehicle_does_not_count_in_the_cost() -> None:
    day = Run("field", 2, landing("field", 2, landed=False, time_s=None, infeasible="gale"))
    assert cost_of([*runs(20.0), day], TIME) == cost_of(runs(20.0), TIME)


def test_tried_values_are_rounded_and_within_their_range() -> None:
    tuning = Tuning(scenarios=("radial",), parameters={"a.kp": (0.1, 1.2345)}, objective=TIME)
    assert tuning.at([0.3333]) == {"a.kp": 0.478}
    assert tuning.at([1.0]) == {"a.kp": 1.23}
    assert tuning.place({"a.kp": 5.0}) == [1.0]


def pairs(before: list[Run], after: list[Run]) -> list[Pair]:
    return [Pair(a, b) for a, b in zip(before, after, strict=True)]


def test_a_winner_holds_if_it_is_cheaper_by_more_than_chance() -> None:
    before = runs(20.0, 25.0, 30.0, 22.0)
    assert check(pairs(before, runs(19.0, 23.9, 29.1, 21.0)), TIME)["holds"]
    by_chance = check(pairs(before, runs(15.0, 29.0, 31.0, 20.0)), TIME)
    assert by_chance["why_not"] == ["the gain may be chance"]


def test_a_faster_winner_that_fails_or_breaks_a_rule_does_not_hold() -> None:
    before = runs(20.0, 25.0, 30.0, 22.0)
    lost = [*runs(10.0, 15.0, 20.0), Run("radial", 4, None, "ValueError: no (x.py:1)")]
    assert "3 succeed instead of 4" in check(pairs(before, lost), TIME)["why_not"]
    rule = runs(10.0, 15.0, 20.0, 12.0, rules_broken=["3: too fast (at 4.21 s)"])
    assert "rules were broken" in check(pairs(before, rule), TIME)["why_not"]


def test_a_winner_is_not_confirmed_by_days_beyond_the_vehicle() -> None:
    day = Run("field", 2, landing("field", 2, landed=False, time_s=None, infeasible="gale"))
    assert not check(pairs([day], [day]), TIME)["holds"]


def test_the_file_of_gains_can_be_included_in_a_configuration(tmp_path: Path) -> None:
    text = overlay({"guidance.tracking.kp": 1.5, "guidance.tracking.ki": 0.25}, ["it holds"])
    assert text.startswith("# it holds\n")
    assert yaml.safe_load(text) == {"guidance": {"tracking": {"kp": 1.5, "ki": 0.25}}}
    (tmp_path / "gains.yaml").write_text(text)
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"include: [{config_dir() / 'default.yaml'}, gains.yaml]\n")
    assert read_configuration(mine).config.guidance.tracking.kp == 1.5


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("parameters: {a: [2, 1]}", "a: found 2 to 1, expected less to more"),
        ("parameters: {a: [1, 2]}\nobjective: {}", "found no weight above 0"),
        ("parameters: {a: [1, 2]}\nscenarios: [hoover]", "scenario 'hoover' is not known"),
    ],
)
def test_a_wrong_tuning_is_refused_with_the_reason(text: str, says: str, tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    rest = {"scenarios": "[hover]", "objective": "{time_s: 1}"}
    mine.write_text("\n".join([text, *(f"{k}: {v}" for k, v in rest.items() if k not in text)]))
    with pytest.raises(ConfigError, match=says):
        load_tuning(str(mine))
