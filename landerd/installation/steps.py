"""The steps of an installation: what is to be done, in words, and how.

A plan holds only what is not as it should be yet, so a second run has nothing to do.
"""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path


class InstallError(Exception):
    """A step could not be done; the text is one line."""


@dataclass(frozen=True)
class Step:
    """One thing to do; `do` raises InstallError or OSError."""

    text: str
    do: Callable[[], None]


def call(*command: str, where: Path | None = None) -> None:
    """Run a command in a folder. Raises InstallError with the last line that it said."""
    try:
        done = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise InstallError(f"{command[0]} is not there") from None
    if done.returncode:
        said = (done.stdout + done.stderr).strip().splitlines()
        reason = said[-1] if said else f"exit code {done.returncode}"
        raise InstallError(f"{' '.join(command)}: {reason}")


def command(*words: str) -> Step:
    """Return a step that runs a command."""
    return Step(f"run {' '.join(words)}", partial(call, *words))


def write(path: Path, text: str, *, why: str = "") -> Iterator[Step]:
    """Yield what gives a file this text, readable to all, if it has another."""
    try:
        if path.read_text(encoding="utf-8") == text:
            return
        verb = "replace"
    except FileNotFoundError:
        verb = "write"

    def do() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_name(f"{path.name}.new")
        new.write_text(text, encoding="utf-8")
        new.chmod(0o644)
        new.replace(path)

    yield Step(f"{verb} {path}{why}", do)


def link(path: Path, target: Path) -> Iterator[Step]:
    """Yield what makes a symbolic link, if it is not there."""
    if path.is_symlink() and path.readlink() == target:
        return

    def do() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        path.symlink_to(target)

    yield Step(f"link {path} to {target}", do)


def remove(path: Path) -> Iterator[Step]:
    """Yield what removes a file, a link or a whole folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        yield Step(f"remove {path}", partial(shutil.rmtree, path))
    elif path.exists() or path.is_symlink():
        yield Step(f"remove {path}", path.unlink)
