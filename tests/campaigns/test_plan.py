import pickle
from pathlib import Path

import pytest

from landerd.campaigns import plan
from landerd.campaigns.plan import Campaign, Grid, Sweep, load_campaigns
from landerd.config.files import ConfigError, config_dir, config_files
from landerd.config.models import Config
from landerd.drivers import read_configuration

pytestmark = pytest.mark.long


@pytest.mark.parametrize("name", list(config_files("campaigns")))
def test_every_campaign_can_be_flown(name: str) -> None:
    rows = [row for campaign in load_campaigns(name).values() for row in campaign.all_rows]
    overlays = config_files("scenarios")
    for row in rows:
        read_configuration(
            config_dir() / "default.yaml",
            overlays=[overlays[row.scenario]],
            overrides=row.settings,
            seed=1,
        )


def test_a_sweep_is_a_row_for_every_value_in_every_scenario() -> None:
    sweep = Sweep(
        scenarios=("hover", "moving"),
        key="sim.camera.tone.curve",
        values=("srgb", 2),
        settings=("a=1",),
    )
    rows = Campaign(sweeps=(sweep,)).all_rows
    assert [row.name for row in rows] == [
        "hover --set 'a=1' --set 'sim.camera.tone.curve=\"srgb\"'",
        "hover --set 'a=1' --set 'sim.camera.tone.curve=2'",
        "moving --set 'a=1' --set 'sim.camera.tone.curve=\"srgb\"'",
        "moving --set 'a=1' --set 'sim.camera.tone.curve=2'",
    ]


def test_a_grid_is_a_row_for_every_combination_labelled_by_its_values() -> None:
    keys = {"guidance.pid.up.kp": (0.6, 0.7), "guidance.pid.up.kd": (0.4, 0.5)}
    thesis = {"0.7 0.4": {"time_s": 13.8}}
    grid = Grid.model_validate({"scenario": "hover", "keys": keys, "thesis": thesis})
    rows = Campaign(grids=(grid,)).all_rows
    assert [row.label for row in rows] == ["0.6 0.4", "0.6 0.5", "0.7 0.4", "0.7 0.5"]
    assert [row.thesis.time_s for row in rows] == [None, None, 13.8, None]
    assert rows[0].settings == ("guidance.pid.up.kp=0.6", "guidance.pid.up.kd=0.4")


def test_a_grid_flies_its_values_as_they_are_and_rounds_them_in_its_labels_only() -> None:
    keys = {"sim.autopilot.boot_age_s": (4294960.25,), "sim.autopilot.rc_channels": (8,)}
    (row,) = Grid.model_validate({"scenario": "hover", "keys": keys}).rows()
    assert row.settings == ("sim.autopilot.boot_age_s=4294960.25", "sim.autopilot.rc_channels=8")
    assert row.label == "4.29496e+06 8"


def test_all_of_the_thesis_is_every_one_of_its_experiments() -> None:
    parts = load_campaigns("all-thesis")
    names = "gimbal whycon-pose whycode-orientation apriltag-pose apriltag-yaw tune-ne tune-up yaw"
    assert list(parts) == [*names.split(), "linear", "radial", "moving", "wind"]
    for name, sets in (("tune-ne", 81), ("tune-up", 16)):
        assert sum(len(list(grid.rows())) for grid in parts[name].grids) == sets
    published = [row.thesis.time_s for part in parts.values() for row in part.all_rows]
    assert sum(time is not None for time in published) == 17


def test_every_flight_of_the_thesis_is_flown_by_its_controller_and_by_landerds() -> None:
    for name, campaign in load_campaigns("all-thesis").items():
        flown = [row for row in campaign.all_rows if row.goal != "poses"]
        other = ("guidance.method=pid", "aim.method=increment")
        by_thesis = [any(each in row.settings for each in other) for row in flown]
        assert not flown or {*by_thesis} == {True, False}, name


def test_a_campaign_of_ones_own_is_a_file(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("rows: [{scenario: hover, label: mine}]")
    (campaign,) = load_campaigns(str(mine)).values()
    assert campaign.all_rows[0].label == "mine"


def test_a_row_is_found_by_its_name_in_another_process_too() -> None:
    campaign = pickle.loads(pickle.dumps(load_campaigns("effects")["effects"]))
    assert [campaign.row(row.name) for row in campaign.all_rows] == list(campaign.all_rows)


def test_scenarios_leave_landerds_own_configuration_as_it_is() -> None:
    configs: list[dict[str, object]] = []
    for path in [*config_files("scenarios").values(), None]:
        # A switch of three positions is the user's own choice: those of the hold have one.
        own = set(Config.model_fields) - (
            {"rc"} if path and path.stem.startswith("hold") else set()
        )
        loaded = read_configuration(config_dir() / "default.yaml", overlays=[path] if path else [])
        configs.append(loaded.config.model_dump(include=own))
    default = configs[-1]
    assert all(config == {key: default[key] for key in config} for config in configs)


def test_a_scenario_is_a_campaign_of_one_row() -> None:
    (row,) = load_campaigns("hover")["hover"].rows
    assert row.scenario == "hover"
    assert row.needed.landed_percent == 100.0


def test_an_unknown_campaign_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(ConfigError, match="'guidence' is not known; nearest: guidance; all: "):
        load_campaigns("guidence")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("rows: []", "mine.yaml:1: found no rows, expected at least one"),
        ("runs: 0\nrows: [{scenario: hover}]", "mine.yaml:1: runs: found 0, expected a whole"),
        ("rows: [{scenario: hover}, {scenario: hover}]", "mine.yaml:1: found the row 'hover' tw"),
        ("rows: [{scenario: hover, goal: poses}]", "mine.yaml:1: rows.0: expected poses with goal"),
        (
            "grids: [{scenario: hover, keys: {a: [1, 2]}, thesis: {'3': {time_s: 1}}}]",
            "mine.yaml:1: grids.0: thesis: '3' is no combination of the values",
        ),
        ("rows: [{scenario: hoover}]", "mine.yaml: scenario 'hoover' is not known; nearest: hover"),
        (
            "rows:\n  - scenario: hover\n    needed: {time_mean: 3}",
            "mine.yaml:3: rows.0.needed.time_mean: unknown key; nearest known key: "
            "rows.0.needed.time_s_mean",
        ),
    ],
)
def test_a_wrong_campaign_file_is_refused_with_file_line_and_key(
    text: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(text)
    monkeypatch.chdir(tmp_path)
    folders = {"campaigns": {"mine": mine}, "scenarios": config_files("scenarios")}
    monkeypatch.setattr(plan, "config_files", folders.__getitem__)
    with pytest.raises(ConfigError) as e:
        load_campaigns("mine")
    assert e.value.lines[0].startswith(says)
