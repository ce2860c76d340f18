"""The part of `landerd report` that reads what campaigns kept, beside other tables."""

import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from landerd.analysis.page import Block, Heading, Lines, Text, as_html, as_markdown
from landerd.campaigns.journal import JournalError, Kept, read_kept
from landerd.campaigns.plan import Row
from landerd.campaigns.report import blocks_of
from landerd.commands.fault_runs import settings_of
from landerd.commands.shared import InputError, refusing
from landerd.config.files import ConfigError, default_config
from landerd.drivers import read_configuration
from landerd.files import as_bytes, write_whole

TITLE = "Results"
SECTION = "== "  # begins a line that is a heading, in tables as they stand


def write_campaigns(paths: Sequence[Path], output: Path) -> None:
    """Write what is to be said of these files as HTML or, into a .md, as Markdown.

    Raises:
        InputError: one cannot be read, or is none of these.
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
    names = " ".join(shlex.quote(path.name) for path in paths)
    return (
        f"Written by `landerd report {names} -o {output.name}`, never by hand. Behind ± and in "
        "columns `95 %` are 95 % intervals: of shares Wilson's, of means Student's. `p95` is what "
        "95 of 100 landings stay below. Errors are from the landing point to the vehicle's "
        "reference point at first contact, by the simulator's truth; times run from the first "
        "sighting within 18 m to disarming. What stands out failed first of its effect's values."
    )


def _as_it_stands(path: Path) -> list[Block]:
    """Return the sections of a file of tables. Raises InputError."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        raise InputError(f"{path}: cannot be read") from None
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
    """Return the command line that flies a flight again."""
    faults = settings_of(seed) if row.faults else ()
    settings = [word for each in row.settings for word in ("--set", each)]
    drawn = [word for each in faults for word in ("--set", each)]
    words = ("landerd", "sim", row.scenario, "--seed", str(seed))
    return shlex.join([*words, *settings, *kept.plan.command, *drawn])


class ReferenceWorld:
    """What keys are in the world that all quoted figures use: nominal to sweeps."""

    def __init__(self) -> None:
        self._config: Any = None

    def __call__(self, key: str) -> Any:
        """Return a key's value; None: there is none."""
        if self._config is None:
            with refusing(ConfigError):
                self._config = read_configuration(default_config()).config
        value: Any = self._config
        for part in key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else getattr(value, part, None)
        return value
