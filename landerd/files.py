"""Reading and writing small files whole: no more than fits, and nothing half-written."""

import errno
import os
from contextlib import suppress
from pathlib import Path

MOST_BYTES = 16_000_000  # of a text: a hundred times the longest configuration


def read_text(path: Path) -> str:
    """Return what a text file holds, in UTF-8.

    Raises:
        OSError: it cannot be read, or holds more than MOST_BYTES: devices never end.
        UnicodeDecodeError: it is no text.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except ValueError:  # a zero byte in its name
        raise OSError(errno.EINVAL, "not a file name", str(path)) from None
    if len(data) > MOST_BYTES:
        raise OSError(errno.EFBIG, f"more than {MOST_BYTES / 1e6:.0f} MB", str(path))
    return data.decode("utf-8")


def why_unread(error: OSError | UnicodeDecodeError) -> str:
    """Return in a word or two why a text could not be read."""
    return error.strerror or str(error) if isinstance(error, OSError) else "not text"


def as_bytes(text: str) -> bytes:
    """Return a text in UTF-8, in which names of files that are none have escapes."""
    return text.encode("utf-8", errors="backslashreplace")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file, or leave the one that was there as it is.

    What is no file (a device, a pipe), a link to one, or a file in a folder that takes no other is
    written into.

    Raises:
        OSError: it cannot be written.
    """
    if path.is_symlink() or (path.exists() and not path.is_file()):
        path.write_bytes(data)
        return
    new = path.with_name(f".{path.name[:100]}.{os.getpid()}.new")
    try:
        new.write_bytes(data)
        if path.exists():
            new.chmod(path.stat().st_mode & 0o777)
        new.replace(path)
    except OSError as e:
        with suppress(OSError):
            new.unlink()
        if not isinstance(e, PermissionError):
            raise
        path.write_bytes(data)
