"""Runs kept in a file, a line of JSON each as they end, so that a stopped campaign can go on."""

import dataclasses
import json
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from types import TracebackType
from typing import Self

from landerd.campaigns.pool import Run, Task


class JournalError(Exception):
    """The file cannot be used; the text is one line for the user."""


def _reason(e: OSError | UnicodeDecodeError) -> str:
    return e.strerror or "it fails" if isinstance(e, OSError) else "not text"


def read_runs(path: Path) -> dict[Task, Run]:
    """Return the runs that a file holds, of whatever campaign.

    Raises:
        JournalError: it cannot be read, or holds something else.
    """
    lines = _lines(path)
    if not (lines and lines[0].startswith('{"settings": ')):
        raise JournalError(f"{path}: expected a file that landerd campaign --keep has written")
    return _runs(path, lines)


def _lines(path: Path) -> list[str]:
    """Return the whole lines of a file. Raises JournalError."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError) as e:
        raise JournalError(f"{path}: cannot be read: {_reason(e)}") from None
    if lines and not lines[-1].endswith("\n"):
        del lines[-1]  # the process was killed while it wrote
    return lines


def _runs(path: Path, lines: Sequence[str]) -> dict[Task, Run]:
    """Return the runs in all lines but the first. Raises JournalError."""
    runs: dict[Task, Run] = {}
    for number, line in enumerate(lines[1:], start=2):
        try:
            run = Run(**json.loads(line))
        except (ValueError, TypeError):
            raise JournalError(f"{path}:{number}: expected a run") from None
        runs[run.scenario, run.seed] = run
    return runs


class Journal:
    """The runs of one campaign with one configuration.

    Attributes:
        runs: those that the file held when it was opened.
    """

    def __init__(self, path: Path, settings: str) -> None:
        """Read the file, or begin it.

        Args:
            path: of the file.
            settings: tells one configuration from another; runs of two are not mixed.

        Raises:
            JournalError: it cannot be read or written, or holds something else.
        """
        head = json.dumps({"settings": settings})
        lines = _lines(path) if path.exists() else []
        if lines and lines[0].rstrip("\n") != head:
            raise JournalError(f"{path}: holds no runs of this campaign with this configuration")
        self.runs = _runs(path, lines)
        try:
            self._file: TextIOWrapper = path.open("a", encoding="utf-8")
            self._file.truncate(len("".join(lines).encode()))
            if not lines:
                self._write(head)
        except OSError as e:
            raise JournalError(f"{path}: cannot be written: {_reason(e)}") from None

    def keep(self, run: Run) -> None:
        """Write a run down."""
        self._write(json.dumps(dataclasses.asdict(run)))

    def _write(self, line: str) -> None:
        self._file.write(line + "\n")
        self._file.flush()

    def __enter__(self) -> Self:
        """Nothing more to do."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""
        self._file.close()
