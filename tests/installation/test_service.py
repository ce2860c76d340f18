"""What an installation puts where, below a folder instead of the system."""

import argparse
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from landerd.cli import main
from landerd.commands.install import carry_out
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.installation import keys, program, service
from landerd.installation.steps import InstallError, Step, call

REPO = Path(__file__).parents[2]
BOARDS = sorted(service.BOARDS)


def install(root: Path, board: str, *more: str) -> int:
    return main(["install", "--board", board, "--root", str(root), *more])


def files(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}


@pytest.mark.parametrize("board", BOARDS)
def test_a_second_run_has_nothing_to_do(
    tmp_path: Path, board: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert install(tmp_path, board) == 0
    there = files(tmp_path)
    assert {
        "etc/landerd/landerd.yaml",
        "etc/systemd/system/landerd.service",
        "etc/udev/rules.d/99-landerd.rules",
    } <= there
    capsys.readouterr()
    assert install(tmp_path, board) == 0
    assert capsys.readouterr().out == "nothing left to do\n"
    assert files(tmp_path) == there


def test_an_image_made_elsewhere_lacks_the_program_and_is_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(tmp_path, "pixhawk-usb")
    left = capsys.readouterr().out.partition("left to you")[2]
    assert "landerd install --board pixhawk-usb" in left
    assert "systemctl" not in left  # there is nothing to start yet


@pytest.mark.parametrize("board", BOARDS)
def test_the_installed_example_configuration_can_be_read(tmp_path: Path, board: str) -> None:
    install(tmp_path, board)
    loaded = read_configuration(tmp_path / "etc/landerd/landerd.yaml")
    example = read_configuration(config_dir() / f"vehicles/{board}.yaml")
    assert loaded.options == example.options
    assert loaded.config.vehicle == example.config.vehicle
    for found, there in (
        (loaded.config.pad.layout, example.config.pad.layout),
        (loaded.config.camera.calibration, example.config.camera.calibration),
    ):
        assert found.resolve() == there.resolve()


def test_a_dry_run_says_each_action_and_does_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert install(tmp_path, "navio2", "--dry-run") == 0
    said = capsys.readouterr().out
    for name in ("landerd.yaml", "99-landerd.rules", "landerd.service", "navio2.conf"):
        assert f"{name}" in said
    assert all(line.startswith("would ") for line in said.splitlines())
    assert files(tmp_path) == set()


def test_the_configuration_that_is_there_stays_and_an_old_unit_does_not(tmp_path: Path) -> None:
    install(tmp_path, "pixhawk-usb")
    configuration = tmp_path / "etc/landerd/landerd.yaml"
    configuration.write_text("mine\n")
    unit = tmp_path / "etc/systemd/system/landerd.service"
    now = unit.read_text()
    unit.write_text("of an older version\n")
    install(tmp_path, "pixhawk-usb")
    assert configuration.read_text() == "mine\n"
    assert unit.read_text() == now


def test_installing_for_another_board_removes_the_settings_of_the_first(tmp_path: Path) -> None:
    dropins = tmp_path / "etc/systemd/system/landerd.service.d"
    install(tmp_path, "navio2")
    assert [path.name for path in dropins.iterdir()] == ["navio2.conf"]
    install(tmp_path, "jetson")
    assert [path.name for path in dropins.iterdir()] == ["jetson.conf"]


def test_uninstalled_it_leaves_logs_configuration_and_what_is_not_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "var/lib/landerd/logs/flight.mcap"
    log.parent.mkdir(parents=True)
    log.write_text("a flight")
    install(tmp_path, "jetson")
    theirs = tmp_path / "etc/systemd/system/landerd.service.d/theirs.conf"
    theirs.write_text("")
    assert main(["uninstall", "--root", str(tmp_path)]) == 0
    left = {log, theirs, tmp_path / "etc/landerd/landerd.yaml"}
    assert files(tmp_path) == {str(path.relative_to(tmp_path)) for path in left}
    capsys.readouterr()
    assert main(["uninstall", "--root", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "nothing left to do\n"


def test_a_root_folder_that_does_not_exist_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        install(tmp_path / "mnt", "jetson")
    assert "no such folder" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["install --board jetson", "uninstall"])
def test_an_empty_root_is_refused_instead_of_taken_for_the_working_directory(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main([*command.split(), "--root", ""])
    (line,) = capsys.readouterr().err.splitlines()
    assert "argument --root: found '', expected a file or folder" in line
    assert list(tmp_path.iterdir()) == []


def test_the_running_system_is_known_by_another_name_of_its_root(
    capsys: pytest.CaptureFixture[str],
) -> None:
    install(Path("/"), "jetson", "--dry-run")
    said = capsys.readouterr().out
    install(Path("/usr/.."), "jetson", "--dry-run")
    assert capsys.readouterr().out == said


def test_without_root_rights_it_is_refused_and_does_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[int] = []
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    args = argparse.Namespace(dry_run=False, root=Path("/"))
    with pytest.raises(Exception, match="this needs root: begin the command with sudo"):
        carry_out([Step("x", lambda: done.append(1))], args)
    assert done == []


def test_a_command_that_fails_is_reported_in_one_line() -> None:
    with pytest.raises(InstallError, match=r"^sh -c echo no; exit 3: no$"):
        call("sh", "-c", "echo no; exit 3")
    with pytest.raises(InstallError, match="no-such-program is not there"):
        call("no-such-program")


@pytest.mark.parametrize("home", ["/home/pi/.pyenv/versions/3.12.4", "/root/.local/share/uv/3.12"])
def test_a_python_that_the_service_cannot_see_is_refused(
    home: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 0)
    monkeypatch.setattr(service, "refuse_while_it_runs", lambda: None)
    monkeypatch.setattr(program, "VENV", tmp_path / "venv")
    monkeypatch.setattr(program, "call", lambda *_, **__: None)
    monkeypatch.setattr(program, "_SOURCE_SUM", tmp_path / "sum")
    monkeypatch.setattr(sys, "base_prefix", home)
    assert main(["install", "--board", "pixhawk-usb"]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert told.startswith(f"this Python is in {home}, and the service can see no home folder")


def test_out_of_a_wheel_file_nothing_but_python_is_needed(tmp_path: Path) -> None:
    wheel = tmp_path / "landerd-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for part, inside in (
            ("landerd", "landerd"),
            ("config", "landerd/config_files"),
            ("systemd", "landerd/systemd_files"),
        ):
            for path in (REPO / part).rglob("*"):
                if path.is_file() and "__pycache__" not in path.parts:
                    archive.write(path, f"{inside}/{path.relative_to(REPO / part)}")
    # -S: no packages
    words = [sys.executable, "-S", f"{wheel}/landerd", "install", "--board", "pixhawk-uart"]
    done = subprocess.run([*words, "--dry-run"], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert f"would install landerd from {wheel} into it" in done.stdout
    assert "would write /etc/systemd/system/landerd.service" in done.stdout


def test_a_checkout_with_a_changed_file_is_installed_anew(tmp_path: Path) -> None:
    (tmp_path / "landerd").mkdir()
    (tmp_path / "pyproject.toml").write_text("")
    sums = []
    for text in ("a = 1", "a = 2"):
        (tmp_path / "landerd" / "a.py").write_text(text)
        sums.append(program._sum_of(tmp_path))
    assert sums[0] != sums[1]


@pytest.mark.parametrize("has_picamera2", [True, False])
def test_beside_picamera2_a_simplejpeg_for_numpy_2_is_installed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_picamera2: bool
) -> None:
    if has_picamera2:
        (tmp_path / "picamera2.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(program, "VENV", tmp_path / "venv")
    commands: list[str] = []
    monkeypatch.setattr(program, "call", lambda *words, where: commands.append(" ".join(words)))
    for step in program.picamera2_steps():
        step.do()
    assert [c.endswith(" --no-deps simplejpeg>=1.8.1") for c in commands] == [True] * has_picamera2
    (tmp_path / "venv/lib/python3.11/site-packages/simplejpeg").mkdir(parents=True)
    assert list(program.picamera2_steps()) == []


# ---- keys --------------------------------------------------------------------------------------


def test_an_upgrade_reports_keys_that_are_new_gone_or_have_another_default(tmp_path: Path) -> None:
    mine = tmp_path / "landerd.yaml"
    mine.write_text("include: [default.yaml]\nvision: {max_sigma_m: 0.7}\n")
    now = keys.own_defaults()
    before = {**now, "vision.min_ring_px": 6.0, "vision.max_sigma_m": 2.0, "vision.old": 1}
    del before["rc.gate_channel"]
    assert sorted(keys.changed_keys(before, now, mine)) == [
        "another default: vision.max_sigma_m: 1.0, was 2.0; yours stays 0.7",
        "another default: vision.min_ring_px: 10.0, was 6.0",
        "gone: vision.old",
        "new: rc.gate_channel: 11",
    ]


def test_a_key_of_the_users_that_is_gone_is_named_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "landerd@boat.yaml").write_text("include: [default.yaml]\nvision: {old: 1}\n")
    (fault,) = keys.faults(tmp_path)
    assert "landerd@boat.yaml:2: vision.old: unknown key" in fault


def test_keys_of_the_running_system_are_left_alone_by_an_installation_into_an_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "landerd.yaml").write_text("vision: {old: 1}\n")
    monkeypatch.setattr(program, "is_installed_copy", lambda: True)
    monkeypatch.setattr(service, "CONFIGURATION", tmp_path / "landerd.yaml")
    monkeypatch.setattr(keys, "DEFAULTS", tmp_path / "defaults.json")
    (tmp_path / "image").mkdir()
    assert install(tmp_path / "image", "jetson") == 0
    assert not (tmp_path / "defaults.json").exists()
    assert "cannot read your configuration" not in capsys.readouterr().out


def test_the_folder_of_landerd_is_not_part_of_the_keys_defaults() -> None:
    assert not any(str(config_dir()) in str(value) for value in keys.own_defaults().values())
