"""`landerd sim`, once as a process; its wrong input is in tests/test_cli.py."""

import errno
import json
import re
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from landerd.cli import main
from landerd.messages import Command, Input
from landerd.runtime.observer import Observer
from landerd.simulation import flight
from tests.simulated import ABOVE
from tests.test_cli import landerd

pytestmark = pytest.mark.long


def test_a_landing_is_printed_as_one_json_object_and_nothing_else() -> None:
    low = ["--set", "sim.start.altitude_m=2.5", "--set", "aim.idle_pitch_deg=-90"]
    low += ["--set", "sim.camera.fps=15"]
    done = landerd("sim", "hover", "--seed", "3", "--json", *low)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    result = json.loads(line)
    assert (result["landed"], result["seed"], result["scenario"]) == (True, 3, "hover")
    assert 0.5 < result["nis_ratio"] < 1.2  # of a flight of some seconds
    assert result["refused_percent"] < 5.0


def test_a_flight_that_does_not_land_is_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert flight.LONGEST_S == 150.0
    monkeypatch.setattr(flight, "simulate", partial(flight.simulate, longest_s=5.0))
    nothing_to_see = ["--set", "sim.start.position_m=[-500, 0]", "--set", "sim.camera.fps=0.1"]
    assert main(["sim", *nothing_to_see]) == 1
    out = capsys.readouterr().out
    assert out.startswith("Did not land: not landed in 5 s: NOT_LANDING, ")


class Busy(Observer):
    """A computer that is busy with something else for a moment."""

    _is_done = False

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        if not self._is_done:
            time.sleep(0.15)
        self._is_done = True


def test_a_computer_too_slow_for_a_flight_in_real_time_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def short(*args: Any, **kwargs: Any) -> dict[str, Any]:
        kwargs["watch"] = lambda daemon: daemon.observe(Busy())
        return simulate(*args, **kwargs, longest_s=1.0)

    simulate = flight.simulate
    monkeypatch.setattr(flight, "simulate", short)
    assert main(["sim", "hover", "--realtime", "--set", "sim.sight=modelled"]) == 1
    out = capsys.readouterr().out
    (line,) = [line for line in out.splitlines() if "too busy" in line]
    held_up_ms = int(re.findall(r"by up to (\d+) ms", line)[0])
    assert held_up_ms > 100
    assert main(["sim", "hover", "--set", "sim.sight=modelled"]) == 1
    assert "too busy" not in capsys.readouterr().out


def test_the_result_is_printed_even_if_the_picture_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "full.png"
    picture.symlink_to("/dev/full")
    near = [word for setting in (*ABOVE, "sim.start.altitude_m=1.0") for word in ("--set", setting)]
    assert main(["sim", "hover", "--seed", "3", "--picture", str(picture), *near]) == 2
    told = capsys.readouterr()
    assert told.out.startswith("Landed (scenario hover, seed 3)")
    assert "picture" not in told.out
    assert told.err == f"{picture}: cannot be written: No space left on device\n"


def test_both_logs_that_a_full_disk_cuts_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(fd: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("landerd.flightlog.disk.os.write", write)
    log = tmp_path / "full.mcap"
    near = [word for setting in (*ABOVE, "sim.start.altitude_m=1.0") for word in ("--set", setting)]
    assert main(["sim", "hover", "--log", str(log), *near]) == 2
    told = capsys.readouterr()
    assert "flight log" not in told.out
    named = [line.split(": ")[0] for line in told.err.splitlines()]
    assert named == [str(log), str(log.with_suffix(".tlog"))]


def test_a_rule_that_a_fault_made_impossible_to_keep_is_reported_as_excused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    stall = "sim.faults=[{fault: loop-stalls, at: {phase: DESCENT, after_s: 1}, severity: 0.2}]"
    near = [word for setting in (*ABOVE, stall) for word in ("--set", setting)]
    main(["sim", "stationary", *near])
    out = capsys.readouterr().out
    (danger,) = [line for line in out.splitlines() if "danger" in line]
    assert re.fullmatch(
        r"  danger: motion on a set-point older than 0.2 s \(at [\d.]+ s\), excused by a fault",
        danger,
    )
    assert re.search(r"broken: 3: set-points less .* Hz \(at [\d.]+ s\), excused by a fault\n", out)


def test_each_log_of_a_flight_with_a_restart_is_named_and_none_is_left_of_a_run_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, second = tmp_path / "k.mcap", tmp_path / "k.restart-2.mcap"
    mine = [tmp_path / "k-2.mcap", tmp_path / "k-2.tlog"]  # as of one seed a log
    for path in mine:
        path.write_bytes(b"another flight")
    near = ["--log", str(log)]
    near += [
        word for setting in (*ABOVE, "sim.start.altitude_m=1.0") for word in ("--set", setting)
    ]
    killed = "sim.faults=[{fault: killed, at: {time_s: 0.5}}]"
    main(["sim", "hover", *near, "--set", killed])
    named = re.findall(r"flight log: (\S+)", capsys.readouterr().out)
    assert named == [str(log), str(second)]
    assert second.exists()
    main(["sim", "hover", *near])
    assert re.findall(r"flight log: (\S+)", capsys.readouterr().out) == [str(log)]
    assert not second.exists()
    assert not second.with_suffix(".tlog").exists()
    assert [path.read_bytes() for path in mine] == 2 * [b"another flight"]
