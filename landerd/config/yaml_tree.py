"""Parses YAML files into trees in which every value has the file and line it came from.

Plain scalars are those of YAML 1.2, so that `yes`, `010` and `1:30` are not converted as in 1.1.
Tags, aliases and duplicate keys are faults. Faults are collected, not raised, so that all of them
can be reported together.
"""

import functools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from landerd.files import read_text, why_unread
from landerd.section import NUMBER, value_in_words

Loc = tuple[str | int, ...]  # place of a value in a tree: keys of blocks and indices of lists

# A block with one of these as its only key is a distribution (landerd.config.distributions).
DISTRIBUTIONS = frozenset({"uniform", "log_uniform", "normal", "choice", "sign"})

_OVERRIDE = "--set "  # begins the source of a value from the command line


@dataclass(frozen=True, order=True)
class Place:
    """Where a value is written: file and line, or command line."""

    source: str  # path of a file, or "--set KEY=VALUE"
    line: int = 0  # counted from 1; 0: the source as a whole

    def __str__(self) -> str:
        return f"{self.source}:{self.line}" if self.line else self.source


@dataclass(frozen=True, order=True)
class Fault:
    """An error in the configuration, reported to the user as one line."""

    place: Place
    key: str  # dotted key of the value; "": the error is not in one value
    text: str

    def __str__(self) -> str:
        override = self.place.source.removeprefix(_OVERRIDE)
        if override != self.place.source:
            given = override.partition("=")[0]
            if f"{given}.".startswith(f"{self.key}."):  # "--set KEY=VALUE" has the key in it
                return f"{self.place}: {self.text}"
        if not self.key:
            return f"{self.place}: {self.text}"
        return f"{self.place}: {self.key}: {self.text}"


@dataclass(frozen=True)
class Node:
    """A value and the place where it is written."""

    place: Place
    folder: Path  # from which relative paths in the value start; absolute
    value: Any  # None, bool, int, float, str, list[Node] or dict[str, Node]

    def plain(self) -> Any:
        """Return the value as plain dicts, lists and scalars, without places."""
        if isinstance(self.value, dict):
            return {key: node.plain() for key, node in self.value.items()}
        if isinstance(self.value, list):
            return [node.plain() for node in self.value]
        return self.value

    def under(self, above: "Node") -> "Node":
        """Return a tree with the keys of both; of a key in both, the value of `above`."""
        if not (isinstance(self.value, dict) and isinstance(above.value, dict)):
            return above
        if DISTRIBUTIONS & {*self.value, *above.value}:
            return above  # distributions are values: their keys are not merged
        value = dict(self.value)
        for key, node in above.value.items():
            value[key] = value[key].under(node) if key in value else node
        return Node(above.place, above.folder, value)

    def locate(self, loc: Sequence[str | int]) -> tuple["Node", Loc]:
        """Return the innermost value of the tree on the path `loc`, and the path to it.

        Parts of `loc` that are not in the tree are skipped: pydantic inserts the names of variants.
        """
        node, at = self, list[str | int]()
        for part in loc:
            is_block = isinstance(node.value, dict) and part in node.value
            is_list = isinstance(node.value, list) and part in range(len(node.value))
            if is_block or is_list:
                node = node.value[part]
                at.append(part)
        return node, tuple(at)


def read_file(path: Path, faults: list[Fault], own: Path) -> Node:
    """Read a file and the files that it includes, merged into one tree.

    A key has the value of the last file that sets it: of the included files in the order of the
    list `include`, then of the file itself. A file that cannot be read counts as empty, and is a
    fault.

    Args:
        path: of the file.
        faults: errors are appended.
        own: folder of the included files that are not found from the including file's folder.
    """
    return _read(path, Place(shown(path)), "", faults, (), own)


def _read(
    path: Path,
    named_at: Place,
    key: str,
    faults: list[Fault],
    including: tuple[Path, ...],
    own: Path,
) -> Node:
    """Do the work of `read_file` for one file: the first, or one that is included.

    Args:
        path: of the file.
        named_at: place of the file's name, which is reported if the file cannot be read.
        key: key of the file's name at that place.
        faults: errors are appended.
        including: files that include this one, directly or indirectly, resolved.
        own: as `read_file` takes it.
    """
    empty = Node(Place(shown(path)), path.absolute().parent, {})
    try:
        path = path.resolve()
        if path in including:
            raise OSError(0, "it includes itself")
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as e:
        faults.append(Fault(named_at, key, f"cannot be read: {why_unread(e)}"))
        return empty
    except (ValueError, RuntimeError):  # a zero byte in its name; links in a circle
        faults.append(Fault(named_at, key, "cannot be read: not a file name"))
        return empty
    tree = _Parser(empty.place, empty.folder, faults).parse(text)
    if tree is None:
        return empty
    if tree.value is None:  # nothing but comments
        return empty
    if not isinstance(tree.value, dict):
        faults.append(
            Fault(tree.place, "", f"found {value_in_words(tree.value)}, expected a block of keys")
        )
        return empty
    below = empty
    include = tree.value.pop("include", None)
    if include is not None:
        for node in _file_names(include, faults):
            file, key = node.folder / node.value, f"include: {node.value}"
            if not file.exists() and (own / node.value).is_file():
                file = own / node.value
            below = below.under(_read(file, node.place, key, faults, (*including, path), own))
    return below.under(tree)


def parse_block(text: str, path: Path) -> dict[str, Any]:
    """Return the keys and values of a YAML text, plain; an empty text has none.

    Files in `include` are not read: it is returned like any other key.

    Args:
        text: in YAML.
        path: of the file the text is from, for the error message.

    Raises:
        ValueError: the text is not YAML, or no block of keys.
    """
    faults: list[Fault] = []
    tree = _Parser(Place(shown(path)), path.absolute().parent, faults).parse(text)
    value = {} if tree is None or tree.value is None else tree.plain()
    if faults or not isinstance(value, dict):
        raise ValueError(f"{shown(path)}: expected a block of keys")
    return value


def read_override(override: str, faults: list[Fault]) -> Node:
    """Return the tree of a `--set`, as {a: {b: 1}} of "a.b=1".

    Args:
        override: KEY=VALUE, the key dotted, the value in YAML.
        faults: errors are appended.
    """
    empty = Node(Place(f"{_OVERRIDE}{override}"), Path.cwd(), {})
    key, equals, text = override.partition("=")
    names = key.split(".")
    if not equals or not all(names):
        faults.append(Fault(empty.place, "", "expected KEY=VALUE, as in sim.pad.speed_mps=1"))
        return empty
    node = _Parser(empty.place, empty.folder, faults).parse(text, key)
    if node is None:
        return empty
    for name in reversed(names):
        node = Node(empty.place, empty.folder, {name: node})
    return node


def from_plain(value: Any, place: Place) -> Node:
    """Return a tree of plain values that are not from a YAML file, all with the same place."""
    if isinstance(value, dict):
        value = {key: from_plain(inner, place) for key, inner in value.items()}
    elif isinstance(value, list):
        value = [from_plain(inner, place) for inner in value]
    return Node(place, Path(), value)


def shown(path: Path) -> str:
    """Return a path for messages: relative to the working directory if the file is below it."""
    absolute = path.absolute()
    here = Path.cwd()
    # Not from the root folder, in which services run: their paths stay absolute.
    is_near = here.parent != here and absolute.is_relative_to(here)
    return str(absolute.relative_to(here) if is_near else path)


def _file_names(include: Node, faults: list[Fault]) -> list[Node]:
    """Return the file names of an `include`; what is no list of texts is a fault."""
    nodes: list[Node] = include.value if isinstance(include.value, list) else [include]
    wrong = [node for node in nodes if node is include or not isinstance(node.value, str)]
    for node in wrong:
        text = f"found {value_in_words(node.value)}, expected a list of file names"
        faults.append(Fault(node.place, "include", text))
    return [node for node in nodes if node not in wrong]


class _Parser:
    """Turns YAML texts into trees, and appends faults to a list."""

    def __init__(self, source: Place, folder: Path, faults: list[Fault]) -> None:
        self._source = source
        self._folder = folder
        self._faults = faults

    def parse(self, text: str, key: str = "") -> Node | None:
        """Return the tree, with a null for an empty text; None if it is not YAML.

        Args:
            text: in YAML.
            key: dotted key whose value the text is, for faults; "": the text is a whole file.
        """
        try:
            root = _composed(text)
        except yaml.YAMLError as e:
            problem = getattr(e, "problem", None) or "unprintable characters"
            self._fault(getattr(e, "problem_mark", None), key, f"not YAML: {problem}")
            return None
        except RecursionError:
            self._fault(None, key, "nested too deeply")
            return None
        if root is None:
            return Node(self._source, self._folder, None)
        return self._node(root, root.start_mark, key)

    def _node(self, node: Any, start: Any, key: str) -> Node:
        value: Any
        # All other tags are written in the text: the loader itself gives only these three.
        if node.tag.rpartition(":")[2] not in ("str", "seq", "map"):
            self._fault(start, key, f"found the tag {node.tag}, expected none")
            value = None
        elif isinstance(node, yaml.MappingNode):
            value = self._mapping(node, key)
        elif isinstance(node, yaml.SequenceNode):
            value = [self._node(v, v.start_mark, f"{key}.{i}") for i, v in enumerate(node.value)]
        else:
            value = node.value if node.style else _scalar(node.value)
        return Node(self._place(start), self._folder, value)

    def _mapping(self, node: yaml.MappingNode, key: str) -> dict[str, Node]:
        value: dict[str, Node] = {}
        for k, v in node.value:
            name = k.value if isinstance(k, yaml.ScalarNode) else "?"
            inner = f"{key}.{name}" if key else name
            if name in value:
                first = value[name].place.line
                where = f", first on line {first}" if first else ""
                self._fault(k.start_mark, inner, f"given twice{where}")
            else:
                value[name] = self._node(v, k.start_mark, inner)
        return value

    def _place(self, mark: Any) -> Place:
        is_file = not self._source.source.startswith(_OVERRIDE)
        return Place(self._source.source, mark.line + 1 if mark and is_file else 0)

    def _fault(self, mark: Any, key: str, text: str) -> None:
        self._faults.append(Fault(self._place(mark), key, text))


@functools.lru_cache(maxsize=16)
def _composed(text: str) -> Any:
    """Return the YAML nodes of a text, cached: a campaign reads the same files in every flight.

    The nodes must not be changed.
    """
    return yaml.compose(text, Loader=_Loader)


class _Loader(yaml.BaseLoader):
    """Leaves every scalar as text, and refuses aliases, by which a tree may contain itself."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(
                problem="an alias (*name); write the value out", problem_mark=mark
            )
        return super().compose_node(parent, index)


_NUMBER = re.compile(NUMBER, re.ASCII)


def _scalar(text: str) -> bool | int | float | str | None:
    """Return the value of a plain scalar by YAML 1.2.

    Unlike there, .nan and .inf stay text, as no key allows them.
    """
    if text in ("", "~", "null"):
        return None
    if text in ("true", "false"):
        return text == "true"
    if _NUMBER.fullmatch(text) and math.isfinite(float(text)):
        return int(text) if text.lstrip("+-").isdigit() else float(text)
    return text


def put(tree: dict[str, Any], path: Sequence[str], value: Any) -> None:
    """Set a value in nested mappings; missing mappings are created.

    Args:
        tree: outermost mapping.
        path: the key in each mapping, from the outermost to the innermost.
        value: to set.
    """
    for name in path[:-1]:
        tree = tree.setdefault(name, {})
    tree[path[-1]] = value
