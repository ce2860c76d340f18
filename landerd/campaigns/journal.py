"""Runs kept in a file, a line of JSON each as they end, so that a stopped campaign can go on.

The first line says what is flown; before the runs of each sitting a line says when, and by which
landerd.
"""

import dataclasses
import errno
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from landerd.campaigns.plan import Campaign, campaign_of
from landerd.campaigns.pool import Run, Task


class JournalError(Exception):
    """The file cannot be used; the text is one line for the user."""


class Sitting(NamedTuple):
    """One session of flying: when it began, and the version of landerd."""

    began: str  # date and time, UTC
    version: str  # of landerd, with its commit where that is known


@dataclass(frozen=True)
class Plan:
    """The campaigns that are flown, and the configuration.

    Attributes:
        settings: identifies the configuration.
        campaigns: the campaigns by name.
        command: further arguments of the command line, "--set KEY=VALUE" and so on.
    """

    settings: str
    campaigns: Mapping[str, Campaign] = field(default_factory=dict)
    command: tuple[str, ...] = ()

    def as_plain(self) -> dict[str, Any]:
        """Return the plan as values that JSON can represent."""
        campaigns = {
            name: campaign.model_dump(mode="json", exclude_defaults=True)
            for name, campaign in self.campaigns.items()
        }
        return {"settings": self.settings, "campaigns": campaigns, "command": self.command}

    @classmethod
    def from_plain(cls, data: Mapping[str, Any]) -> Self:
        """Return the plan of what `as_plain` returned; older files have the settings only.

        Raises:
            ValueError: a campaign cannot be used.
        """
        campaigns = {
            # As JSON: there a list may be a tuple.
            name: Campaign.model_validate_json(json.dumps(plain))
            for name, plain in data.get("campaigns", {}).items()
        }
        return cls(data["settings"], campaigns, tuple(data.get("command", ())))


@dataclass(frozen=True)
class Kept:
    """The contents of a file."""

    plan: Plan
    sittings: tuple[Sitting, ...] = ()
    runs: Mapping[Task, Run] = field(default_factory=dict)


def _reason(e: OSError | UnicodeDecodeError) -> str:
    if isinstance(e, OSError):
        return e.strerror or "it fails"
    return "not text, expected a file that landerd campaign --keep has written"


def read_runs(path: Path) -> dict[Task, Run]:
    """Return the runs in a file, of any campaign.

    Raises:
        JournalError: it cannot be read, or holds something else.
    """
    return dict(read_kept(path).runs)


def read_kept(path: Path) -> Kept:
    """Return the contents of a file; if it has no plan, one is made from its runs.

    Raises:
        JournalError: it cannot be read, or holds something else.
    """
    lines = _lines(path)
    try:
        head = json.loads(lines[0])
        if "settings" not in head and "scenario" in head:  # as landerd sim --json prints them
            kept = _printed(lines)
        else:
            kept = _kept(path, Plan.from_plain(head), lines)
    except (IndexError, KeyError, TypeError, ValueError, AttributeError):
        raise JournalError(
            f"{path}: expected a file that landerd campaign --keep has written"
        ) from None
    if kept.plan.campaigns or not kept.runs:
        return kept
    campaigns = {path.stem: campaign_of(dict.fromkeys(name for name, _ in kept.runs))}
    return dataclasses.replace(kept, plan=dataclasses.replace(kept.plan, campaigns=campaigns))


def _lines(path: Path) -> list[str]:
    """Return the whole lines of a file. Raises JournalError."""
    try:
        if not path.is_file():
            raise OSError(errno.EINVAL, "not a file")
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError) as e:
        raise JournalError(f"{path}: cannot be read: {_reason(e)}") from None
    if lines and not lines[-1].endswith("\n"):
        del lines[-1]  # the process was killed while it wrote
    return lines


def _kept(path: Path, plan: Plan, lines: Sequence[str]) -> Kept:
    """Return the contents of all lines but the first. Raises JournalError."""
    runs: dict[Task, Run] = {}
    sittings = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            data = json.loads(line)
            if "began" in data:
                sittings.append(Sitting(**data))
                continue
            run = Run(**data)
        except (ValueError, TypeError):
            raise JournalError(f"{path}:{number}: expected a run") from None
        runs[run.scenario, run.seed] = run
    return Kept(plan, tuple(sittings), runs)


def _printed(lines: Sequence[str]) -> Kept:
    """Return the flights that `landerd sim --json` printed, a line each, seeds may come again.

    Raises:
        ValueError, KeyError, TypeError: a line is none.
    """
    results = [json.loads(line) for line in lines]
    sittings = dict.fromkeys(Sitting(**r["flown"]) for r in results if "flown" in r)
    runs = {
        (result["scenario"], number): Run(result["scenario"], result["seed"], result)
        for number, result in enumerate(results)
    }
    return Kept(Plan(""), tuple(sittings), runs)


class Journal:
    """The runs of one campaign with one configuration.

    Attributes:
        runs: the runs in the file when it was opened.
    """

    def __init__(self, path: Path, plan: Plan, sitting: Sitting) -> None:
        """Read the file, or create it.

        Args:
            path: of the file.
            plan: runs of two configurations are not mixed.
            sitting: the session that begins now.

        Raises:
            JournalError: it cannot be read or written, or holds something else.
        """
        lines = _lines(path) if path.exists() else []
        if lines and _settings(lines[0]) != plan.settings:
            raise JournalError(f"{path}: holds no runs of this campaign with this configuration")
        self.runs = _kept(path, plan, lines).runs
        try:
            self._file: TextIOWrapper = path.open("a", encoding="utf-8")
            self._file.truncate(len("".join(lines).encode()))
            if not lines:
                self._write(plan.as_plain())
            self._write(sitting._asdict())
        except OSError as e:
            raise JournalError(f"{path}: cannot be written: {_reason(e)}") from None

    def keep(self, run: Run) -> None:
        """Append a run to the file."""
        self._write(dataclasses.asdict(run))

    def _write(self, data: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(data) + "\n")
        self._file.flush()

    def __enter__(self) -> Self:
        """Return the journal itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""
        self._file.close()


def _settings(head: str) -> str | None:
    try:
        settings = json.loads(head)["settings"]
    except (ValueError, KeyError, TypeError):
        return None
    return settings if isinstance(settings, str) else None
