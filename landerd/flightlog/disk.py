"""Files that lose at most unsynced data, and a folder of logs that leaves room on the disk."""

import contextlib
import os
from pathlib import Path


class SyncedFile:
    """A new file whose bytes stay in memory until `sync`, and longer if the disk is full.

    The file on the disk is at all times a beginning of the bytes written.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: it exists or cannot be made.
        """
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._waiting = bytearray()
        self._length = 0
        self.path = path
        self.error: str | None = None  # why the disk took no bytes; None: it did
        with contextlib.suppress(OSError):  # so that its name, too, survives a power cut
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    @property
    def waiting(self) -> int:
        """Number of bytes that the disk has not taken yet."""
        return len(self._waiting)

    def write(self, data: bytes) -> int:
        """Take bytes for the next `sync`."""
        self._waiting += data
        self._length += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written, on the disk or waiting."""
        return self._length

    def flush(self) -> None:
        """Do nothing: bytes go to the disk in `sync`."""

    def sync(self) -> bool:
        """Write waiting bytes to the disk safely; return False if it does not take them (now)."""
        try:
            while self._waiting:
                done = os.write(self._fd, self._waiting)
                del self._waiting[:done]
            os.fsync(self._fd)
        except OSError as e:
            self.error = e.strerror
            return False
        self.error = None
        return True

    def close(self) -> None:
        """Sync and close; bytes that the disk does not take are lost."""
        self.sync()
        os.close(self._fd)


def free_bytes(folder: Path) -> int:
    """Return the free bytes on the folder's disk."""
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize


def next_number(folder: Path) -> int:
    """Return the next log's number: the clock of a board without battery cannot order logs."""
    return 1 + max(
        (n for log in folder.glob("*.mcap") if (n := _number(log)) is not None), default=0
    )


def rotate(folder: Path, most_bytes: int, running: Path) -> list[Path]:
    """Delete the oldest logs until all of them together have at most this many bytes.

    Args:
        folder: folder of numbered logs; files with other names are ignored.
        most_bytes: most bytes that may remain.
        running: the log in progress: neither counted nor deleted, however long it gets.

    Returns:
        What was deleted.
    """
    logs = sorted(
        (number, part_number(path), path)
        for path in folder.iterdir()
        if path.suffix in (".mcap", ".tlog") and (number := _number(path)) is not None
    )
    sizes: dict[Path, int] = {}
    for *_, path in logs:
        if path.stem != running.stem:
            with contextlib.suppress(OSError):  # it was deleted by others meanwhile
                sizes[path] = path.stat().st_size
    total = 0
    for size in sizes.values():
        total += size
    deleted = []
    for path, size in sizes.items():
        if total <= most_bytes:
            break
        try:
            path.unlink(missing_ok=True)
        except OSError:  # it cannot be deleted: a newer one is deleted instead
            continue
        total -= size
        deleted.append(path)
    return deleted


# ---- a flight in several files: NAME.mcap, NAME.2.mcap, NAME.3.mcap ----------------------------


def part_number(path: Path) -> int:
    """Return which part of its flight a log is, from 1."""
    digits = Path(path.stem).suffix.removeprefix(".")
    return int(digits) if digits.isdecimal() else 1


def part(path: Path, number: int) -> Path:
    """Return the file of another part of a log's flight."""
    first = path.stem if part_number(path) == 1 else Path(path.stem).stem
    return path.with_name(f"{first}{f'.{number}' if number > 1 else ''}{path.suffix}")


def later_flight(path: Path, number: int) -> Path:
    """Return the file of a later flight (from 2) of a run that was to be recorded in one file.

    Its name is not one that users choose: a file that an earlier run left there is removed.
    """
    return path.with_stem(f"{path.stem}.restart-{number}")


def _number(path: Path) -> int | None:
    digits, dash, _ = path.stem.partition("-")
    return int(digits) if dash and len(digits) == 5 and digits.isdecimal() else None
