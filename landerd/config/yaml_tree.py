"""YAML files as trees in which every value knows the file and line it came from.

YAML 1.2's plain scalars, without the surprises of 1.1 (yes, 010, 1:30); no tags, no aliases, no
key twice. Faults are collected, not raised, so that all of them can be told at once.
"""

import functools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from landerd.files import read_text
from landerd.section import NUMBER, value_in_words

Loc = tuple[str | int, ...]

# The one key of a value that each seed of the simulator draws: landerd.config.distributions.
DISTRIBUTIONS = frozenset({"uniform", "log_uniform", "normal", "choice", "sign"})

_OVERRIDE = "--set "  # begins the source of a value from the command line


@dataclass(frozen=True, order=True)
class Place:
    """Where a value is written."""

    source: str  # a file's path, or "--set KEY=VALUE"
    line: int = 0  # 0: the source as a whole

    def __str__(self) -> str:
        return f"{self.source}:{self.line}" if self.line else self.source


@dataclass(frozen=True, order=True)
class Fault:
    """An error in the value of a key."""

    place: Place
    key: str  # dotted; "": the whole source
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
    """A value and where it is written."""

    place: Place
    folder: Path  # absolute; relative paths in the value start from here
    value: Any  # None, bool, int, float, str, list[Node] or dict[str, Node]

    def plain(self) -> Any:
        """Return the value without places."""
        if isinstance(self.value, dict):
            return {key: node.plain() for key, node in self.value.items()}
        if isinstance(self.value, list):
            return [node.plain() for node in self.value]
        return self.value

    def under(self, above: "Node") -> "Node":
        """Return this tree with the other one laid over it, key by key."""
        if not (isinstance(self.value, dict) and isinstance(above.value, dict)):
            return above
        if DISTRIBUTIONS & {*self.value, *above.value}:
            return above  # they are values, not blocks that could be merged
        value = dict(self.value)
        for key, node in above.value.items():
            value[key] = value[key].under(node) if key in value else node
        return Node(above.place, above.folder, value)

    def locate(self, loc: Sequence[str | int]) -> tuple["Node", Loc]:
        """Return the innermost value on the way to loc, and its own place in the tree.

        Parts that are not in the tree are passed over: pydantic names variants in between.
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
    """Read a file laid over the files of its `include` list; later ones win.

    Files that cannot be read count as empty and are faults.

    Args:
        path: of the file.
        faults: errors are added to it.
        own: folder in which includes are looked for that are not beside the file.
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
    empty = Node(Place(shown(path)), path.absolute().parent, {})
    try:
        path = path.resolve()
        if path in including:
            raise OSError(0, "it includes itself")
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as e:
        reason = e.strerror if isinstance(e, OSError) else "not text"
        faults.append(Fault(named_at, key, f"cannot be read: {reason}"))
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
    """Return the plain values of a file's text, `include` as it stands; an empty text has none.

    Raises:
        ValueError: it is no block of keys.
    """
    faults: list[Fault] = []
    tree = _Parser(Place(shown(path)), path.absolute().parent, faults).parse(text)
    value = {} if tree is None or tree.value is None else tree.plain()
    if faults or not isinstance(value, dict):
        raise ValueError(f"{shown(path)}: expected a block of keys")
    return value


def read_override(override: str, faults: list[Fault]) -> Node:
    """Turn "a.b=1" into the tree {a: {b: 1}}; the value is YAML."""
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
    """Return a tree of values that come from no YAML file."""
    if isinstance(value, dict):
        value = {key: from_plain(inner, place) for key, inner in value.items()}
    elif isinstance(value, list):
        value = [from_plain(inner, place) for inner in value]
    return Node(place, Path(), value)


def shown(path: Path) -> str:
    """Return the path as it is shortest to read from the working directory."""
    absolute = path.absolute()
    here = Path.cwd()
    # A service runs in the root folder: its paths stay whole.
    is_near = here.parent != here and absolute.is_relative_to(here)
    return str(absolute.relative_to(here) if is_near else path)


def _file_names(include: Node, faults: list[Fault]) -> list[Node]:
    nodes: list[Node] = include.value if isinstance(include.value, list) else [include]
    wrong = [node for node in nodes if node is include or not isinstance(node.value, str)]
    for node in wrong:
        text = f"found {value_in_words(node.value)}, expected a list of file names"
        faults.append(Fault(node.place, "include", text))
    return [node for node in nodes if node not in wrong]


class _Parser:
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
        if node.tag.rpartition(":")[2] not in ("str", "seq", "map"):  # what the loader gives
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
    """Return the nodes of a text, which nobody changes; a campaign reads each file often."""
    return yaml.compose(text, Loader=_Loader)


class _Loader(yaml.BaseLoader):
    """Leaves every scalar text, and refuses aliases: a tree of them may be endless."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(
                problem="an alias (*name); write the value out", problem_mark=mark
            )
        return super().compose_node(parent, index)


_NUMBER = re.compile(NUMBER, re.ASCII)


def _scalar(text: str) -> bool | int | float | str | None:
    """Return the value of a plain scalar; .nan and .inf stay text, as no key allows them."""
    if text in ("", "~", "null"):
        return None
    if text in ("true", "false"):
        return text == "true"
    if _NUMBER.fullmatch(text) and math.isfinite(float(text)):
        return int(text) if text.lstrip("+-").isdigit() else float(text)
    return text


def put(tree: dict[str, Any], path: Sequence[str], value: Any) -> None:
    """Set a value in nested mappings, which are made where they are missing."""
    for name in path[:-1]:
        tree = tree.setdefault(name, {})
    tree[path[-1]] = value
