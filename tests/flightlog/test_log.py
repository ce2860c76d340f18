"""Flight logs: written, cut, damaged, read again and replayed."""

import bisect
import contextlib
import random
import struct
from pathlib import Path

import pytest

from landerd.config.models import Config, LogSection
from landerd.flightlog.reader import FlightLog, LogError, read_log
from landerd.flightlog.replay import replay
from landerd.messages import Heartbeat, Phase, Setpoint
from tests.recorded_flight import CAMERA, RecordedFlight, recorder
from tests.scripted_flight import PAD


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> RecordedFlight:
    """The beginning of a landing, recorded; synced has (bytes on the disk, time) while it flew."""
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    flight = RecordedFlight(recorder(path, LogSection(keep_free_mb=0.0, images="none")))
    synced: list[tuple[int, float]] = []

    def note() -> None:
        size = path.stat().st_size
        if not synced or synced[-1][0] != size:
            synced.append((size, flight.t))

    flight.after_step = note
    flight.engaged().run(0.7)
    flight.recorder.close()
    flight.synced = synced  # type: ignore[attr-defined]
    return flight


@pytest.fixture(scope="module")
def data(flown: RecordedFlight) -> bytes:
    return flown.recorder._target.read_bytes()


def read(tmp_path: Path, data: bytes) -> FlightLog:
    path = tmp_path / "some.mcap"
    path.write_bytes(data)
    return read_log(path)


def test_all_messages_and_commands_are_read_as_they_were_written(flown: RecordedFlight) -> None:
    log = read_log(flown.recorder._target)
    assert [step.message for step in log.steps] == flown.inputs
    assert [c for step in log.steps for c in step.commands] == flown.commands
    assert (log.layout, log.camera) == (PAD, CAMERA)
    assert log.states[-1].phase is Phase.CLOSE_APPROACH
    assert log.notes == []
    assert log.dropped is None


def test_a_recorded_flight_replays_identically(flown: RecordedFlight) -> None:
    replayed = replay(read_log(flown.recorder._target), Config())
    assert replayed.comparison.identical
    assert replayed.comparison.compared == len(flown.commands)


def test_a_changed_command_is_found_and_named(flown: RecordedFlight) -> None:
    log = read_log(flown.recorder._target)
    step = next(s for s in log.steps if any(isinstance(c, Setpoint) for c in s.commands))
    i = next(i for i, (kind, _) in enumerate(step.json) if kind == "Setpoint")
    step.json[i] = ("Setpoint", b'{"velocity":[0.5,0.0,0.0],"yaw_rate":0.0}')
    first = replay(log, Config()).comparison.first
    assert first is not None
    assert (first.step, first.field, first.logged) == (step.number, "Setpoint.velocity[0]", 0.5)


def test_a_replay_with_another_parameter_differs_from_the_log(flown: RecordedFlight) -> None:
    log = read_log(flown.recorder._target)
    slow = Config.model_validate({"guidance": {"limits": {"speed_mps": 0.5}}})
    comparison = replay(log, slow).comparison
    assert not comparison.identical
    assert comparison.first is not None
    assert comparison.first.field.startswith("Setpoint.velocity")


@pytest.mark.long
def test_a_log_cut_anywhere_opens_and_loses_at_most_a_second(
    flown: RecordedFlight, data: bytes, tmp_path: Path
) -> None:
    synced = flown.synced  # type: ignore[attr-defined]
    sizes = [size for size, _ in synced]
    head = sizes[1]  # the first sync after the head has messages
    rng = random.Random(6)
    for cut in [rng.randrange(head, len(data)) for _ in range(80)]:
        log = read(tmp_path, data[:cut])
        assert log.replayable == len(log.steps)
        before = bisect.bisect_right(sizes, cut) - 1
        # What happened until the cut's bytes were written at the latest.
        then = synced[before + 1][1] if before + 1 < len(sizes) else flown.t
        assert log.steps[-1].now > then - 1.0
        assert log.steps[-1].now >= synced[before][1] - 1e-6
        if cut == len(data):
            assert not log.notes
    assert replay(log, Config()).comparison.identical


def test_a_log_without_messages_names_what_is_missing(data: bytes, tmp_path: Path) -> None:
    for cut, said in ((0, "empty"), (5, "not an MCAP file"), (60, "config.json is missing")):
        with pytest.raises(LogError) as e:
            read(tmp_path, data[:cut])
        assert said in str(e.value)
        assert str(e.value).startswith(str(tmp_path / "some.mcap"))
    with pytest.raises(LogError, match="cannot be read: No such file"):
        read_log(tmp_path / "none.mcap")
    with pytest.raises(LogError, match="cannot be read: Is a directory"):
        read_log(tmp_path)
    with pytest.raises(LogError, match="not an MCAP file"):
        read(tmp_path, b"\x89PNG\r\n\x1a\n" + bytes(100))


def test_damage_loses_one_part_of_the_log_and_is_reported(data: bytes, tmp_path: Path) -> None:
    whole = read(tmp_path, data)
    rng = random.Random(7)
    for _ in range(20):
        damaged = bytearray(data)
        damaged[rng.randrange(len(data) // 4, len(data) // 2)] ^= 1 << rng.randrange(8)
        log = read(tmp_path, bytes(damaged))
        if len(log.steps) < len(whole.steps):
            assert any("bytes" in note or "byte" in note for note in log.notes)
            assert log.replayable < len(whole.steps)
        assert replay(log, Config()).comparison.identical


def test_a_hole_in_a_log_is_told_from_a_recording_that_was_cut_off(
    data: bytes, tmp_path: Path
) -> None:
    whole, half = read(tmp_path, data), len(data) // 2
    holed = read(tmp_path, data[:half] + data[half + 5000 :])
    assert 0 < len(holed.steps) < len(whole.steps)
    assert not any("cut off" in note for note in holed.notes)
    assert any("damaged" in note for note in holed.notes)
    assert any("cut off" in note for note in read(tmp_path, data[:half]).notes)


def test_random_bytes_never_raise_anything_else(data: bytes, tmp_path: Path) -> None:
    rng = random.Random(8)
    for _ in range(30):
        damaged = bytearray(data[: rng.randrange(len(data))])
        for _ in range(20):
            at = rng.randrange(max(1, len(damaged)))
            damaged[at : at + 8] = struct.pack("<Q", rng.getrandbits(rng.choice([8, 40, 64])))
        with contextlib.suppress(LogError):
            read(tmp_path, bytes(damaged))


def test_each_arming_begins_a_new_file(tmp_path: Path) -> None:
    flight = RecordedFlight(recorder(tmp_path))
    flight.run(0.5)
    flight.recorder.on_flight(flight.lander)
    flight.give(Heartbeat(flight.t, armed=True, guided=False, mode="LOITER"))
    flight.recorder.close()
    first, second = sorted(tmp_path.glob("*.mcap"))
    assert (first.name[:6], second.name[:6]) == ("00001-", "00002-")
    assert isinstance(read_log(second).steps[0].message, Heartbeat)
