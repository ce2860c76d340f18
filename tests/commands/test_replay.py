"""`landerd replay` and `landerd sim --log`, as a user runs them."""

import json
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from pymavlink import mavutil

from landerd.cli import main
from tests.simulated import ABOVE, SEEN

GOLDEN = Path(__file__).parents[1] / "golden" / "gate-closed.mcap"


def replayed(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = main(["replay", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.long
def test_a_simulated_flight_with_lossless_images_replays_in_core_and_vision(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "flight.mcap"
    kept = ("log.images=lossless", "log.every_nth=1", "log.keep_free_mb=0")
    options = (*ABOVE, SEEN, "sim.camera.fps=12", *kept)
    keys = [
        part for option in (*options, "guidance.lost.give_up_s=2") for part in ("--set", option)
    ]
    main(["sim", "--log", str(log), *keys, "--set", "sim.start.altitude_m=0.8", "--json"])
    flown = json.loads(capsys.readouterr().out)
    code, result = replayed(capsys, str(log))
    assert code == 0
    assert result["identical"]
    assert result["commands"] > 100
    assert result["first_difference"] is None
    assert result["vision"]["identical"]
    assert result["vision"]["frames"] == pytest.approx(
        flown["frames_per_s"] * flown["simulated_s"], abs=1.5
    )

    recorded = mavutil.mavlink_connection(str(log.with_suffix(".tlog")))
    kinds = set()
    while (message := recorded.recv_match()) is not None:
        kinds.add((message.get_type(), message.get_srcComponent()))
    recorded.close()
    assert ("ATTITUDE", 1) in kinds
    assert ("SET_POSITION_TARGET_LOCAL_NED", 191) in kinds  # both directions
    assert ("BAD_DATA", 0) not in kinds


def test_with_set_it_prints_what_would_have_changed(capsys: pytest.CaptureFixture[str]) -> None:
    code, result = replayed(capsys, str(GOLDEN), "--set", "guidance.descent.k1_m=0.01")
    assert code == 0
    assert not result["identical"]
    first = result["first_difference"]
    assert set(first) == {"step", "t", "field", "logged", "replayed"}
    assert first["logged"] != first["replayed"]
    assert main(["replay", str(GOLDEN), "--set", "guidance.descent.k1_m=0.01"]) == 0
    assert "phases now:" in capsys.readouterr().out


@pytest.mark.parametrize("key", ["sim.pad.speed_mps", "sim", "camera.v4l2.device"])
def test_a_key_of_what_is_not_in_a_log_is_refused(
    key: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(GOLDEN), "--set", f"{key}=2"]) == 2
    assert capsys.readouterr().err == (
        f"--set {key}: a log has neither simulator nor drivers, only what came of them\n"
    )


def test_a_replay_of_a_flight_without_an_outcome_prints_none(
    capsys: pytest.CaptureFixture[str],
) -> None:
    closed = str(GOLDEN.with_name("gate-closed.mcap"))
    assert main(["replay", closed, "--set", "guidance.limits.speed_mps=2"]) == 0
    assert "outcome now: none, pad lost 0 times" in capsys.readouterr().out


def test_wrong_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n")
    for arguments, says in (
        ([str(tmp_path / "none.mcap")], "cannot be read: No such file"),
        ([str(tmp_path / "a.mcap")], "the attachment config.json is missing"),
        ([str(GOLDEN), "--set", "guidance.sped=1"], "nearest known key"),
        ([str(GOLDEN), "--set", "guidance.limits.speed_mps=fast"], "expected a number"),
        ([str(GOLDEN), "--set", "pad.layout=pads/nested.yaml"], "the log's own is replayed"),
    ):
        assert main(["replay", *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert says in line


def test_of_a_flight_whose_beginning_is_lost_nothing_is_replayed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "late.mcap"
    with GOLDEN.open("rb") as recorded, path.open("wb") as late:
        reader, writer = make_reader(recorded), Writer(late)
        writer.start()
        for attachment in reader.iter_attachments():
            writer.add_attachment(**vars(attachment))
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        for _, channel, message in reader.iter_messages():
            if message.sequence > 9:
                known = writer.register_channel(channel.topic, channel.message_encoding, 0)
                writer.add_message(
                    known, message.log_time, message.data, message.publish_time, message.sequence
                )
        writer.finish()  # type: ignore[no-untyped-call]
    assert main(["replay", str(path)]) == 2
    assert "the flight's first messages are missing" in capsys.readouterr().err.splitlines()[-1]
