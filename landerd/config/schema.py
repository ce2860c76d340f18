"""Describes a model's keys for error messages: the allowed values in words, the nearest key."""

import difflib
import functools
from collections.abc import Iterable, Iterator
from typing import Any

from pydantic import BaseModel

from landerd.config.yaml_tree import Loc


@functools.lru_cache(maxsize=8)
def schema_of(model: type[BaseModel]) -> "Schema":
    """Return the schema of a model, cached."""
    return Schema(model)


class Schema:
    """The JSON schema of a model: its keys, and the values allowed for each.

    A key may have several variants, as its type may be a union; each variant has a schema.
    """

    def __init__(self, model: type[BaseModel]) -> None:
        self._root = model.model_json_schema()
        self._known = list(self._keys(self._root, ""))

    def is_path(self, loc: Loc, value: str) -> bool:
        """Tell whether the value of a key is the path of a file, and none of the allowed words."""
        variants = self._at(loc)
        words = (word for variant in variants for word in variant.get("enum", ()))
        return value not in words and any(v.get("format") == "path" for v in variants)

    def expected(self, loc: Loc) -> str:
        """Return the values allowed for a key, in words."""
        return " or ".join(dict.fromkeys(self._words(variant) for variant in self._at(loc)))

    def nearest(self, loc: Loc) -> str:
        """Return the known dotted key that is most similar to an unknown one.

        Within an item of a list only that item's keys are candidates. Keys of the blocks that
        contain the unknown key are none.
        """
        key, all_known = dotted(loc), self._known
        item = max((n for n, part in enumerate(loc, start=1) if isinstance(part, int)), default=0)
        if item:
            prefix = f"{dotted(loc[:item])}."
            all_known = [k for block in self._at(loc[:item]) for k in self._keys(block, prefix)]
        candidates = [known for known in all_known if not key.startswith(f"{known}.")]
        return nearest(key, candidates)

    def _at(self, loc: Loc) -> list[dict[str, Any]]:
        """Return the schemas of a key's variants; none for an unknown key."""
        variants = [self._root]
        for part in loc:
            inner = [self._inner(variant, part) for variant in variants]
            variants = [v for schema in inner if schema for v in self._variants(schema)]
        return variants

    def _variants(self, schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Yield the schemas of all variants, with references and unions resolved."""
        if "$ref" in schema:
            yield from self._variants(self._root["$defs"][schema["$ref"].rpartition("/")[2]])
        elif "anyOf" in schema or "oneOf" in schema:
            for variant in schema.get("anyOf") or schema["oneOf"]:
                yield from self._variants(variant)
        else:
            yield schema

    def _inner(self, schema: dict[str, Any], part: str | int) -> dict[str, Any] | None:
        """Return the schema of a key of a block or of an item of a list; None: there is none."""
        if isinstance(part, str):
            inner: dict[str, Any] | None = schema.get("properties", {}).get(part)
            return inner
        items: list[dict[str, Any]] = schema.get("prefixItems", [])
        return items[part] if part < len(items) else schema.get("items")

    def _keys(self, schema: dict[str, Any], prefix: str) -> Iterator[str]:
        """Yield all keys of a schema and of the blocks in it, dotted, after a prefix."""
        for variant in self._variants(schema):
            for name, inner in variant.get("properties", {}).items():
                yield prefix + name
                yield from self._keys(inner, f"{prefix}{name}.")

    def _words(self, schema: dict[str, Any]) -> str:
        """Return the values that one variant allows, in words."""
        kind = schema.get("type")
        if "const" in schema:
            return str(schema["const"])
        if "enum" in schema:
            return "one of " + ", ".join(str(value) for value in schema["enum"])
        if kind == "array":
            items = schema.get("prefixItems")
            return f"a list of {len(items)} values" if items else "a list"
        if schema.get("format") == "path":
            return "a file name"
        bounds = [f"{text} {schema[bound]:g}" for bound, text in _BOUNDS.items() if bound in schema]
        return f"{_KINDS.get(str(kind), 'another value')} {' and '.join(bounds)}".rstrip()


_KINDS = {
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "string": "text",
    "object": "a block of keys",
    "null": "nothing",
}
_BOUNDS = {
    "exclusiveMinimum": "above",
    "minimum": "at least",
    "exclusiveMaximum": "below",
    "maximum": "at most",
}


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the most similar one of the known names, of which there is at least one."""
    return difflib.get_close_matches(name, list(known), n=1, cutoff=0.0)[0]


def dotted(loc: Loc) -> str:
    """Return a key as it is written in overrides and messages, as limits.speed_mps."""
    return ".".join(str(part) for part in loc)
