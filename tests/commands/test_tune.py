import json
import os
from collections.abc import Generator, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

from landerd.campaigns.pool import Run, RunOne, Task
from landerd.cli import main
from landerd.commands import flying
from tests.campaigns.landings import landing

TUNING = """
scenarios: [hover]
settings: [guidance.tracking.kp=1.0]
parameters: {guidance.tracking.kp: [0.5, 4.0], guidance.tracking.ki: [0.0, 1.0]}
objective: {time_s: 1.0}
seeds: 3
fresh: 5
sets: 24
"""


@dataclass
class Flights:
    """The simulated flights that were asked for, and the name that fails on fresh seeds."""

    asked: list[Task] = field(default_factory=list)
    fails: str = "none"


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> Flights:
    """Replaces the simulator: the nearer kp is to 3, the faster it lands."""
    flights = Flights()

    def run_all(run_one: RunOne, tasks: Iterable[Task], jobs: int) -> Generator[Run]:
        for name, seed in tasks:
            flights.asked.append((name, seed))
            if flights.fails in name and seed > 1000:
                yield Run(name, seed, None, "ValueError: no (x.py:1)")
                continue
            kp = float(name.rpartition("tracking.kp=")[2].partition("'")[0])
            yield Run(name, seed, landing(name, seed, time_s=20.0 + seed + abs(kp - 3.0)))

    monkeypatch.setattr(flying, "run_all", run_all)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    return flights


def tune(tmp_path: Path, *arguments: str, text: str = TUNING) -> int:
    mine = tmp_path / "mine.yaml"
    mine.write_text(text)
    return main(["tune", str(mine), *arguments])


def found(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(capsys.readouterr().out)
    return loaded


def test_a_grid_finds_the_best_and_checks_it_on_other_seeds(
    flown: Flights, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "gains.yaml"
    assert tune(tmp_path, "--search", "grid", "--json", "-o", str(out)) == 0
    result = found(capsys)
    assert result["winner"]["values"]["guidance.tracking.kp"] == 2.25
    assert result["fresh"]["holds"]
    assert {seed for _, seed in flown.asked} == {1, 2, 3, *range(1001, 1006)}
    assert len(flown.asked) == len(set(flown.asked))
    assert yaml.safe_load(out.read_text())["guidance"]["tracking"]["kp"] == 2.25
    assert "on 5 fresh seeds of each it holds" in out.read_text()


def test_cma_es_finds_an_optimum_between_the_grid_points(
    flown: Flights, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("cmaes")
    assert tune(tmp_path, "--json") == 0
    assert found(capsys)["winner"]["values"]["guidance.tracking.kp"] == pytest.approx(3.0, abs=0.3)


def test_a_page_shows_the_search(flown: Flights, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    page = tmp_path / "search.html"
    assert tune(tmp_path, "--search", "grid", "--report", str(page)) == 0
    text = page.read_text()
    assert text.count("<svg") == 1 + 2  # over time, and over each parameter
    (kp,) = (line for line in text.splitlines() if ">guidance.tracking.kp</td>" in line)
    assert ">0.5 to 4<" in kp
    assert ">1<" in kp
    assert ">2.25<" in kp
    assert "on 5 fresh seeds of each it holds" in text


def test_a_winner_that_fails_on_fresh_seeds_is_told_and_does_not_hold(
    flown: Flights,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    flown.fails = "kp=2.25"
    assert tune(tmp_path, "--search", "grid") == 1
    assert "DOES NOT HOLD: 0 succeed instead of 5" in capsys.readouterr().out


def test_a_search_that_was_stopped_goes_on_with_what_it_kept(
    flown: Flights, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = str(tmp_path / "runs")
    assert tune(tmp_path, "--search", "grid", "--keep", kept) == 0
    flown.asked.clear()
    assert tune(tmp_path, "--search", "grid", "--keep", kept) == 0
    assert flown.asked == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (TUNING.replace("tracking.kp", "tracking.kq"), "nearest known key: guidance.tracking.kp"),
        (TUNING.replace("4.0", "40.0"), "guidance.tracking.kp"),
        (TUNING.replace("hover", "hoover"), "scenario 'hoover' is not known"),
        (TUNING.replace("sets: 24", "sets: 5"), "sets: found 5, expected 6 or more: CMA-ES"),
    ],
)
def test_a_tuning_that_is_impossible_is_refused_in_one_line_and_nothing_is_flown(
    text: str,
    says: str,
    flown: Flights,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("cmaes")
    assert tune(tmp_path, text=text) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
    assert flown.asked == []


def test_gains_fitted_from_a_flight_are_a_valid_configuration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("cmaes")
    golden = Path(__file__).parents[1] / "golden" / "moving-pad.mcap"
    out = tmp_path / "vehicle.yaml"
    assert main(["tune", "--from", str(golden), "-o", str(out)]) == 0
    assert "m/s left unexplained" in capsys.readouterr().out
    tree = yaml.safe_load(out.read_text())
    assert tree["autopilot"]["acceleration_mps2"] == tree["sim"]["response"]["acceleration_mps2"]
    mine = ["--set", "sim.sight=modelled", "--set", "sim.start.altitude_m=0.0"]
    assert main(["sim", "hover", "-c", str(out), *mine]) == 2  # the file was read, the start is not
    assert "sim.start.altitude_m" in capsys.readouterr().err


def test_without_a_search_or_a_flight_there_is_nothing_to_do(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["tune", "--from", "flight.mcap", "--report", "search.html"]) == 2
    assert capsys.readouterr().err == "--report: expected a search, --from makes none\n"
    assert main(["tune"]) == 2
    assert capsys.readouterr().err == "expected NAME, or --from FLIGHT.mcap\n"


def test_a_wrong_key_of_a_tuning_is_told_with_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        "scenarios: [hover]\nobjective: {time_s: 1}\nparameters: {guidance.tracking.kpp: [1, 2]}\n"
    )
    assert main(["tune", str(mine), "--sets", "4"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{mine}: guidance.tracking.kpp=1: unknown key; nearest known key: ")
