"""The recorded flights: which there are, their files, and reports of them."""

import contextlib
import os
import re
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

MOST_LISTED = 20
LONGEST_S = 300.0  # a report takes, on a slow board
_LOOK_S = 0.2
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.@+-]*\.(?:mcap|tlog)", re.ASCII)


class NoReport(Exception):
    """There is no report now; the text says why."""


class Flights:
    """A folder of logs. Reports are made in a process of their own, one at a time."""

    def __init__(self, folder: Path | None, may_work: Callable[[], bool]) -> None:
        """Make it.

        Args:
            folder: where flights are recorded; None: nowhere.
            may_work: whether the computer has time for it: not in flight.
        """
        self._folder = folder
        self._may_work = may_work
        self._one = threading.Lock()
        self._made: tuple[tuple[Path, int], bytes] | None = None  # the last report

    def listed(self) -> list[dict[str, Any]]:
        """Return the newest flights first, as plain values."""
        logs = [path for path in self._files() if path.suffix == ".mcap"]
        found = []
        for path in sorted(logs, key=lambda path: path.name, reverse=True)[:MOST_LISTED]:
            with contextlib.suppress(OSError):  # just deleted for room
                stat = path.stat()
                tlog = path.with_suffix(".tlog")
                found.append(
                    {
                        "name": path.stem,
                        "ended": stat.st_mtime,
                        "mb": round(stat.st_size / 1e6, 1),
                        "tlog_mb": round(tlog.stat().st_size / 1e6, 1) if tlog.exists() else None,
                    }
                )
        return found

    def file(self, name: str) -> Path | None:
        """Return a log of this name; None: there is none."""
        return next((path for path in self._files() if path.name == name), None)

    def report(self, log: Path) -> bytes:
        """Return the page that `landerd report` makes of a log; it takes its time.

        Raises:
            NoReport: not now, or never.
            OSError: the log is not there any more.
        """
        if not self._one.acquire(blocking=False):
            raise NoReport("another report is being made: try again in a minute")
        try:
            key = (log, log.stat().st_size)
            if self._made is None or self._made[0] != key:
                self._made = (key, self._make(log))
            return self._made[1]
        finally:
            self._one.release()

    def _files(self) -> list[Path]:
        try:
            found = list(self._folder.iterdir()) if self._folder is not None else []
        except OSError:
            return []
        return [path for path in found if _NAME.fullmatch(path.name) and path.is_file()]

    def _make(self, log: Path) -> bytes:
        with tempfile.TemporaryDirectory(prefix="landerd-") as folder:
            output = Path(folder) / "report.html"
            with subprocess.Popen(
                [sys.executable, "-m", "landerd", "report", str(log), "-o", str(output)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            ) as process:
                with contextlib.suppress(OSError):  # a hardened service may not
                    os.setpriority(os.PRIO_PROCESS, process.pid, 19)
                try:
                    error = self._end_of(process)
                finally:
                    process.kill()
            if process.returncode != 0:
                raise NoReport(error or "no report can be made of it")
            return output.read_bytes()

    def _end_of(self, process: subprocess.Popen[bytes]) -> str:
        """Wait for it, and return what it says in its last line of stderr."""
        for _ in range(round(LONGEST_S / _LOOK_S)):
            if not self._may_work():
                raise NoReport("not while the vehicle is armed")
            with contextlib.suppress(subprocess.TimeoutExpired):
                _, error = process.communicate(timeout=_LOOK_S)
                return error.decode(errors="replace").strip().rpartition("\n")[2]
        raise NoReport("it took too long: copy the log, and make the report on another computer")
