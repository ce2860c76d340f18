"""The command line as a script sees it: exit codes, stdout and stderr.

Of a real process where it is the process that matters; else of `main`, which is all that it runs.
"""

import errno
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from landerd import __version__
from landerd.cli import entry_point, main
from landerd.config.files import config_dir


def landerd(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "landerd", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


Printed = pytest.CaptureFixture[str]


def exit_code(*arguments: str) -> int:
    """Return what a process with these arguments would exit with."""
    try:
        return main(arguments)
    except SystemExit as e:  # of argparse
        return int(e.code or 0)


def wrong_input(printed: Printed, *arguments: str) -> list[str]:
    """Return the lines of stderr of a command that must refuse its input."""
    assert exit_code(*arguments) == 2
    told = printed.readouterr()
    assert told.out == ""
    return told.err.splitlines()


def test_version() -> None:
    done = landerd("--version")
    assert (done.returncode, done.stdout) == (0, f"landerd {__version__}\n")


@pytest.mark.parametrize("command", ["check", "run", "bench-test pose --height 1 --mark -2,0"])
def test_a_configuration_named_by_an_empty_variable_is_refused(
    command: str, capsys: Printed
) -> None:
    """As of -c "$CONFIGURATION" in a script that does not set it.

    Also, a place may begin with minus.
    """
    (line,) = wrong_input(capsys, *command.split(), "-c", "")
    assert "argument -c/--config: found '', expected a file or folder" in line


@pytest.mark.parametrize(
    "command",
    [
        "detect a.png --camera cameras/thesis.yaml --pad nested --draw",
        "dry-run --telemetry a.bin --video",
        "replay",
        "report",
        "compare a.jsonl",
        "campaign hover --keep",
        "pad -o",
    ],
)
def test_an_empty_file_name_is_not_taken_for_the_working_directory(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.chdir(tmp_path)
    (line,) = wrong_input(capsys, *command.split(), "")
    assert "found '', expected a file or folder" in line
    assert list(tmp_path.iterdir()) == []


def test_help_lists_every_command_and_each_has_an_example(capsys: Printed) -> None:
    listed = re.findall(r"^    ([\w-]+)", landerd("--help").stdout, re.MULTILINE)
    assert {"sim", "detect", "campaign", "run"} <= set(listed)
    for command in listed:
        assert exit_code(command, "--help") == 0
        assert f"example:\n  landerd {command} " in capsys.readouterr().out


def test_help_does_not_wait_for_numpy() -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "landerd", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "landerd.cli" in done.stderr
    assert "numpy" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["fly"], "invalid choice: 'fly'"),
        (["sim", "hoover"], "scenario 'hoover' is not known; nearest: hover; all: "),
        (["sim", "--seed", "-1"], "argument --seed: found '-1', expected a whole number"),
        (["sim", "--set", "sim.pad.sped_mps=1"], "nearest known key: sim.pad.speed_mps"),
        (["sim", "--set", "pad.layout=none.yaml"], "no such file: 'none.yaml'"),
        (["sim", "--set", "camera.calibration=none.yaml"], "no such file: 'none.yaml'"),
        (["sim", "--set", "gimbal.driver=simm"], "found 'simm', expected one of "),
        (["sim", "-c", "none.yaml"], "none.yaml: cannot be read: No such file or directory"),
        (["sim", "--set", "sim.faults=[{fault: gost, at: {time_s: 1}}]"], "found 'gost', expected"),
        (["sim", "--set", "sim.faults=[{fault: gust, at: {}}]"], "expected one of time_s, "),
        (
            [
                *("sim", "--autopilot", "tcp:127.0.0.1:1", "--takeoff", "10"),
                *("--set", "sim.faults=[{fault: gust, at: {time_s: 1}}]"),
            ],
            "sim.faults: gust cannot be simulated with --autopilot",
        ),
        (
            [
                *("sim", "--autopilot", "tcp:127.0.0.1:1"),
                *("--set", "sim.faults=[{fault: killed, at: {time_s: 1}}]"),
            ],
            "sim.faults: with --autopilot only with --takeoff",
        ),
        (["sim", "--picture", "no/such/folder.png"], "expected a .png in a folder that exists"),
        (["sim", "--autopilot", "sitl"], "--autopilot: link 'sitl': expected udpin:HOST:PORT"),
        (["sim", "--autopilot", "tcp:127.0.0.1:1"], "tcp:127.0.0.1:1: no connection: "),
        (["sim", "--autopilot", "tcp:127.0.0.1:1", "--realtime"], "--realtime: not with --auto"),
        (["sim", "--takeoff", "10"], "--takeoff: only with --autopilot URL"),
        (["sim", "--set", "sim.autopilot.hold_s=3"], "set the latter too"),
        (
            ["sim", "--set", "guidance.output=landing_target"],
            "needs ArduPilot's own prec",
        ),
        (["campaign", "hover", "--set", "guidance.output=landing_target"], "needs ArduPilot's own"),
        (["sim", "--takeoff", "high"], "found 'high', expected metres from 2 to 100"),
        (["run"], "required: -c/--config"),
        (["run", "-c", str(config_dir() / "default.yaml")], "camera.driver: sim is only flown by"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    arguments: list[str],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Printed,
) -> None:
    monkeypatch.chdir(tmp_path)
    (line,) = wrong_input(capsys, *arguments)
    assert says in line


@pytest.mark.parametrize("command", ["sim hoover", "sim --seed -1"])  # landerd's own, argparse's
def test_a_process_with_wrong_input_exits_with_2_after_one_line(command: str) -> None:
    done = landerd(*command.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1


def test_simulated_faults_of_a_gimbal_that_is_not_simulated_are_refused(capsys: Printed) -> None:
    faults = "sim.faults=[{fault: gimbal-lost, at: {time_s: 1}}]"
    lines = wrong_input(capsys, "sim", "--set", "gimbal.driver=siyi", "--set", faults)
    assert lines[-1] == "sim.faults: gimbal-lost needs gimbal.driver sim, found siyi"


def test_a_wrong_configuration_gives_one_line_for_each_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text("rc:\n  gate_channel: eleven\n  gate: 1\n")
    assert wrong_input(capsys, "sim", "-c", "mine.yaml") == [
        "mine.yaml:2: rc.gate_channel: found 'eleven', expected a whole number "
        "at least 5 and at most 18",
        "mine.yaml:3: rc.gate: unknown key; nearest known key: rc.gate_channel",
    ]


def test_a_reader_that_closes_the_pipe_causes_no_error_message() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "landerd", "sim", "--help"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ""
    process.stderr.close()
    assert process.wait(30) == 141  # as if SIGPIPE had ended it


GOLDEN = Path(__file__).parent / "golden" / "gate-closed.mcap"


def in_shell(command: str) -> subprocess.CompletedProcess[str]:
    """Run `landerd ...` with what a shell can do to its streams."""
    line = command.replace("landerd", f"{sys.executable} -m landerd", 1)
    return subprocess.run(
        ["bash", "-c", line], capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_disk_behind_stdout_is_reported_in_one_line(
    unbuffered: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    done = in_shell(f"landerd replay {GOLDEN} > /dev/full")
    assert done.returncode == 2
    assert done.stderr == "standard output cannot be written: No space left on device\n"


def test_closed_standard_streams_cause_no_error() -> None:
    done = in_shell(f"landerd replay {GOLDEN} >&-")
    assert (done.returncode, done.stderr) == (0, "")
    assert in_shell("landerd replay none.mcap 2>&- >&-").returncode == 2


def test_an_interrupted_command_says_that_it_stopped(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"  # once it is there, it flies
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored under nohup or &
    try:
        process = subprocess.Popen(
            [sys.executable, "-m", "landerd", "sim", "--realtime", "--log", str(log)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
    finally:
        signal.signal(signal.SIGINT, before)
    while not log.exists():
        assert process.poll() is None
        time.sleep(0.02)
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "stopped\n")


def test_ctrl_c_once_more_while_it_stops_is_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> int:
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr("landerd.cli.main", interrupted)
    try:
        with pytest.raises(SystemExit) as end:
            entry_point()
        assert end.value.code == 130
        assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL  # Python's would raise
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    "arguments",
    [
        ("sim", "--picture", "/proc/a.png"),
        ("sim", "--log", "/proc/a.mcap"),
        ("dry-run", "--telemetry", "a.bin", "--log", "/proc/a.mcap"),
        ("dry-run", "--telemetry", "a.bin", "--draw", "/proc/a.mp4"),
        ("calibrate", "camera", ".", "--size", "9x6", "--square", "0.1", "-o", "/proc/a.yaml"),
        ("report", str(GOLDEN), "-o", "/proc/a.html"),
    ],
)
def test_files_that_cannot_be_written_are_refused_before_the_work(
    arguments: tuple[str, ...], capsys: Printed
) -> None:
    (line,) = wrong_input(capsys, *arguments)
    assert "/proc/a." in line
    assert "cannot be written: No such file or directory" in line


def test_a_configuration_that_does_not_exist_is_looked_for_among_landerds_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.chdir(tmp_path)
    told, *faults = wrong_input(capsys, "sim", "-c", "thesis-gains.yaml", "--set", "a=1")
    assert told.startswith("thesis-gains.yaml: not found here, landerd's own is used: ")
    assert [fault for fault in faults if "unknown key" not in fault] == []


def test_a_folder_that_may_not_be_entered_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    def locked(path: Path) -> bool:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "exists", locked)
    assert main(["check", "-c", str(tmp_path / "mine.yaml")]) == 2
    assert "mine.saved.yaml: cannot be read: Permission denied" in capsys.readouterr().err


def test_a_working_folder_that_was_deleted_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert main(["check", "-c", "mine.yaml"]) == 2
    assert capsys.readouterr().err == "the working folder is gone: cd to one that is there\n"
