"""Draws random values for the simulated world from distributions, as {uniform: [a, b]}.

In a YAML file or a `--set`, a distribution is written instead of a key's value. The seed of the
simulated flight decides which value is drawn. Each key has a random generator of its own, so that
adding a distribution does not change the values drawn for other keys.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any

from landerd.config.yaml_tree import DISTRIBUTIONS, Fault, Node
from landerd.section import value_in_words

SECTION = "sim"  # the only section whose values may be distributions
# `normal` draws no value farther than this from its mean, in standard deviations; so the values
# stay within bounds, and a key with bounds can be drawn from it.
TRUNCATED_AT = 3.0


@dataclass(frozen=True)
class _Kind:
    """One kind of distribution; a single argument in the file is a list of one here."""

    takes: str  # description of the arguments, for error messages
    draw: Callable[[list[Any], Random], Any]  # returns a value, given the arguments
    is_good: Callable[[list[Any]], bool]  # tells whether the arguments can be used


def _normal(values: list[Any], rng: Random) -> float:
    """Draw from a truncated normal distribution; values: mean and standard deviation."""
    mean, sigma = values
    while True:
        x = rng.gauss(0.0, 1.0)
        if abs(x) <= TRUNCATED_AT:
            return float(mean + sigma * x)


def _numbers(count: int) -> Callable[[list[Any]], bool]:
    """Return a function that tells whether the arguments are this many numbers."""

    def is_good(values: list[Any]) -> bool:
        return len(values) == count and all(
            isinstance(x, (int, float)) and not isinstance(x, bool) for x in values
        )

    return is_good


def _rising(values: list[Any]) -> bool:
    """Tell whether the arguments are a lower and an upper bound."""
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
    """Tell whether a value is a distribution: a block whose one key is the kind's name."""
    return isinstance(node.value, dict) and len(node.value) == 1 and next(iter(node.value)) in KINDS


def draw(tree: Node, seed: int, faults: list[Fault]) -> tuple[Node, dict[str, Any]]:
    """Replace every distribution in section `sim` by a value drawn from it.

    Args:
        tree: the whole configuration.
        seed: seed of the random numbers; the same seed draws the same values.
        faults: errors in distributions are appended.

    Returns:
        The tree with values instead of distributions, and the drawn values by dotted key.
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
    """Return a drawn value as a tree, with the file and line of its distribution.

    Args:
        value: the drawn value, plain.
        like: the distribution.
    """
    if isinstance(value, list):
        value = [_node(inner, like) for inner in value]
    elif isinstance(value, dict):
        value = {name: _node(inner, like) for name, inner in value.items()}
    return Node(like.place, like.folder, value)
