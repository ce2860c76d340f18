"""Tells which configuration keys an upgrade changes; the configuration itself is left alone."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from landerd.config.files import ConfigError, Loaded, config_dir
from landerd.drivers import read_configuration
from landerd.installation.program import OPT
from landerd.installation.steps import Step, write

DEFAULTS = OPT / "defaults.json"  # of the version that was installed last

Keys = Mapping[str, Any]  # by dotted key, plain values


def key_steps(configuration: Path) -> tuple[list[Step], list[str], list[str]]:
    """Return what notes this version's defaults, what changed in them, and what is wrong.

    Args:
        configuration: the user's; those beside it are looked at too.
    """
    now = own_defaults()
    try:
        before: Keys = json.loads(DEFAULTS.read_text(encoding="utf-8"))
    except FileNotFoundError:
        before = now
    news = changed_keys(before, now, configuration)
    steps = list(write(DEFAULTS, json.dumps(now, indent=1)))
    return steps, news, faults(configuration.parent)


def own_defaults() -> dict[str, Any]:
    """Return all keys of this version but the simulator's, with their defaults."""
    return _keys(read_configuration(config_dir() / "default.yaml"))


def changed_keys(before: Keys, now: Keys, configuration: Path) -> list[str]:
    """Return a line for each key that came, went or has another default.

    Args:
        before: defaults of the version that was installed.
        now: of this one.
        configuration: the user's; where it says otherwise the line says that it still does.
    """
    try:
        theirs: Keys = _keys(read_configuration(configuration))
    except ConfigError:
        theirs = {}  # which is told as a fault
    lines = [f"gone: {key}" for key in before if key not in now]
    for key, value in now.items():
        if key not in before:
            lines.append(f"new: {key}: {_shown(value)}")
        elif before[key] != value:
            line = f"another default: {key}: {_shown(value)}, was {_shown(before[key])}"
            kept = key in theirs and theirs[key] != value
            lines.append(f"{line}; yours stays {_shown(theirs[key])}" if kept else line)
    return lines


def faults(folder: Path) -> list[str]:
    """Return what this version cannot read in the configurations of a folder, a line each."""
    found = []
    for path in sorted(folder.glob("landerd*.yaml")):
        try:
            read_configuration(path)
        except ConfigError as e:
            found += e.lines
    return found


def _keys(loaded: Loaded) -> dict[str, Any]:
    keys = dict(_flat("", loaded.config.model_dump(mode="json")))
    for section, options in loaded.options.items():
        if section != "sim":
            keys.update(_flat(f"{section}.", options.model_dump(mode="json")))
    return keys


def _flat(at: str, tree: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, dict) and value:
            yield from _flat(f"{at}{key}.", value)
        elif isinstance(value, str):
            # Where landerd's own files are differs between checkout and environment.
            yield f"{at}{key}", value.removeprefix(f"{config_dir()}/")
        else:
            yield f"{at}{key}", value


def _shown(value: Any) -> str:
    return json.dumps(value)
