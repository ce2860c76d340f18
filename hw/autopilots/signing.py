"""Signatures of MAVLink 2 messages: https://mavlink.io/en/guide/message_signing.html.

pymavlink signs what goes out; what comes in is checked here, because pymavlink notes the time stamp
of a message before it checks the signature: one forged message shuts a sender out for ever.
"""

import errno
import hashlib
import hmac
import logging
import os
import stat
import threading
import time
from pathlib import Path

from landerd.ports import DeviceLost

log = logging.getLogger(__name__)

LENGTH = 13  # of a signature: link, time stamp (6), hash (6)
_EPOCH_S = 1_420_070_400  # 1 January 2015, UTC
_TICKS_PER_S = 100_000
_MOST_BEHIND = 60 * _TICKS_PER_S  # ticks: a new sender's stamp behind ours; pymavlink's number
# The file is ahead of what was sent, so that it is right after a crash, and written in good time,
# so that it is also after a loss of power with the last write not on the disk.
_AHEAD, _REST = 60 * _TICKS_PER_S, 30 * _TICKS_PER_S
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EIO)  # no fault of the configuration


class _Damaged(Exception):
    """The file of the time stamp is there, but not what it held; one line."""


class Signing:
    """The key, and a time stamp that never goes back, not over a restart either."""

    def __init__(self, key_file: Path, time_file: Path) -> None:
        """Read the key and the time stamp reached.

        Args:
            key_file: 64 hexadecimal digits, or a pass phrase, whose SHA-256 is the key.
            time_file: where the time stamp is kept; made if it is not there.

        A file that was damaged waits for `open`.

        Raises:
            ValueError: a file cannot be used or the key may be read by others; one line.
        """
        self.key = _read_key(key_file)
        self._time_file = time_file
        self._damage: str | None = None  # why the time stamp reached is not known
        self._last = max(_clock(), 0)
        try:
            self._last = max(self._last, _read_time(time_file))
        except _Damaged as e:
            self._damage = str(e)
            self._dated_s = max(path.stat().st_mtime for path in (key_file, time_file))
        self._begin: tuple[float, int] | None = None  # loop time and time stamp then
        self._streams: dict[tuple[int, int, int], int] = {}  # newest stamp by link and sender
        self._saved = self._last
        self._saving = threading.Lock()  # on a slow disk the next one comes before the last ends
        if self._damage is not None:
            return
        try:
            self._save_time()
        except OSError as e:
            # What the disk does not take is tried again with the first message, and told then:
            # meanwhile the clock and the peers' time stamps keep ours from going back.
            if e.errno not in _DISK_ERRORS:
                raise ValueError(f"{time_file}: cannot be written: {e.strerror}") from None

    def open(self) -> None:
        """Make sure of the time stamp before anything is signed: the clock's for a lost one.

        Raises:
            DeviceLost: it is lost, and the clock is not set: it is behind its files' dates.
        """
        if self._damage is None:
            return
        if time.time() < self._dated_s:
            raise DeviceLost(
                f"{self._damage}, and the clock is not set: connect a network, or set it by date -s"
            )
        log.warning("%s: the clock's is taken", self._damage)
        self._damage, self._begin = None, None
        self._last = max(self._last, _clock())
        self._save_time_aside()

    def stamp(self, now: float) -> int:
        """Return the time stamp of the next message, sent at loop time now."""
        if self._begin is None:
            self._begin = (now, self._last)
        started, base = self._begin
        self._last = max(self._last + 1, base + int((now - started) * _TICKS_PER_S))
        if self._damage is None and self._last > self._saved - _REST:
            self._save_time_aside()
        return self._last

    def accepts(self, frame: bytes, system: int, component: int) -> bool:
        """Tell whether a frame with sound checksum is signed with the key, and is not a repetition.

        Frames without signature are not accepted.
        """
        if not self.is_genuine(frame):
            return False
        link, stamp = frame[-LENGTH], int.from_bytes(frame[-LENGTH + 1 : -6], "little")
        sender = (link, system, component)
        oldest = self._streams.get(sender, self._last - _MOST_BEHIND)
        if stamp <= oldest:
            return False
        self._streams[sender] = stamp
        self._last = max(self._last, stamp)
        return True

    def is_genuine(self, frame: bytes) -> bool:
        """Tell whether a frame is signed with the key; it may be a repetition."""
        if frame[0] != 0xFD or not frame[2] & 0x01:
            return False
        expected = hashlib.sha256(self.key + frame[:-6]).digest()[:6]
        return hmac.compare_digest(expected, frame[-6:])

    def _save_time_aside(self) -> None:
        """Write it in a thread: a slow disk would hold up the set-points."""
        self._saved = self._last + _AHEAD  # do not try at every message
        threading.Thread(target=self._try_to_save, name="signing", daemon=True).start()

    def _try_to_save(self) -> None:
        try:
            self._save_time()
        except OSError as e:
            log.warning("%s: cannot be written: %s", self._time_file, e.strerror)

    def _save_time(self) -> None:
        new = self._time_file.with_name(f".{self._time_file.name}.new")
        with self._saving:
            saved = self._last + _AHEAD
            with new.open("w", encoding="ascii") as file:
                file.write(f"{saved}\n")
                file.flush()
                os.fsync(file.fileno())  # or a loss of power may leave an empty one in its place
            new.replace(self._time_file)
            self._saved = saved


def _read_key(path: Path) -> bytes:
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as e:
        reason = e.strerror if isinstance(e, OSError) else "not text"
        raise ValueError(f"{path}: cannot be read: {reason}") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ValueError(f"{path}: others may read the key; expected: chmod 600 {path}")
    if not text:
        raise ValueError(f"{path}: empty, expected a key of 64 hexadecimal digits or a pass phrase")
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    return key if len(key) == 32 else hashlib.sha256(text.encode("utf-8")).digest()


def _clock() -> int:
    """Return the time stamp by the wall clock."""
    return int((time.time() - _EPOCH_S) * _TICKS_PER_S)


def _read_time(path: Path) -> int:
    """Return the time stamp kept, 0 where there is none yet.

    Raises:
        _Damaged: it is lost.
        ValueError: the file is none, or another user's.
    """
    try:
        text = path.read_bytes().decode("ascii", "replace").strip()
    except FileNotFoundError:
        return 0
    except OSError as e:
        reason = f"{path}: cannot be read: {e.strerror}"
        raise (_Damaged if e.errno in _DISK_ERRORS else ValueError)(reason) from None
    if not (len(text) < 16 and text.isdecimal() and int(text) < 1 << 47):
        raise _Damaged(f"{path}: found {text[:20]!r}, expected the time stamp kept there")
    return int(text)
