"""Values of the simulated world that every seed draws anew: {uniform: [a, b]} and the like.

A distribution stands in a YAML file or a `--set` where its value would stand. Each key has random
numbers of its own, so that one more distribution leaves all others as they were.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any

from landerd.config.yaml_tree import DISTRIBUTIONS, Fault, Node
from landerd.section import value_in_words

SECTION = "sim"  # only the simulated world may be drawn
TRUNCATED_AT = 3.0  # sigma, of `normal`: a bound of the key can then be kept


@dataclass(frozen=True)
class _Kind:
    takes: str  # what it takes, in words
    draw: Callable[[list[Any], Random], Any]
    is_good: Callable[[list[Any]], bool]


def _normal(values: list[Any], rng: Random) -> float:
    mean, sigma = values
    while True:
        x = rng.gauss(0.0, 1.0)
        if abs(x) <= TRUNCATED_AT:
            return float(mean + sigma * x)


def _numbers(count: int) -> Callable[[list[Any]], bool]:
    def is_good(values: list[Any]) -> bool:
        return len(values) == count and all(
            isinstance(x, (int, float)) and not isinstance(x, bool) for x in values
        )

    return is_good


def _rising(values: list[Any]) -> bool:
    return _numbers(2)(values) and values[0] <= values[1]


KINDS: Mapping[str, _Kind] = {
    "uniform": _Kind("[least, most]", lambda v, rng: rng.uniform(v[0], v[1]), _rising),
    "log_uniform": _Kind(
        "[least, most], above 0",
        lambda v, rng: math.exp(rng.uniform(math.log(v[0]), math.log(v[1]))),
        lambda v: _rising(v) and v[0] > 0,
    ),
    "normal": _Kind(
        f"[mean, sigma], cut off at {TRUNCATED_AT:g} sigma",
        _normal,
        lambda v: _numbers(2)(v) and v[1] >= 0,
    ),
    "choice": _Kind("a list of values", lambda v, rng: rng.choice(v), bool),
    "sign": _Kind("a number", lambda v, rng: rng.choice((-1, 1)) * v[0], _numbers(1)),
}
assert KINDS.keys() == DISTRIBUTIONS


def is_distribution(node: Node) -> bool:
    """Tell whether a value is to be drawn."""
    return isinstance(node.value, dict) and len(node.value) == 1 and next(iter(node.value)) in KINDS


def draw(tree: Node, seed: int, faults: list[Fault]) -> tuple[Node, dict[str, Any]]:
    """Return the tree with every distribution of `sim` drawn, and what was drawn by dotted key.

    Args:
        tree: the whole configuration.
        seed: the same seed draws the same values.
        faults: gets those of distributions that cannot be drawn from.
    """
    world: dict[str, Any] = {}

    def drawn(node: Node, key: str) -> Node:
        if isinstance(node.value, list):
            value: Any = [drawn(inner, f"{key}.{i}") for i, inner in enumerate(node.value)]
            return Node(node.place, node.folder, value)
        if not isinstance(node.value, dict):
            return node
        if not is_distribution(node):
            value = {name: drawn(inner, f"{key}.{name}") for name, inner in node.value.items()}
            return Node(node.place, node.folder, value)
        [(name, given)] = node.value.items()
        kind, plain = KINDS[name], given.plain()
        values = plain if isinstance(plain, list) else [plain]
        if not kind.is_good(values):
            text = f"found {value_in_words(given.value)}, expected {kind.takes}"
            faults.append(Fault(given.place, f"{key}.{name}", text))
            return Node(node.place, node.folder, None)
        value = kind.draw(values, Random(f"{seed}:{key}"))
        world[key] = value
        return _node(value, node)

    if not isinstance(tree.value, dict) or SECTION not in tree.value:
        return tree, world
    sections = dict(tree.value)
    sections[SECTION] = drawn(sections[SECTION], SECTION)
    return Node(tree.place, tree.folder, sections), world


def _node(value: Any, like: Node) -> Node:
    """Return a drawn value as a tree in the place of its distribution."""
    if isinstance(value, list):
        value = [_node(inner, like) for inner in value]
    elif isinstance(value, dict):
        value = {name: _node(inner, like) for name, inner in value.items()}
    return Node(like.place, like.folder, value)
