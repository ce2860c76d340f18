"""The part of `landerd report` that makes a page from campaigns' runs (--keep) and from tables."""

import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from landerd.analysis.page import Block, Heading, Lines, Text, as_html, as_markdown
from landerd.campaigns.journal import JournalError, Kept, read_kept
from landerd.campaigns.plan import Row
from landerd.campaigns.report import blocks_of
from landerd.commands.fault_runs import drawn_settings
from landerd.commands.shared import InputError, refusing
from landerd.config.files import ConfigError, default_config
from landerd.drivers import read_configuration
from landerd.files import as_bytes, why_unread, write_whole

TITLE = "Results"
SECTION = "== "  # begins a heading in a file of tables (.txt)


def write_campaigns(paths: Sequence[Path], output: Path) -> None:
    """Write a page on the results in these files.

    Args:
        paths: runs from `landerd campaign --keep` or `landerd sim --json` (.jsonl), and tables
            (.txt).
        output: the page: Markdown if the suffix is .md, else HTML.

    Raises:
        InputError: a file cannot be read, or has no results.
        OSError: the page cannot be written.
    """
    blocks: list[Block] = [Heading(TITLE, 1), Text(_made_of(paths, output))]
    nominal = ReferenceWorld()
    for path in paths:
        if path.suffix == ".txt":
            blocks += _as_it_stands(path)
            continue
        with refusing(JournalError):
            kept = read_kept(path)
        found = blocks_of(kept, partial(_again, kept), nominal)
        if not found:
            raise InputError(f"{path}: holds no run that can be shown")
        blocks += found
    is_text = output.suffix == ".md"
    text = as_markdown(blocks) if is_text else as_html(f"landerd: {TITLE}", blocks)
    write_whole(output, as_bytes(text))


def _made_of(paths: Sequence[Path], output: Path) -> str:
    """Return the page's first paragraph: how it was made, and how to read it."""
    names = " ".join(shlex.quote(path.name) for path in paths)
    return (
        f"Written by `landerd report {names} -o {output.name}`, never by hand. Behind ± and in "
        "columns `95 %` are 95 % intervals: of shares Wilson's, of means Student's. `p95` is what "
        "95 of 100 landings stay below. Errors are from the landing point to the vehicle's "
        "reference point at first contact, by the simulator's truth; times run from the first "
        "sighting within 18 m to disarming. What stands out failed first of its effect's values."
    )


def _as_it_stands(path: Path) -> list[Block]:
    """Return the tables of a .txt file as they are, under its headings.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as e:
        raise InputError(f"{path}: cannot be read: {why_unread(e)}") from None
    blocks: list[Block] = [Heading(path.stem, 2)]
    section: list[str] = []
    for line in [*lines, SECTION]:
        if not line.startswith(SECTION):
            section.append(line)
            continue
        if any(section):
            blocks.append(Lines(section, is_table=True))
        section = []
        if line != SECTION:
            blocks.append(Heading(line.removeprefix(SECTION), 3))
    return blocks


def _again(kept: Kept, row: Row, seed: int) -> str:
    """Return the command line that repeats a flight.

    Args:
        kept: the file that has it.
        row: of the campaign.
        seed: of the flight.
    """
    settings = [word for each in row.settings for word in ("--set", each)]
    drawn = [word for each in drawn_settings(row, seed) for word in ("--set", each)]
    words = ("landerd", "sim", row.scenario, "--seed", str(seed))
    return shlex.join([*words, *settings, *kept.plan.command, *drawn])


class ReferenceWorld:
    """A function that returns a key's nominal value for sweeps: its default.

    The default configuration is the simulated world in which all quoted figures were measured.
    """

    def __init__(self) -> None:
        self._config: Any = None

    def __call__(self, key: str) -> Any:
        """Return the value of a dotted key; None: there is no such key."""
        if self._config is None:
            with refusing(ConfigError):
                self._config = read_configuration(default_config()).config
        value: Any = self._config
        for part in key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else getattr(value, part, None)
        return value
