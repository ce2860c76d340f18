import json
import os
import subprocess
import sys
import time
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

import pytest

from landerd.campaigns.plan import load_campaigns
from landerd.campaigns.pool import Run, RunOne, Task
from landerd.cli import main
from landerd.commands import flying
from landerd.config.files import config_dir
from landerd.devices import sim_options
from tests.campaigns.landings import landing
from tests.simulated import ABOVE

pytestmark = pytest.mark.long


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> dict[Task, Run | BaseException]:
    """Replaces the simulator; the result of a task may be set in it."""
    outcomes: dict[Task, Run | BaseException] = {}

    def run_all(run_one: RunOne, tasks: Iterable[Task], jobs: int) -> Generator[Run]:
        for task in tasks:
            outcome = outcomes.get(task, Run(*task, landing(*task)))
            if isinstance(outcome, BaseException):
                raise outcome
            yield outcome

    monkeypatch.setattr(flying, "run_all", run_all)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    return outcomes


def as_json(text: str) -> dict[str, Any]:
    (line,) = text.splitlines()
    loaded: dict[str, Any] = json.loads(line)
    return loaded


def test_a_campaign_is_one_json_object_with_a_row_a_scenario(
    flown: dict[Task, Run | BaseException], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", "guidance", "--runs", "3", "--json"]) == 0
    rows = as_json(capsys.readouterr().out)["rows"]
    assert len(rows) == 12
    assert {row["runs"] for row in rows} == {row["landed"] for row in rows} == {3}


def test_an_exception_is_counted_with_its_seed_and_makes_the_campaign_bad(
    flown: dict[Task, Run | BaseException], capsys: pytest.CaptureFixture[str]
) -> None:
    flown["turning", 2] = Run("turning", 2, None, "ValueError: no (world.py:1)")
    assert main(["campaign", "turning", "--runs", "3", "--json"]) == 1
    captured = capsys.readouterr()
    (row,) = as_json(captured.out)["rows"]
    assert (row["landed"], row["exceptions"], row["failed_seeds"]) == (2, 1, [2])
    assert "turning, seed 2: ValueError: no (world.py:1)\n" in captured.err


def test_a_failed_landing_is_reported_while_the_others_fly(
    flown: dict[Task, Run | BaseException], capsys: pytest.CaptureFixture[str]
) -> None:
    lost = landing("turning", 1, landed=False, outcome="handed_back")
    flown["turning", 1] = Run("turning", 1, lost)
    assert main(["campaign", "turning", "--runs", "2"]) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("turning, seed 1: did not land: handed_back\n")
    assert "1/2" in captured.out
    assert "turning: 50 % landed by the rules, needed 100 %" in captured.out


def test_a_long_campaign_says_in_a_log_how_far_it_is(
    flown: dict[Task, Run | BaseException], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", "turning", "--runs", "40"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 9
    assert lines[0] == "4 of 40, 0 failed, 0 min left"


def test_with_several_campaigns_the_one_being_flown_is_named(
    flown: dict[Task, Run | BaseException], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    several = tmp_path / "both.yaml"
    several.write_text("campaigns: [turning, stationary]\n")
    assert main(["campaign", str(several), "--runs", "1"]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if "campaigns" in line]
    assert told == ["turning: 1 of 2 campaigns", "stationary: 2 of 2 campaigns"]


def test_ctrl_c_shows_what_was_flown(
    flown: dict[Task, Run | BaseException], capsys: pytest.CaptureFixture[str]
) -> None:
    flown["turning", 3] = KeyboardInterrupt()
    assert main(["campaign", "turning", "--runs", "5"]) == 130
    out = capsys.readouterr().out
    assert "2/2" in out
    assert out.endswith("stopped after 2 of 5 runs\n")


def test_a_stopped_campaign_goes_on_with_what_it_kept(
    flown: dict[Task, Run | BaseException], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["campaign", "turning", "--runs", "5", "--json", "--keep", str(tmp_path / "runs")]
    flown["turning", 2] = Run("turning", 2, None, "ValueError: no (world.py:1)")
    flown["turning", 4] = KeyboardInterrupt()
    assert main(command) == 130
    capsys.readouterr()
    with (tmp_path / "runs").open("a") as file:
        file.write('{"scenario": "turning", "se')  # killed while it wrote
    flown["turning", 1] = flown["turning", 2] = AssertionError("flown again")
    flown["turning", 4] = Run("turning", 4, landing("turning", 4))
    for _ in range(2):
        assert main(command) == 1
        (row,) = as_json(capsys.readouterr().out)["rows"]
        assert (row["runs"], row["landed"], row["failed_seeds"]) == (5, 4, [2])
        flown["turning", 4] = flown["turning", 5] = AssertionError("flown again")


def test_a_campaign_of_poses_is_a_table_of_errors_by_distance(
    flown: dict[Task, Run | BaseException], capsys: pytest.CaptureFixture[str]
) -> None:
    name = "stationary # poses"
    seen = {"whycon": {"distance_m": 5.0, "error_m": (0.3, 0.4, 0.0), "yaw_error_rad": None}}
    picture = {"distance_m": 5.0, "markers": seen, "flipped": False, "flipped_alone": True}
    flown[name, 1] = Run(name, 1, {"scenario": name, "seed": 1, "poses": [picture]})
    assert main(["campaign", "whycon-pose", "--runs", "1"]) == 0
    out = capsys.readouterr().out
    assert "4 to 6 1/1 21-100 % 0.500 0.500 1.463" in " ".join(out.split())
    assert "without gravity: 1 of 1" in out


def test_runs_of_two_configurations_are_not_mixed(
    flown: dict[Task, Run | BaseException], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = str(tmp_path / "runs")
    assert main(["campaign", "turning", "--runs", "1", "--keep", kept]) == 0
    capsys.readouterr()
    other = ["--set", "guidance.method=pid"]
    assert main(["campaign", "turning", "--runs", "1", "--keep", kept, *other]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == f"{kept}: holds no runs of this campaign with this configuration\n"


@pytest.mark.parametrize("text", ["mine\n", "\xff\n", None])
def test_a_file_of_another_program_is_not_overwritten(
    text: str | None,
    flown: dict[Task, Run | BaseException],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    kept = tmp_path / "runs"
    if text is None:
        kept.mkdir()
    else:
        kept.write_text(text, encoding="latin-1")
    assert main(["campaign", "turning", "--runs", "1", "--keep", str(kept)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{kept}: ")
    assert text is None or kept.read_text(encoding="latin-1") == text


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["guidence"], "campaign 'guidence' is not known; nearest: guidance"),
        (["hover", "--set", "sim.pad.sped_mps=1"], "nearest known key: sim.pad.speed_mps"),
        (["hover", "--set", "pad.layout=none.yaml"], "no such file: 'none.yaml'"),
        (["none.yaml"], "none.yaml: cannot be read: No such file or directory"),
        (["faults", "--set", "gimbal.driver=fixed"], "faults need gimbal.driver sim, found fixed"),
    ],
)
def test_wrong_input_is_one_line_and_nothing_is_flown(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert says in line


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("rows: [{scenario: hover, settings: [a.b=1]}]", "a.b=1: unknown key; nearest known key: "),
        ("sweeps: [{scenarios: [hover], key: sim.pad.speed_mps, values: [0, fast]}]", "found 'fa"),
    ],
)
def test_a_wrong_setting_of_a_campaign_is_told_with_its_file(
    text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(text)
    assert main(["campaign", str(mine), "--runs", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{mine}: ")
    assert says in line
    assert main(["campaign", str(mine), "--runs", "1", "--set", "sim.pad.sped_mps=1"]) == 2
    assert "--set sim.pad.sped_mps=1: unknown key" in capsys.readouterr().err


def test_the_command_flies_the_simulator_and_counts_landings() -> None:
    low = [word for setting in (*ABOVE, "sim.start.altitude_m=1.5") for word in ("--set", setting)]
    done = subprocess.run(
        [sys.executable, "-m", "landerd", "campaign", "hover", "--runs", "2", "--json", *low],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (row,) = as_json(done.stdout)["rows"]
    assert (row["landed"], row["failed_seeds"]) == (2, [])
    assert 0.0 < row["touchdown_error_m_median"] < 0.3


SHORT = """
runs: 3
longest_s: 2
rows:
  - {scenario: hover, settings: [sim.sight=modelled], needed: {landed_percent: 0}}
"""


def test_a_killed_and_continued_campaign_gives_the_results_of_an_uninterrupted_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "environ", dict(os.environ))
    mine = tmp_path / "mine.yaml"
    mine.write_text(SHORT)
    kept = {name: tmp_path / f"{name}.jsonl" for name in ("killed", "whole")}
    command = ["campaign", str(mine), "--jobs", "1", "--json", "--keep"]
    program = [sys.executable, "-m", "landerd"]
    started = subprocess.Popen([*program, *command, kept["killed"]], stdout=subprocess.DEVNULL)
    until = time.monotonic() + 300.0
    while not kept["killed"].exists() or not _runs(kept["killed"]):
        assert time.monotonic() < until
        time.sleep(0.05)
    started.kill()
    started.wait()
    assert len(_runs(kept["killed"])) < 3
    rows = {}
    for name, path in kept.items():
        main([*command, str(path)])
        rows[name] = as_json(capsys.readouterr().out)["rows"]
    assert rows["killed"] == rows["whole"]
    assert rows["whole"][0]["runs"] == 3
    assert sorted(_runs(kept["killed"])) == sorted(_runs(kept["whole"]))


def _runs(kept: Path) -> list[str]:
    """Return the runs in a file, without their wall-clock times."""
    found = []
    for line in kept.read_text().splitlines(keepends=True):
        run = json.loads(line) if line.endswith("\n") else {}
        if "result" in run:
            del run["result"]["wall_s"]
            found.append(json.dumps(run))
    return found


def test_a_campaign_of_faults_prints_a_table_of_their_results(
    flown: dict[Task, Run | BaseException], capsys: pytest.CaptureFixture[str]
) -> None:
    note = {"fault": "gust", "severity": 0.5, "lasts_s": 1.0, "lands": True, "began": 5.0}
    note |= {"ended": 6.0, "phase": "DESCENT", "height_m": 1.0}
    harmless = {"findings": [], "excused": [], "worst_contact": {"down_mps": 0.3}}
    for seed in (1, 2):
        result = landing("field", seed, faults_flown=[note], **harmless)
        flown["field", seed] = Run("field", seed, result)
    assert main(["campaign", "faults", "--runs", "2", "--json"]) == 0
    printed = as_json(capsys.readouterr().out)
    assert printed["rows"][0]["faults"]["coverage"] == {"gust": {"DESCENT": 2}}
    assert printed["least"] == []


def test_each_seed_of_a_campaign_of_faults_flies_its_own_faults() -> None:
    landings = flying.SimulatedLanding(
        load_campaigns("faults")["faults"], config_dir() / "default.yaml", ()
    )
    (row,) = landings.campaign.all_rows
    first, second = (sim_options(landings.load(row, seed)) for seed in (1, 2))
    assert first.pilot == second.pilot == "obeys"
    assert first.faults
    assert first.faults != second.faults
