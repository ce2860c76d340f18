"""The recorder in flight: it never waits, never raises, and says what it could not keep."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from landerd.config.models import Config, LogSection
from landerd.flightlog.disk import SyncedFile
from landerd.flightlog.reader import read_images, read_log
from landerd.flightlog.recorder import MOST_IMAGES, MOST_MESSAGES
from landerd.flightlog.replay import replay
from landerd.messages import PhaseChange, Tick
from tests.recorded_flight import PLENTY, RecordedFlight, recorder

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
NOISE = np.random.default_rng(1).integers(0, 256, (480, 640)).astype(np.uint8)
SMALL_NOISE = NOISE[:64, :64].copy()


def test_lossless_images_come_back_as_they_were(tmp_path: Path) -> None:
    options = LogSection(images="lossless", every_nth=2, keep_free_mb=0.0)
    flight = RecordedFlight(recorder(tmp_path / "a.mcap", options), NOISE)
    flight.run(0.5)
    flight.recorder.close()
    images = list(read_images(tmp_path / "a.mcap"))
    assert len(images) == -(-len(read_log(tmp_path / "a.mcap").searched) // 2)
    for frame, form in images:
        assert form == "png"
        assert np.array_equal(frame.image, NOISE)


def test_the_state_after_every_change_of_phase_is_there_though_the_log_ends_with_it(
    tmp_path: Path,
) -> None:
    flight = RecordedFlight(recorder(tmp_path / "a.mcap"))
    flight.engaged().run(1.0)
    flight.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    changes = [
        (round(step.now, 6), command.phase)
        for step in log.steps
        for command in step.commands
        if isinstance(command, PhaseChange)
    ]
    assert len(changes) > 1
    assert set(changes) <= {(round(state.t, 6), state.phase) for state in log.states}


class StuckDisk:
    """Replaces os.fsync: a disk that answers only when the test lets it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._stuck = False
        self._asked = threading.Event()
        monkeypatch.setattr("landerd.flightlog.disk.os.fsync", self._fsync)

    def stick(self) -> None:
        """Stop answering as soon as somebody waits; by then the file has been begun."""
        self._awaited()
        self._stuck = True
        self._awaited()

    def answer(self) -> None:
        self._stuck = False

    def _awaited(self) -> None:
        self._asked.clear()
        assert self._asked.wait(20.0)

    def _fsync(self, fd: int) -> None:
        self._asked.set()
        while self._stuck:
            time.sleep(0.01)


def test_a_stuck_disk_does_not_stop_the_flight_and_costs_images_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stuck = StuckDisk(monkeypatch)
    options = LogSection(images="jpeg", every_nth=1, keep_free_mb=0.0)
    flight = RecordedFlight(recorder(tmp_path / "a.mcap", options, background=True), NOISE)
    stuck.stick()
    flight.run(2.0)  # 80 frames, 400 messages: returns although nobody writes
    stuck.answer()
    flight.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    assert [step.message for step in log.steps] == flight.inputs
    assert log.images <= MOST_IMAGES
    assert log.dropped is not None
    assert log.dropped.images >= len(log.searched) - log.images > 0
    assert log.dropped.messages == 0
    assert replay(log, Config()).comparison.identical


def test_a_disk_stuck_for_minutes_costs_messages_and_the_log_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stuck = StuckDisk(monkeypatch)
    flight = RecordedFlight(recorder(tmp_path / "a.mcap", background=True))
    flight.run(0.5)
    stuck.stick()
    for _ in range(MOST_MESSAGES + 5):
        flight.recorder.on_step(flight.t, Tick(flight.t), [])
    stuck.answer()
    time.sleep(0.1)
    while flight.recorder._queue:
        time.sleep(0.05)
    flight.give(Tick(flight.t + 1.0))
    flight.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    assert log.dropped is not None
    assert log.dropped.messages >= 5
    assert log.dropped.detail > 0
    assert log.replayable < len(log.steps)
    assert any("steps of the core are missing" in note for note in log.notes)


def test_a_full_disk_keeps_what_it_took_and_goes_on_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = [40_000]

    def write(fd: int, data: bytes) -> int:
        done = min(room[0], len(data))
        if not done:
            raise OSError(28, "No space left on device")
        room[0] -= done
        return real_write(fd, bytes(data[:done]))

    real_write = os.write
    monkeypatch.setattr("landerd.flightlog.disk.os.write", write)
    options = LogSection(images="jpeg", every_nth=1, keep_free_mb=0.0)
    flight = RecordedFlight(recorder(tmp_path / "a.mcap", options), NOISE)
    flight.engaged().run(2.0)
    full = read_log(tmp_path / "a.mcap")
    assert full.notes
    assert replay(full, Config()).comparison.identical
    room[0] = 10**9
    flight.run(1.0)
    flight.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    assert [step.message for step in log.steps] == flight.inputs  # the core's messages waited
    assert log.dropped is not None
    assert log.dropped.images > 0
    assert log.dropped.messages == 0


@pytest.mark.parametrize(("free_mb", "has_detail"), [(100, True), (40, False)])
def test_with_little_room_left_images_go_first_then_detail(
    free_mb: int, has_detail: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = free_mb * 1_000_000
    monkeypatch.setattr("landerd.flightlog.recorder.free_bytes", lambda folder: free)
    flight = RecordedFlight(recorder(tmp_path / "a.mcap", LogSection(images="jpeg")), NOISE)
    flight.run(0.5)
    flight.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    assert log.images == 0
    assert bool(log.states) is has_detail
    assert log.dropped is not None
    assert log.dropped.images > 0
    assert bool(log.dropped.detail) is not has_detail
    assert [step.message for step in log.steps] == flight.inputs


def test_a_flight_goes_on_unrecorded_if_the_folder_cannot_be_made(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    flight = RecordedFlight(recorder(tmp_path / "file" / "logs"))
    flight.run(0.2)
    flight.recorder.close()
    assert "this flight is not recorded" in caplog.text
    said = f"{tmp_path}/file/logs: cannot be written: Not a directory"
    assert flight.recorder.failures == [said]


def test_a_message_that_cannot_be_written_costs_only_itself(tmp_path: Path) -> None:
    flight = RecordedFlight(recorder(tmp_path / "a.mcap"))
    flight.run(0.2)
    flight.recorder.on_step(flight.t, Tick(1j), [])  # type: ignore[arg-type]
    flight.run(0.2)
    flight.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    assert log.dropped is not None
    assert log.dropped.errors == 1
    assert log.replayable < len(log.steps) == len(flight.inputs)


def test_losses_of_one_flight_are_not_counted_in_the_next(tmp_path: Path) -> None:
    flight = RecordedFlight(recorder(tmp_path / "a.mcap"))
    flight.run(0.2)
    for seconds in (0.2, 0.4):  # an error in this flight, another in the next one
        flight.recorder.on_step(flight.t, Tick(1j), [])  # type: ignore[arg-type]
        flight.run(seconds)
        flight.recorder.on_flight(flight.lander)
    flight.recorder.close()
    lost = [read_log(tmp_path / name).dropped for name in ("a.mcap", "a.restart-2.mcap")]
    assert [dropped.errors if dropped else 0 for dropped in lost] == [1, 1]


def test_the_oldest_logs_make_room_but_nothing_else_is_touched(tmp_path: Path) -> None:
    for number in range(1, 6):
        for suffix in (".mcap", ".tlog"):
            (tmp_path / f"{number:05d}-20260101-000000{suffix}").write_bytes(bytes(1_000_000))
    (tmp_path / "notes.txt").write_bytes(bytes(9_000_000))
    (tmp_path / "mine.mcap").write_bytes(bytes(9_000_000))
    options = PLENTY.model_copy(update={"most_mb": 4.5})
    flight = RecordedFlight(recorder(tmp_path, options))
    flight.run(1.0)
    flight.recorder.close()
    left = sorted(path.name for path in tmp_path.iterdir())
    kept = ["00004", "00004", "00005", "00005", "00006", "mine.", "notes"]
    assert [name[:5] for name in left] == kept


@pytest.mark.parametrize("stays", ["deleted", "undeletable"])
def test_an_old_log_that_is_gone_or_cannot_be_deleted_does_not_stop_the_recording_of_pictures(
    stays: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Once, a log that somebody had deleted meanwhile was reported as a nearly full disk."""
    odd = tmp_path / "00001-20260101-000000.mcap"
    if stays == "deleted":
        odd.symlink_to("deleted between the folder's listing and the look at its size")
    else:
        odd.mkdir()
    (tmp_path / "00002-20260101-000000.mcap").write_bytes(bytes(1_000_000))
    options = PLENTY.model_copy(update={"most_mb": 0.5, "images": "lossless", "every_nth": 1})
    flight = RecordedFlight(recorder(tmp_path, options), SMALL_NOISE)
    flight.run(2.0)
    flight.recorder.close()
    assert "nearly full" not in caplog.text
    assert sorted(path.name[:5] for path in tmp_path.iterdir()) == ["00001", "00003"]
    log = read_log(next(tmp_path.glob("00003-*")))
    assert log.dropped is None or log.dropped.images == 0


def test_the_log_in_progress_is_neither_counted_nor_deleted(tmp_path: Path) -> None:
    (tmp_path / "00001-20260101-000000.mcap").write_bytes(bytes(40_000))
    options = PLENTY.model_copy(update={"most_mb": 0.05, "images": "lossless", "every_nth": 1})
    flight = RecordedFlight(recorder(tmp_path, options), SMALL_NOISE)
    flight.run(2.0)
    flight.recorder.close()
    sizes = {path.name[:5]: path.stat().st_size for path in tmp_path.iterdir()}
    assert sizes["00002"] > 80_000
    assert sizes["00001"] == 40_000


SPLIT = {"most_file_mb": 0.05, "images": "lossless", "every_nth": 1}


def test_a_long_flight_goes_on_in_further_files_and_replays_as_one(tmp_path: Path) -> None:
    options = PLENTY.model_copy(update=SPLIT)
    flight = RecordedFlight(recorder(tmp_path, options), SMALL_NOISE)
    flight.engaged().run(1.0)
    flight.recorder.close()
    first, *further = sorted(tmp_path.iterdir(), key=lambda path: len(path.name))
    assert further
    assert {path.name for path in further} == {
        f"{first.stem}.{number}.mcap" for number in range(2, 2 + len(further))
    }
    assert all(path.stat().st_size < 500_000 for path in (first, *further))
    log = read_log(first)
    assert [step.message for step in log.steps] == flight.inputs
    assert log.images == len(log.searched) == len(list(read_images(first)))
    assert replay(log, Config()).comparison.identical
    assert log.notes == []
    assert read_log(further[-1]).replayable == 0


def test_logs_of_a_vehicle_that_stands_for_days_do_not_displace_earlier_flights(
    tmp_path: Path,
) -> None:
    before = tmp_path / "00001-20260101-000000.mcap"
    before.write_bytes(bytes(100_000))
    update = {**SPLIT, "most_mb": 0.5, "disarmed_images": True}
    flight = RecordedFlight(recorder(tmp_path, PLENTY.model_copy(update=update)), SMALL_NOISE)
    flight.armed = False
    flight.run(6.0)
    flight.recorder.close()
    assert before.exists()
    parts = sorted(path.name.split(".")[-2] for path in tmp_path.glob("00002-*"))
    assert len(parts) == 2
    assert int(parts[-1]) > 3


def test_a_flights_own_files_are_kept_while_it_goes_on(tmp_path: Path) -> None:
    flight = RecordedFlight(recorder(tmp_path, PLENTY.model_copy(update=SPLIT)), SMALL_NOISE)
    flight.engaged().run(2.0)
    flight.recorder.close()
    assert len(list(tmp_path.glob("00001-*"))) >= 3


@pytest.mark.parametrize(("asked", "pictures"), [(False, False), (True, True)])
def test_no_pictures_are_recorded_while_disarmed_unless_asked(
    tmp_path: Path, asked: bool, pictures: bool
) -> None:
    options = PLENTY.model_copy(update={"every_nth": 1, "disarmed_images": asked})
    flight = RecordedFlight(recorder(tmp_path / "a.mcap", options), SMALL_NOISE)
    flight.armed = False
    flight.run(1.0)
    flight.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    assert (log.images > 3) is pictures  # some before the first heartbeat
    assert len(log.searched) > 10


def test_a_power_cut_loses_only_what_was_written_after_the_last_sync(tmp_path: Path) -> None:
    file = SyncedFile(tmp_path / "a")
    file.write(b"one")
    assert file.sync()
    file.write(b"two")
    assert (tmp_path / "a").read_bytes() == b"one"  # all that a power cut leaves
    assert (file.tell(), file.waiting) == (6, 3)
    file.close()
    assert (tmp_path / "a").read_bytes() == b"onetwo"


_FLY = """
import sys, time
from pathlib import Path
from tests.recorded_flight import RecordedFlight, recorder
flight = RecordedFlight(recorder(Path(sys.argv[1]), background=True))
start, t0 = time.monotonic(), flight.t
while True:
    while flight.t - t0 < time.monotonic() - start:
        flight.tick()
    print(flight.t, flush=True)
    time.sleep(0.02)
"""


def test_killed_in_flight_it_loses_at_most_the_last_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", _FLY, str(path)], stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        last = 0.0
        for line in process.stdout:
            last = float(line)
            if last > 102.7:
                break
        process.send_signal(signal.SIGKILL)
    log = read_log(path)
    assert log.steps[-1].now > last - 1.0 - 1.0  # a second of grace for a loaded machine
    assert replay(log, Config()).comparison.identical
