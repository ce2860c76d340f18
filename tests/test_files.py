"""Odd files and full disks: refused in one line, and nothing is half-written."""

import re
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from landerd.cli import main
from landerd.files import read_text, write_whole
from landerd.pad import load_pad
from tests.recordings import write_tlog

ROOT = Path(__file__).resolve().parents[1]
CAMERA = ROOT / "config" / "cameras" / "thesis.yaml"
PICTURE = ROOT / "docs" / "drawings" / "pad.jpg"
LOG = ROOT / "tests" / "golden" / "link-cut.mcap"


def refused(arguments: Sequence[object], capsys: pytest.CaptureFixture[str]) -> str:
    """Run landerd; return the one line with which it refuses."""
    assert main([str(a) for a in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    return err


def test_a_file_that_does_not_fit_leaves_the_old_one(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("good")
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192));"
        "from landerd.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", code, "report", str(LOG), "-o", str(page)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == f"{page}: cannot be written: File too large\n"
    assert page.read_text() == "good"
    assert list(tmp_path.iterdir()) == [page]


def test_devices_and_the_files_that_symbolic_links_name_are_written_into(tmp_path: Path) -> None:
    write_whole(Path("/dev/null"), b"anything")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_whole(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"new"


def test_an_endless_device_is_refused_before_it_fills_the_memory() -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(OSError, match="more than 16 MB"):
        read_text(Path("/dev/zero"))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # KiB


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "image_width: 640\nimage_height: 480\nimage_width: 320\n",
            "3: image_width is given twice",
        ),
        ("[" * 3000, "nested too deeply"),
        ("image_width: 1000000000\nimage_height: 1000000000\n", "image_width: found 1000000000"),
        ("image_width: " + "9" * 400, "image_width: found 999"),
    ],
)
def test_impossible_calibrations_are_refused(
    text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "camera.yaml"
    file.write_text(text)
    line = refused(["detect", "--camera", file, "--pad", "thesis", PICTURE], capsys)
    assert line.startswith(str(file))
    assert says in line
    assert len(line) < 300


def test_a_marker_with_two_diameters_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Once, the last one was used for printing and flying."""
    text = (ROOT / "config" / "pads" / "thesis.yaml").read_text()
    file = tmp_path / "pad.yaml"
    twice = "outer_diameter_m: 1.0\n    outer_diameter_m: 0.9"
    file.write_text(text.replace("outer_diameter_m: 1.0", twice, 1))
    line = refused(["pad", file, "-o", tmp_path / "pad.pdf"], capsys)
    assert line == f"{file}:6: outer_diameter_m is given twice\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["sim", "--set", 'pad.layout="a\\0b"'],
        ["sim", "--set", "pad.layout=" + "x" * 5000],
        ["sim", "--set", "pad.layout=" + "[" * 3000],
        ["sim", "--log", "n" * 300 + ".mcap"],
        ["report", LOG, "-o", "n" * 300 + ".html"],
        ["detect", "--camera", "x" * 5000, "--pad", "thesis", PICTURE],
        ["detect", "--camera", CAMERA, "--pad", "thesis", "x" * 5000],
        ["detect", "--camera", CAMERA, "--pad", "thesis", "99999999999999"],
        ["campaign", "hover", "--runs", "1", "--jobs", "1", "--keep", "/dev/full"],
    ],
)
def test_impossible_file_names_and_full_devices_are_refused_in_one_line(
    arguments: list[object], capsys: pytest.CaptureFixture[str]
) -> None:
    refused(arguments, capsys)


def test_a_picture_of_more_pixels_than_there_can_be_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, png = cv2.imencode(".png", np.zeros((8, 8), np.uint8))
    data = bytearray(png.tobytes())
    data[16:24] = (60_000).to_bytes(4, "big") * 2
    file = tmp_path / "huge.png"
    file.write_bytes(data)
    line = refused(["detect", "--camera", CAMERA, "--pad", "thesis", file], capsys)
    assert line == f"{file}: not an image that can be read\n"


NO_TEXT = "b\udcff"  # a name of bytes that are no UTF-8, as old disks have them


def run_alone(*arguments: object) -> None:
    """Run landerd in a process of its own, which may die of it; expect that all is well."""
    code = f"from landerd.cli import main; raise SystemExit(main({[str(a) for a in arguments]!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_pictures_are_drawn_into_a_folder_whose_name_is_not_utf_8(tmp_path: Path) -> None:
    """OpenCV's own writer ends the process at such names."""
    folder = tmp_path / NO_TEXT
    run_alone("detect", "--camera", CAMERA, "--pad", "thesis", PICTURE, "--draw", folder)
    assert [p.suffix for p in folder.iterdir()] == [".png"]


def test_a_terminal_that_cannot_show_a_name_is_told_it_all_the_same(tmp_path: Path) -> None:
    file = tmp_path / "pä.pdf"
    command = [sys.executable, "-m", "landerd", "pad", "nested", "-o", str(file)]
    env = {"PYTHONIOENCODING": "ascii", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "p\\xe4.pdf" in done.stdout
    assert file.exists()


def test_a_video_whose_name_is_not_utf_8_is_written_and_read(tmp_path: Path) -> None:
    """OpenCV ends the process at such names, without a message."""
    telemetry, film = write_tlog(tmp_path / "a.tlog"), tmp_path / f"{NO_TEXT}.mp4"
    dry_run = ("dry-run", "--telemetry", telemetry, "--to", "3")
    run_alone(*dry_run, "--fps", "2", "--draw", film)
    assert film.stat().st_size > 10_000
    run_alone("detect", "--camera", CAMERA, "--pad", "thesis", film)
    run_alone(*dry_run, "--video", film, "--offset", "0", "--gimbal", "0,-90")


def test_a_file_whose_name_is_not_utf_8_is_named_in_pages_and_pad_files(tmp_path: Path) -> None:
    log, pad = (tmp_path / f"{NO_TEXT}{suffix}" for suffix in (".mcap", ".yaml"))
    log.write_bytes(LOG.read_bytes())
    page, mine = tmp_path / "page.html", tmp_path / "mine.yaml"
    assert main(["report", str(log), "-o", str(page)]) == 0
    assert "b\\udcff.mcap" in page.read_text()
    pad.write_bytes((ROOT / "config" / "pads" / "nested.yaml").read_bytes())
    assert main(["pad", str(pad), "--measured", "ruler=99mm", "-o", str(mine)]) == 0
    assert load_pad(mine).markers


def test_a_configuration_in_a_folder_whose_name_is_no_text_is_refused_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / NO_TEXT
    folder.mkdir()
    (folder / "cam.yaml").write_bytes(CAMERA.read_bytes())
    config = folder / "mine.yaml"
    config.write_text("include: [default.yaml]\ncamera: {calibration: cam.yaml}\n")
    line = refused(["sim", "-c", config], capsys)
    assert re.search(r"mine.yaml:2: camera.calibration: found .*, expected a name in UTF-8", line)


@pytest.mark.parametrize(
    "command",
    [
        "tune thesis-pid -c {0} -o {0}",
        "tune {0} -o {0}",
        "calibrate gimbal -c {0} -o {0}",
        "bench-test pose -c {0} --height 1.5 --mark 3,0 -o {0}",
        "dry-run --telemetry a.tlog --video {0} --draw {0}",
    ],
)
def test_a_command_refuses_to_overwrite_a_file_that_it_reads(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / ("mine.mp4" if "--draw" in command else "mine.yaml")
    # A camera that is not there: nothing is moved in a test.
    text = "include: [default.yaml]\ncamera: {driver: v4l2, v4l2: {device: /dev/none}}\n"
    mine.write_text(text)
    line = refused(command.format(mine).split(), capsys)
    assert line.endswith(f"{mine}: is read, too, and would be lost; name another file\n")
    assert mine.read_text() == text


@pytest.mark.parametrize(
    ("argument", "told"),
    [
        ("--from nan", "argument --from: found 'nan', expected seconds"),
        ("--to inf", "argument --to: found 'inf', expected seconds"),
        ("--from -5", "--from -5: expected 0 s or more\n"),
        ("--offset 3", "--offset: only with --video\n"),
        ("--pad-at 47,8 --video a.mp4", "--pad-at: not with --video\n"),
        ("--pad-local 0,2 --video a.mp4", "--pad-local: not with --video\n"),
        ("--gimbal 0,-900", "found '0,-900', expected 2 numbers from -360 to 360"),
        ("--draw a.avi", "--draw a.avi: expected a .webm or .mp4"),
    ],
)
def test_dry_run_says_which_arguments_it_expects(
    argument: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises((SystemExit, AssertionError)):
        assert main(["dry-run", "--telemetry", "a.tlog", *argument.split()]) != 2
    assert told in capsys.readouterr().err
