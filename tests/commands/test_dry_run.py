"""`landerd dry-run` on recordings of a made-up flight, with drawn pictures and with a video."""

import json
import math
import re
from pathlib import Path
from typing import Any

import cv2
import pytest

from landerd.cli import main
from landerd.commands.dry_run import outcome_in_words
from landerd.flightlog.reader import read_log
from landerd.guidance.states import OUTCOMES
from tests.recordings import FPS, ORIGIN, write_bin, write_tlog, write_video

pytestmark = pytest.mark.long

FIXED = (0.0, -50.0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a.tlog, and video.avi, whose camera looked at the pad from 6.3 s to 17 s."""
    folder = tmp_path_factory.mktemp("recording")
    tlog = write_tlog(folder / "a.tlog")
    write_video(folder / "video.avi", tlog, FIXED)
    return folder


def dry_run(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["dry-run", *arguments, "--json"]) == 0
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["dry-run", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_a_video_is_aligned_by_its_motion(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film = tmp_path / "film.mp4"
    video = ("--video", str(recording / "video.avi"), "--gimbal", "0,-50", "--draw", str(film))
    result = dry_run(capsys, "--telemetry", str(recording / "a.tlog"), *video)
    assert result["offset_s"] == pytest.approx(6.3, abs=0.1)
    assert result["frames"] == pytest.approx(10.7 * FPS, abs=3)
    assert result["frames_with_pad"] > 20
    assert result["setpoints"] > 50
    assert result["phases"][0]["name"] == "APPROACH"
    assert played_hz(film) == pytest.approx(FPS, rel=0.02)


def test_an_empty_image_file_is_reported_in_one_line(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "frame-0.0.png").touch()
    video = ("--video", str(tmp_path), "--gimbal", "0,-50", "--offset", "6")
    said = refused(capsys, "--telemetry", str(recording / "a.tlog"), *video)
    assert said == f"{tmp_path}/frame-0.0.png: not an image that can be read"


def played_hz(film: Path) -> float:
    capture = cv2.VideoCapture(str(film))
    rate = capture.get(cv2.CAP_PROP_FPS)
    capture.release()
    return rate


def test_without_a_video_a_drawn_pad_is_landed_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, film = tmp_path / "dry.mcap", tmp_path / "dry.mp4"
    result = dry_run(
        capsys,
        *("--telemetry", str(write_bin(tmp_path / "a.bin", skip=("MNT",)))),
        *("--pad-local", "0,2,0.2", "--fps", "5", "--to", "8"),
        *("--log", str(log), "--draw", str(film)),
    )
    assert result["offset_s"] is None
    assert result["frames_with_pad"] > 15
    assert result["setpoints"] > 50
    assert len(read_log(log).searched) == result["frames"]
    capture = cv2.VideoCapture(str(film))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == result["frames"]
    capture.release()


def test_its_log_says_that_no_order_was_flown(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, gains, page = (tmp_path / name for name in ("dry.mcap", "gains.yaml", "page.html"))
    dry_run(capsys, "--telemetry", str(recording / "a.tlog"), "--to", "8", "--log", str(log))
    assert main(["tune", "--from", str(log), "-o", str(gains)]) == 2
    assert capsys.readouterr().err == (
        f"{log}: of a dry run, whose orders were not flown; expected a flight's log\n"
    )
    assert not gains.exists()
    golden = Path(__file__).parents[1] / "golden" / "landing.mcap"
    assert main(["report", str(log), str(golden), "-o", str(page)]) == 0
    text = page.read_text()
    assert "<h1>dry.mcap (dry run)</h1>" in text
    assert "A dry run on a recorded flight: landerd&#x27;s orders were not flown" in text
    assert "<h1>landing.mcap</h1>" in text
    assert (
        "0 of 1 landed" in text
    )  # the other ends in flight; a dry run is no landing, and does not count
    assert main(["replay", str(log)]) == 0


def test_the_outcome_is_printed_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = str(write_bin(tmp_path / "a.bin", skip=("MNT",)))
    assert main(["dry-run", "--telemetry", flight, "--fps", "1", "--to", "4"]) == 0
    said = capsys.readouterr().out
    assert "outcome: the recording ends before the landing does" in said
    # Of a picture a second no pad is believed: why nothing was sent is said.
    assert re.search(r"would have stayed silent\n.* for [0-9.]+ s: pad seen", said, re.DOTALL)
    words = [outcome_in_words(o) for o in (*OUTCOMES.values(), "touchdown_unconfirmed")]
    assert not any("_" in text for text in words)


def test_reasons_to_doubt_the_result_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = str(write_bin(tmp_path / "a.bin", skip=("MNT",)))
    short = ("--fps", "1", "--to", "2")
    sound = dry_run(capsys, "--telemetry", flight, *short)["remarks"]
    assert not any("nearer" in remark or "above it" in remark for remark in sound)
    far = dry_run(capsys, "--telemetry", flight, *short, "--pad-local", "0,40,12")["remarks"]
    assert any(re.search("never came nearer to that pad than 4[0-9] m", r) for r in far)
    assert any(re.search("ends 1[0-9] m above that pad", r) for r in far)
    # An estimator that says 99 m/s along each axis.
    lost = str(write_bin(tmp_path / "b.bin", skip=("MNT",), estimator=10))
    said = dry_run(capsys, "--telemetry", lost, *short)["remarks"]
    assert any("implausible: by it the vehicle flew up to 171 m/s" in r for r in said)


def test_a_pad_in_degrees_and_one_in_metres_are_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    telemetry = ("--telemetry", str(write_tlog(tmp_path / "a.tlog")))
    north, east = ORIGIN[0], ORIGIN[1] + math.degrees(2 / 6378137.0 / math.cos(math.radians(47)))
    part = ("--fps", "4", "--to", "4")
    by_degrees = dry_run(capsys, *telemetry, *part, "--pad-at", f"{north},{east}")
    by_metres = dry_run(capsys, *telemetry, *part, "--pad-local", "0,2")
    assert by_degrees["frames_with_pad"] == by_metres["frames_with_pad"] > 5


def test_a_pad_in_two_places_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as exit_of:
        main(["dry-run", "--telemetry", "a.tlog", "--pad-at", "47,8", "--pad-local", "0,2"])
    assert exit_of.value.code == 2
    assert "--pad-local: not allowed with argument --pad-at" in capsys.readouterr().err


def test_unusable_input_is_refused_in_one_line(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tlog = str(recording / "a.tlog")
    video = str(recording / "video.avi")
    (tmp_path / "empty.avi").touch()
    (tmp_path / "images").mkdir()
    for arguments, says in (
        (("--telemetry", str(tmp_path / "no.bin")), "no.bin: cannot be read"),
        (("--telemetry", video), "neither an ArduPilot .bin nor a .tlog"),
        (("--telemetry", tlog, "--video", str(tmp_path / "empty.avi")), "not a video"),
        (("--telemetry", tlog, "--video", str(tmp_path / "images")), "no images in this folder"),
        (("--telemetry", tlog, "--video", video), "give --gimbal YAW,PITCH"),
        (("--telemetry", tlog, "--from", "30"), "nothing between --from and --to"),
        (("--telemetry", tlog, "--draw", "x.avi"), "expected a .webm or .mp4"),
        (
            ("--telemetry", tlog, "--video", video, "--gimbal", "0,-50", "--offset", "100"),
            "no frame is within the telemetry's time",
        ),
    ):
        assert says in refused(capsys, *arguments)
