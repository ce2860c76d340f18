"""Small YAML files that are one mapping: camera calibrations and pad layouts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml


def read_mapping(path: Path, error: type[Exception], expected: str) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Args:
        path: the file.
        error: raised with one line, which names the file, if it is no mapping.
        expected: what the mapping is, in words.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as e:
        reason = e.strerror if isinstance(e, OSError) else "not text"
        raise error(f"{path}: cannot be read: {reason}") from None
    except yaml.YAMLError as e:
        mark = getattr(e, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        raise error(f"{path}{line}: not YAML") from None
    if not isinstance(data, dict):
        raise error(f"{path}: expected {expected}")
    return data


def put(tree: dict[str, Any], path: Sequence[str], value: Any) -> None:
    """Set a value in nested mappings, which are made where they are missing."""
    for name in path[:-1]:
        tree = tree.setdefault(name, {})
    tree[path[-1]] = value
