import dataclasses
import json
from pathlib import Path

import pytest

from landerd.campaigns.journal import Journal, Plan, Sitting
from landerd.campaigns.pool import Run
from landerd.cli import main
from tests.campaigns.landings import landing


def kept(path: Path, **series: list[float]) -> str:
    """Write the file of a campaign and return its name."""
    with Journal(path, Plan("settings of " + path.name), Sitting("today", "0")) as journal:
        for n in range(len(next(iter(series.values())))):
            result = landing("radial", n + 1, **{key: v[n] for key, v in series.items()})
            journal.keep(Run("radial", n + 1, result))
    return str(path)


def test_figures_that_got_better_and_worse_are_marked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = kept(tmp_path / "a", time_s=[20.0, 22.0, 24.0], energy_hj=[60.0, 61.0, 62.0])
    b = kept(tmp_path / "b", time_s=[18.0, 20.1, 22.0], energy_hj=[65.0, 66.1, 67.0])
    assert main(["compare", a, b]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[-1] for line in lines if line.startswith(("  time", "  energy"))] == [
        "better",
        "worse",
    ]


def test_a_campaign_compared_with_itself_shows_no_change(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = kept(tmp_path / "a", time_s=[20.0, 22.0, 24.0])
    assert main(["compare", a, a, "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert row["pairs"] == 3
    assert {f["verdict"] for f in row["figures"].values()} == {"same"}
    assert row["succeeded"]["change"] == 0.0
    low, high = row["succeeded"]["change_95"]
    assert low < 0.0 < high


def test_a_file_that_is_no_campaigns_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = kept(tmp_path / "a", time_s=[20.0])
    other = tmp_path / "table.json"
    other.write_text('{"campaign": "thesis", "rows": []}\n')
    assert main(["compare", a, str(other)]) == 2
    assert capsys.readouterr().err == (
        f"{other}: expected a file that landerd campaign --keep has written\n"
    )
    flight = tmp_path / "flight.mcap"
    flight.write_bytes(b"\x89MCAP0\r\n")
    assert main(["compare", a, str(flight)]) == 2
    assert capsys.readouterr().err.endswith("a file that landerd campaign --keep has written\n")
    assert main(["compare", a, str(tmp_path / "none")]) == 2
    assert "cannot be read" in capsys.readouterr().err


def test_campaigns_without_a_flight_in_common_cannot_be_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = kept(tmp_path / "a", time_s=[20.0])
    b = tmp_path / "b"
    run = Run("moving", 1, landing("moving", 1))
    b.write_text('{"settings": ""}\n' + json.dumps(dataclasses.asdict(run)) + "\n")
    assert main(["compare", a, str(b)]) == 2
    assert "no flight (row and seed) is in both" in capsys.readouterr().err
