"""Signatures of MAVLink 2 messages: https://mavlink.io/en/guide/message_signing.html.

pymavlink signs the messages sent. Messages received are checked here, because pymavlink notes a
message's time stamp before it checks the signature: one forged message with a time stamp far ahead
would make it refuse all later messages of that sender.
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

LENGTH = 13  # bytes of a signature: link (1), time stamp (6), hash (6)
_EPOCH_S = 1_420_070_400  # 1 January 2015, UTC
_TICKS_PER_S = 100_000
# How far a new sender's time stamp may be behind ours, ticks; the figure is pymavlink's.
_MOST_BEHIND = 60 * _TICKS_PER_S
# The time stamp in the file is ahead of those sent by up to _AHEAD, so that after a crash no stamp
# is used twice. It is written again with _REST left, so that this also holds after a loss of power
# by which the last write did not reach the disk. Ticks.
_AHEAD, _REST = 60 * _TICKS_PER_S, 30 * _TICKS_PER_S
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EIO)  # not due to the configuration


class _Damaged(Exception):
    """The file of the time stamp exists but its content is lost; the text is one line."""


class Signing:
    """Holds the key, and a time stamp that never goes back, not even across a restart."""

    def __init__(self, key_file: Path, time_file: Path) -> None:
        """Read the key and the last time stamp used.

        Args:
            key_file: 64 hexadecimal digits, or a pass phrase, whose SHA-256 is the key.
            time_file: file in which the time stamp is kept; created if it is missing.

        A damaged time_file is dealt with by `open`.

        Raises:
            ValueError: a file cannot be used, or others may read the key; the text is one line.
        """
        self.key = _read_key(key_file)
        self._time_file = time_file
        self._damage: str | None = None  # why the last time stamp used is not known
        self._last = max(_clock(), 0)
        try:
            self._last = max(self._last, _read_time(time_file))
        except _Damaged as e:
            self._damage = str(e)
            self._dated_s = max(path.stat().st_mtime for path in (key_file, time_file))
        self._begin: tuple[float, int] | None = None  # loop time and time stamp then
        self._streams: dict[tuple[int, int, int], int] = {}  # newest stamp by link and sender
        self._saved = self._last
        self._saving = threading.Lock()  # on a slow disk one write may begin before another ends
        if self._damage is not None:
            return
        try:
            self._save_time()
        except OSError as e:
            # A failed write is tried again with the first message, and reported then. Until then
            # the clock and the peers' time stamps keep ours from going back.
            if e.errno not in _DISK_ERRORS:
                raise ValueError(f"{time_file}: cannot be written: {e.strerror}") from None

    def open(self) -> None:
        """Make sure of the time stamp before anything is signed; replace a lost one by the clock's.

        Raises:
            DeviceLost: the time stamp is lost and the clock is not set, as it is behind the dates
                of the files.
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
        """Tell whether a frame is signed with the key and is not a repetition.

        Its checksum has been verified. A frame without a signature is not accepted.
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
        """Write the time stamp in a thread: a slow disk would hold up the set-points."""
        self._saved = self._last + _AHEAD  # also if it fails: not to be tried at each message
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
                os.fsync(file.fileno())  # else a loss of power may leave an empty file
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
    """Return the time stamp of now by the wall clock, ticks."""
    return int((time.time() - _EPOCH_S) * _TICKS_PER_S)


def _read_time(path: Path) -> int:
    """Return the time stamp in a file, ticks; 0 if the file does not exist yet.

    Raises:
        _Damaged: the time stamp is lost.
        ValueError: the path is not a regular file, or it belongs to another user.
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
