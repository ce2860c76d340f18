"""`landerd bench-test` with a simulated vehicle; drivers, core and vision are the real ones."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from landerd.cli import main
from landerd.config.files import config_dir

pytestmark = pytest.mark.long

DEFAULT = str(config_dir() / "default.yaml")
FEW = ("-c", DEFAULT, "--pictures", "3", "--set", "sim.camera.fps=10")
BENCH = (*FEW, "--height", "1.5", "--mark", "2.6,0.2", "--json")
TOLD_WELL = ("--set", "gimbal.driver=simplebgc", "--set", "sim.gimbal.bias_deg=0.0")


def bench(capsys: pytest.CaptureFixture[str], test: str, *more: str) -> tuple[int, dict[str, Any]]:
    code = main(["bench-test", test, *BENCH, *more])
    report: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return code, report


def test_a_sound_camera_is_a_go_and_each_picture_is_in_the_table(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "bench.csv"
    code, report = bench(capsys, "pose", "-o", str(file))
    assert (code, report["verdict"], report["refused"]) == (0, "go", [])
    (row,) = report["rows"]
    assert row["range_percent"] < 0.5
    assert row["angle_deg"] < 1.5  # half a degree of bias of each axis of the reference world
    pictures = list(csv.DictReader(file.read_text().splitlines()))
    assert len(pictures) == 3
    for picture in pictures:
        assert float(picture["ahead_m"]) == pytest.approx(2.6, abs=0.06)
        assert float(picture["right_m"]) == pytest.approx(0.2, abs=0.06)
        assert float(picture["down_m"]) == pytest.approx(1.5, abs=0.06)


@pytest.mark.parametrize(
    ("wrong", "figure"),
    [
        ("sim.pad.print_scale=1.08", "range_percent"),
        ("sim.gimbal.mount={pitch_zero_deg: 7}", "angle_deg"),
    ],
)
def test_a_wrong_print_and_a_gimbal_mounted_askew_each_fail_by_their_own_figure(
    wrong: str, figure: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, report = bench(capsys, "pose", *TOLD_WELL, "--set", wrong)
    assert (code, report["verdict"]) == (1, "no-go")
    (row,) = report["rows"]
    others = {"range_percent", "angle_deg"} - {figure}
    assert row[figure] > 5.0
    assert all(row[other] < 2.0 for other in others)


def test_a_gimbal_centres_the_pad_and_a_slow_one_is_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, report = bench(capsys, "gimbal", *TOLD_WELL)
    assert (code, report["verdict"]) == (0, "go")
    assert len(report["rows"]) == 4  # pitch and yaw, to either side
    assert all(row["centred_s"] < 0.6 for row in report["rows"])
    code, report = bench(capsys, "gimbal", "--set", "sim.gimbal.rate_limit_deg_s=6")
    assert (code, report["verdict"]) == (1, "no-go")
    assert "pitch does not follow" in report["refused"][0]


def test_a_pad_that_is_not_found_is_reported_with_what_to_look_at(
    capsys: pytest.CaptureFixture[str],
) -> None:
    too_far = ("--height", "1.5", "--mark=20,0", "--set", "sim.camera.fps=3")
    code = main(["bench-test", "pose", *FEW, *too_far])
    out = capsys.readouterr().out
    assert code == 1
    assert "no-go: 20,0: the pad is nowhere to be seen" in out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--mark", "2"], "found '2', expected AHEAD,RIGHT in m"),
        (["--mark", "200,0"], "expected AHEAD,RIGHT in m, as 2,-0.5, each at most 50"),
        (["--height", "nan"], "expected metres from 0.2 to 30"),
        (["--set", "gimbal.driver=fixed"], "fixed does not turn"),
        (["-o", "/nowhere/a.csv"], "its folder does not exist"),
        (["--without-autopilot", "--set", "gimbal.driver=mavlink"], "needs the autopilot's link"),
    ],
)
def test_wrong_input_is_one_line(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["bench-test", "gimbal", *BENCH, *arguments])
    except SystemExit as e:
        code = int(e.code or 0)
    assert code == 2
    assert says in capsys.readouterr().err.splitlines()[-1]


def on_a_vehicle(answers: str) -> subprocess.CompletedProcess[str]:
    """Run bench-test on a vehicle whose devices are missing, with typed answers."""
    vehicle = str(config_dir() / "vehicles" / "pixhawk-usb.yaml")
    places = ("--height", "1.5", "--mark", "2,0", "--mark", "3,0")
    words = [sys.executable, "-m", "landerd", "bench-test", "pose", "-c", vehicle, *places]
    return subprocess.run(
        words, input=answers, capture_output=True, text=True, timeout=300, check=False
    )


def test_devices_that_are_not_there_are_told_at_each_mark() -> None:
    done = on_a_vehicle("\n\n")
    assert done.returncode == 1
    assert "its landing point on the mark 3,0" in done.stdout
    assert done.stdout.count("/dev/landerd-autopilot is not there") == 2
    assert done.stderr == ""


def test_without_standard_input_it_is_refused() -> None:
    done = on_a_vehicle("")
    assert done.returncode == 2
    assert done.stderr == "nobody can press Enter: standard input has ended\n"
