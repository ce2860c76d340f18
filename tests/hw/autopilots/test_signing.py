"""Signed MAVLink: forged, repeated and unsigned messages stay outside, the time never goes back."""

import hashlib
import logging
import os
import threading
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.autopilots.signing import Signing
from hw.links.memory import memory_pair
from landerd.ports import DeviceLost
from landerd.runtime.clock import run_virtual

KEY = "7f" * 32


def key_file(folder: Path, text: str = KEY, mode: int = 0o600) -> Path:
    path = folder / "key"
    path.write_text(text)
    path.chmod(mode)
    return path


def signing(folder: Path, name: str = "time", key: str = KEY) -> Signing:
    return Signing(key_file(folder, key), folder / name)


def attitude(i: int) -> Message:
    return mavlink.MAVLink_attitude_message(i, 0.1, -0.2, 0.3, 0.01, 0.02, 0.03)


def stamp_of(frame: bytes) -> int:
    return int.from_bytes(frame[-12:-6], "little")


def test_both_ends_with_the_key_understand_each_other_as_pymavlink_does(tmp_path: Path) -> None:
    ours = MavlinkCodec(1, 191, signing(tmp_path, "ours"))
    theirs = mavlink.MAVLink(None, 1, 1)
    theirs.signing.secret_key = bytes.fromhex(KEY)
    theirs.signing.sign_outgoing = True
    frame = ours.encode(attitude(1), 10.0)
    assert theirs.decode(bytearray(frame)).get_signed()
    theirs.signing.timestamp = stamp_of(frame) - 1000
    (message,) = ours.decode(bytes(attitude(2).pack(theirs)))
    assert message.time_boot_ms == 2
    assert not ours.counters


def test_unsigned_forged_and_repeated_messages_are_refused_and_counted(tmp_path: Path) -> None:
    ours = MavlinkCodec(1, 191, signing(tmp_path, "ours"))
    friend = MavlinkCodec(1, 1, signing(tmp_path, "friend"))
    foe = MavlinkCodec(1, 1, signing(tmp_path, "foe", key="00" * 32))
    frame = friend.encode(attitude(1), 0.0)
    forged = foe.encode(attitude(2), 1e6)  # far ahead: it must not shut the friend out
    unsigned = MavlinkCodec(1, 1).encode(attitude(3))
    old_version = bytes(attitude(4).pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True))
    heard = ours.decode(frame + forged + unsigned + old_version + frame)
    assert [m.time_boot_ms for m in heard] == [1]
    assert ours.counters == {"badly signed": 4}
    assert [m.time_boot_ms for m in ours.decode(friend.encode(attitude(5), 0.1))] == [5]


def test_a_sender_far_behind_in_time_is_refused_until_it_has_caught_up(tmp_path: Path) -> None:
    ours = MavlinkCodec(1, 191, signing(tmp_path, "ours"))
    theirs = mavlink.MAVLink(None, 1, 1)
    theirs.signing.secret_key, theirs.signing.sign_outgoing = bytes.fromhex(KEY), True
    now = stamp_of(ours.encode(attitude(0), 0.0))
    theirs.signing.timestamp = now - 61 * 100_000
    assert ours.decode(bytes(attitude(1).pack(theirs))) == []
    theirs.signing.timestamp = now - 59 * 100_000
    assert len(ours.decode(bytes(attitude(2).pack(theirs)))) == 1


def written() -> None:
    """Wait for what is written aside: here fifty seconds pass in some milliseconds."""
    for thread in threading.enumerate():
        if thread.name == "signing":
            thread.join()


def test_time_stamps_only_grow_with_the_time_and_over_restarts(tmp_path: Path) -> None:
    last = 0
    for start in (1000.0, 50.0, 0.0):  # the loop's clock begins anew with every start
        codec = MavlinkCodec(1, 191, signing(tmp_path))
        begin = stamp_of(codec.encode(attitude(0), start))
        assert begin > last
        last = begin
        for i in range(1, 400):
            stamp = stamp_of(codec.encode(attitude(i), start + 0.25 * (i // 2)))
            assert stamp > last
            last = stamp
        assert last - begin == pytest.approx(49.75 * 100_000, abs=500)
        written()
    assert int((tmp_path / "time").read_text()) > last


def test_a_peers_time_ahead_of_ours_is_taken_over(tmp_path: Path) -> None:
    ours = MavlinkCodec(1, 191, signing(tmp_path, "ours"))
    theirs = mavlink.MAVLink(None, 1, 1)
    theirs.signing.secret_key, theirs.signing.sign_outgoing = bytes.fromhex(KEY), True
    theirs.signing.timestamp = ahead = stamp_of(ours.encode(attitude(0), 0.0)) + 10**9
    ours.decode(bytes(attitude(1).pack(theirs)))
    assert stamp_of(ours.encode(attitude(2), 0.1)) > ahead


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o620])
def test_a_key_that_others_may_read_is_refused(tmp_path: Path, mode: int) -> None:
    with pytest.raises(ValueError, match="others may read the key; expected: chmod 600"):
        Signing(key_file(tmp_path, mode=mode), tmp_path / "time")


def test_a_pass_phrase_is_the_key_that_ground_stations_make_of_it(tmp_path: Path) -> None:
    key = Signing(key_file(tmp_path, "correct horse\n"), tmp_path / "time").key
    assert key == hashlib.sha256(b"correct horse").digest()


def test_files_that_cannot_be_used_give_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="cannot be read: No such file"):
        Signing(tmp_path / "none", tmp_path / "time")
    with pytest.raises(ValueError, match="empty, expected a key"):
        Signing(key_file(tmp_path, ""), tmp_path / "time")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ValueError, match="folder: cannot be read: Is a directory"):
        signing(tmp_path, "folder")
    with pytest.raises(ValueError, match="cannot be written"):
        Signing(key_file(tmp_path), tmp_path / "no-such-folder" / "time")
    assert sorted(os.listdir(tmp_path)) == ["folder", "key"]


def warnings_of(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]


@pytest.mark.parametrize("damaged", [b"", b"\0\0\0\0", b"yesterday", b"\xff9", b"9" * 5000])
def test_the_clock_stands_in_for_a_damaged_time_stamp_with_one_warning(
    tmp_path: Path, damaged: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    before = stamp_of(MavlinkCodec(1, 191, signing(tmp_path)).encode(attitude(0), 0.0))
    (tmp_path / "time").write_bytes(damaged)
    ours = signing(tmp_path)
    ours.open()
    ours.open()  # the link, again
    assert stamp_of(MavlinkCodec(1, 191, ours).encode(attitude(1), 5.0)) > before
    written()
    (warning,) = warnings_of(caplog)
    assert "expected the time stamp kept there: the clock's is taken" in warning
    assert int((tmp_path / "time").read_text()) > before


def test_without_stamp_and_clock_no_link_is_opened_until_the_clock_is_set(tmp_path: Path) -> None:
    kept = tmp_path / "time"
    kept.write_text("")
    tomorrow = time.time() + 86400.0
    os.utime(kept, (tomorrow, tomorrow))

    async def scene() -> None:
        near, far = memory_pair()
        await far.open()
        ours = signing(tmp_path)
        driver = MavlinkAutopilot(near, signing=ours)
        for _ in range(3):
            with pytest.raises(DeviceLost, match=r"time: found '', .*, and the clock is not set"):
                await driver.open()
            driver.heartbeat()  # which the daemon goes on to send
        assert kept.read_text() == ""  # nor is a wrong one kept
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(time, "time", lambda: tomorrow + 1.0)
            await driver.open()
        driver.heartbeat()
        assert stamp_of(await far.read()) >= (tomorrow - 1_420_070_400) * 100_000

    run_virtual(scene())


def test_a_full_disk_is_warned_of_and_all_is_signed_nevertheless(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / ".time.new").symlink_to("/dev/full")
    ours = MavlinkCodec(1, 191, signing(tmp_path))
    theirs = MavlinkCodec(1, 1, signing(tmp_path, "theirs"))
    for i in range(200):
        assert len(theirs.decode(ours.encode(attitude(i), 0.1 * i))) == 1
        written()
    (warning,) = warnings_of(caplog)
    assert warning == f"{tmp_path / 'time'}: cannot be written: No space left on device"


def test_a_loss_of_power_leaves_the_old_stamp_or_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The new file replaces the old one only after it has been written to the disk."""
    signing(tmp_path)
    kept = (tmp_path / "time").read_text()
    on_disk: list[str] = []

    def fsync(fd: int) -> None:
        assert (tmp_path / "time").read_text() == kept
        on_disk.append(Path(f"/proc/self/fd/{fd}").read_text())

    monkeypatch.setattr(os, "fsync", fsync)
    signing(tmp_path)
    assert on_disk == [(tmp_path / "time").read_text()] != [kept]
