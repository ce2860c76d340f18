import json
from collections.abc import Mapping
from typing import Any

from landerd.campaigns.effects import effects_of
from landerd.campaigns.plan import Campaign, Sweep, campaign_of
from landerd.campaigns.pool import Run
from tests.campaigns.landings import landing

KEY = "sim.camera.clock_offset_s"
VALUES = (-0.03, -0.02, -0.01, 0.02, 0.03)
SWEEP = Sweep(scenarios=("stationary", "moving-5"), key=KEY, values=VALUES)


def flown(campaign: Campaign, failing: Mapping[tuple[str, Any], int]) -> dict[str, list[Run]]:
    """Return ten runs of each row; of the given rows only this many land."""
    runs = {}
    for row in campaign.all_rows:
        value = json.loads(row.settings[-1].partition("=")[2])
        good = failing.get((row.scenario, str(value)), 10)
        runs[row.name] = [
            Run(row.name, seed, landing(row.name, seed, landed=seed <= good))
            for seed in range(1, 11)
        ]
    return runs


def marks(campaign: Campaign, runs: dict[str, list[Run]], nominal: Any) -> dict[str, str]:
    found = effects_of(campaign, runs, lambda key: nominal)
    assert found is not None
    return {line[1]: line[-1] for line in found.table.rows}


def test_one_line_for_each_value_with_both_scenarios_beside_each_other() -> None:
    campaign = Campaign(sweeps=(SWEEP,))
    found = effects_of(campaign, flown(campaign, {("moving-5", "0.03"): 7}), lambda key: 0.0)
    assert found is not None
    table, said = found
    assert len(table.rows) == len(VALUES)
    assert list(table.rows[-1]) == [
        "camera.clock_offset_s", "0.03", "10/10", "18.0", "0.020", "0", "7/10", "18.0", "0.020",
        "0", "first to fail",
    ]  # fmt: skip
    assert table.strong == {4}
    assert said == [
        "camera.clock_offset_s 0.03, moving-5: failed with seeds 8, 9, 10",
        "camera.clock_offset_s 0.03, moving-5: landed: seeds 8, 9, 10",
    ]


def test_the_first_to_fail_is_the_nearest_to_the_nominal_value_on_either_side() -> None:
    campaign = Campaign(sweeps=(SWEEP,))
    failing = {("stationary", str(v)): 9 for v in (-0.03, -0.02, 0.02, 0.03)}
    runs = flown(campaign, failing)
    assert marks(campaign, runs, 0.005) == {
        "-0.03": "fails", "-0.02": "first to fail", "-0.01": "", "0.02": "first to fail",
        "0.03": "fails",
    }  # fmt: skip
    # Had it been far above all of them, the greatest would be the nearest.
    assert marks(campaign, runs, 1.0)["0.03"] == "first to fail"
    assert marks(campaign, runs, 1.0)["-0.02"] == "fails"


def test_of_words_every_failing_value_is_the_first_to_fail() -> None:
    grounds = ("gravel", "canopy", "water")
    campaign = Campaign(
        sweeps=(Sweep(scenarios=("stationary",), key="sim.render.ground", values=grounds),)
    )
    runs = flown(campaign, {("stationary", "gravel"): 9, ("stationary", "water"): 0})
    found = marks(campaign, runs, "grass")
    assert found == {"gravel": "first to fail", "canopy": "", "water": "first to fail"}


def test_a_value_beyond_the_vehicle_does_not_count_as_failed() -> None:
    campaign = Campaign(
        sweeps=(Sweep(scenarios=("moving-5",), key="sim.wind.speed_mps", values=(8.0, 9.0)),)
    )
    runs = {}
    for row, broken in zip(campaign.all_rows, ([], ["3: too fast (at 1.00 s)"]), strict=True):
        lost = {"landed": False, "outcome": "handed_back", "touchdown_error_m": None}
        beyond = {"infeasible": "too much wind", "rules_broken": broken}
        runs[row.name] = [Run(row.name, 1, landing(row.name, 1, **lost, **beyond))]
    found = effects_of(campaign, runs, lambda key: 0.0)
    assert found is not None
    assert [line[-1] for line in found.table.rows] == ["beyond the vehicle", "first to fail"]
    assert "wind.speed_mps 8.0, moving-5: handed_back (too much wind): seeds 1" in found.said


def test_cells_of_flights_still_to_fly_are_empty() -> None:
    campaign = Campaign(sweeps=(SWEEP,))
    runs = {k: v for k, v in flown(campaign, {}).items() if "-0.03" in k and "moving" in k}
    found = effects_of(campaign, runs, lambda key: 0.0)
    assert found is not None
    ((*_, stationary, _, _, _, moving, _, _, _, mark),) = found.table.rows
    assert (stationary, moving, mark) == ("", "10/10", "")
    assert effects_of(campaign, {}, lambda key: 0.0) is None


def test_sweeps_are_recovered_from_the_names_of_their_rows() -> None:
    gate = ("sim.autopilot.gate=override",)
    other = Sweep(
        scenarios=("moving-5",), key="sim.gimbal.mount", values=([1.0, 2],), settings=gate
    )
    campaign = Campaign(sweeps=(SWEEP, other))
    names = [row.name for row in campaign.all_rows]
    again = campaign_of([*names, "stationary --set 'guidance.method=pid'"])
    assert again.sweeps == campaign.sweeps
    assert [row.name for row in again.rows] == ["stationary --set 'guidance.method=pid'"]
