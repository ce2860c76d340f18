"""`landerd calibrate gimbal` with real drivers, models of their gimbals, and real pictures."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from landerd.cli import main
from landerd.commands import calibrate_gimbal as calibrate_gimbal_command
from landerd.config.files import config_dir
from tests.calibration.gimbal_bench import calibrated, set_up

pytestmark = pytest.mark.long


def found(report: dict[str, Any], key: str) -> Any:
    assert report["reasons"] == []
    return report["keys"][key]


def test_finds_a_swapped_sign_a_false_zero_and_the_gimbals_lag() -> None:
    wrong = (
        "gimbal.driver=simplebgc",
        "sim.gimbal.mount={yaw_sign: -1, pitch_zero_deg: 7, camera_rotation_deg: [4, 0, 0]}",
        "sim.gimbal.lag_s=0.06",
    )
    report = calibrated(set_up(*wrong))
    assert report["good"]
    assert found(report, "gimbal.simplebgc.yaw_sign") == -1
    assert found(report, "gimbal.simplebgc.pitch_sign") == 1
    assert found(report, "gimbal.simplebgc.pitch_zero_deg") == pytest.approx(7.0, abs=0.3)
    assert found(report, "gimbal.simplebgc.yaw_zero_deg") == pytest.approx(0.0, abs=0.6)
    assert found(report, "gimbal.camera_rotation_deg")[0] == pytest.approx(4.0, abs=0.3)
    for axis in ("yaw", "pitch"):
        assert report[axis]["latency_s"] == pytest.approx(0.06, abs=0.01)

    # With these keys nothing is left to mend.
    keys = [f"{key}={json.dumps(value)}" for key, value in report["keys"].items()]
    again = calibrated(set_up(*wrong, *keys))
    assert again["good"]
    for axis in ("yaw", "pitch"):
        assert again[axis]["sign"] == 1
        assert again[axis]["zero_deg"] == pytest.approx(0.0, abs=0.8)


def test_finds_how_late_a_gimbals_answers_are_and_a_pitch_that_turns_the_other_way() -> None:
    loaded = set_up("gimbal.driver=storm32", "sim.gimbal.mount={pitch_sign: -1}")
    report = calibrated(loaded, late_s=0.06)
    assert found(report, "gimbal.storm32.pitch_sign") == -1
    assert found(report, "gimbal.storm32.latency_s") == pytest.approx(0.06, abs=0.01)


def test_makes_the_tables_of_servos() -> None:
    report = calibrated(
        set_up(
            "gimbal.driver=servo_pca9685",
            "gimbal.servo_pca9685.yaw={channel: 1, table: [[-60.0, 1000.0], [60.0, 2000.0]]}",
            "sim.gimbal.mount={yaw_sign: -1, pitch_zero_deg: -7.0}",
        )
    )
    # At 1500 us the pitch servo stands at -45 by its old table, the yaw servo at 0.
    for axis, true, step in (("pitch", -52.0, 0.18), ("yaw", 0.0, -0.12)):
        table = found(report, f"gimbal.servo_pca9685.{axis}.table")
        assert [row[0] for row in table] == sorted(row[0] for row in table)
        assert {1000.0, 2000.0} <= {row[1] for row in table}  # as far as it went before
        for angle, pulse in table:
            slack = 3.0 if pulse in (1000.0, 2000.0) else 0.8  # to the ends it is a guess
            assert angle == pytest.approx(true + step * (pulse - 1500.0), abs=slack)
    assert found(report, "gimbal.servo_pca9685.lag_s") == pytest.approx(0.08, abs=0.01)


def test_finds_where_a_bolted_camera_looks() -> None:
    report = calibrated(
        set_up(
            "gimbal.driver=fixed",
            "gimbal.fixed.pitch_deg=-30.0",
            "sim.gimbal.mount={pitch_zero_deg: 4.0, camera_rotation_deg: [5.0, 0.0, 0.0]}",
        )
    )
    assert found(report, "gimbal.fixed.pitch_deg") == pytest.approx(-26.0, abs=0.5)
    assert found(report, "gimbal.camera_rotation_deg")[0] == pytest.approx(5.0, abs=0.5)


@pytest.mark.parametrize(
    ("overrides", "options", "why"),
    [
        ([], {"armed": True}, "armed: disarm it"),
        ([], {"speaks": False}, "autopilot is not heard"),
        (["sim.pad.position_m=[500.0, 0.0]", "sim.start.position_m=[-480.0, 0.0]"], {}, "nowhere"),
        (["sim.gimbal.rate_limit_deg_s=0.1"], {}, "does not follow"),
    ],
)
def test_a_gimbal_that_cannot_be_calibrated_is_refused_with_the_reason(
    overrides: list[str], options: dict[str, Any], why: str
) -> None:
    report = calibrated(set_up("gimbal.driver=simplebgc", *overrides), **options)
    assert not report["good"]
    assert [why in reason for reason in report["reasons"]] == [True]
    assert "keys" not in report


def test_the_written_keys_can_be_included_in_the_configuration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def report(*_: object, **__: object) -> dict[str, Any]:
        keys = {"gimbal.siyi.yaw_sign": -1, "gimbal.siyi.yaw_zero_deg": 1.5, "aim.lead_s": 0.2}
        return {"good": True, "reasons": [], "views": 20, "yaw": None, "pitch": None, "keys": keys}

    monkeypatch.setattr(calibrate_gimbal_command, "calibrate_gimbal", report)
    mine, output = tmp_path / "mine.yaml", tmp_path / "found.yaml"
    lines = [
        "camera: {driver: v4l2}",
        "gimbal: {driver: siyi}",
        "autopilot: {url: tcp:127.0.0.1:9}",
    ]
    mine.write_text("\n".join([f"include: [{config_dir() / 'default.yaml'}]", *lines]))
    assert main(["calibrate", "gimbal", "-c", str(mine), "-o", str(output), "--json"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert json.loads(line)["good"]
    assert yaml.safe_load(output.read_text()) == {
        "gimbal": {"siyi": {"yaw_sign": -1, "yaw_zero_deg": 1.5}},
        "aim": {"lead_s": 0.2},
    }


@pytest.mark.parametrize(
    ("lines", "arguments", "says"),
    [
        ([], [], "only flown by landerd sim"),
        (["gimbal: {driver: mavlink}"], ["--without-autopilot"], "needs the autopilot's link"),
        (["gimbal: {driver: siyi}"], ["--yes", "--places", "2"], "not with --yes"),
        (["gimbal: {driver: siyi}"], ["-o", "/nowhere/found.yaml"], "folder does not exist"),
    ],
)
def test_wrong_input_is_told_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    lines: list[str],
    arguments: list[str],
    says: str,
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("\n".join([f"include: [{config_dir() / 'default.yaml'}]", *lines]))
    assert main(["calibrate", "gimbal", "-c", str(mine), *arguments]) == 2
    assert says in capsys.readouterr().err.splitlines()[-1]
