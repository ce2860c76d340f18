"""The keys of a model of the configuration, and in words the values that each may have."""

import difflib
import functools
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from landerd.config.yaml_tree import Loc


@functools.lru_cache(maxsize=8)
def schema_of(model: type[BaseModel]) -> "Schema":
    """Return the schema of a model; it is made once."""
    return Schema(model)


class Schema:
    """The JSON schema of a model: its keys and the values that each may have."""

    def __init__(self, model: type[BaseModel]) -> None:
        self._root = model.model_json_schema()
        self._known = list(self._keys(self._root, ""))

    def is_path(self, loc: Loc, value: str) -> bool:
        """Tell whether a key's value is the path of a file, not one of the key's words."""
        variants = self._at(loc)
        words = (word for variant in variants for word in variant.get("enum", ()))
        return value not in words and any(v.get("format") == "path" for v in variants)

    def expected(self, loc: Loc) -> str:
        """Return in words the values that a key may have."""
        return " or ".join(dict.fromkeys(self._words(variant) for variant in self._at(loc)))

    def nearest(self, key: str) -> str:
        """Return the known dotted key most like this one."""
        candidates = [known for known in self._known if not key.startswith(f"{known}.")]
        return difflib.get_close_matches(key, candidates, n=1, cutoff=0.0)[0]

    def _at(self, loc: Loc) -> list[dict[str, Any]]:
        """Return the variants that a key may have; none for an unknown key."""
        variants = [self._root]
        for part in loc:
            inner = [self._inner(variant, part) for variant in variants]
            variants = [v for schema in inner if schema for v in self._variants(schema)]
        return variants

    def _variants(self, schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Follow references and unions to plain schemas."""
        if "$ref" in schema:
            yield from self._variants(self._root["$defs"][schema["$ref"].rpartition("/")[2]])
        elif "anyOf" in schema or "oneOf" in schema:
            for variant in schema.get("anyOf") or schema["oneOf"]:
                yield from self._variants(variant)
        else:
            yield schema

    def _inner(self, schema: dict[str, Any], part: str | int) -> dict[str, Any] | None:
        if isinstance(part, str):
            inner: dict[str, Any] | None = schema.get("properties", {}).get(part)
            return inner
        items: list[dict[str, Any]] = schema.get("prefixItems", [])
        return items[part] if part < len(items) else schema.get("items")

    def _keys(self, schema: dict[str, Any], prefix: str) -> Iterator[str]:
        for variant in self._variants(schema):
            for name, inner in variant.get("properties", {}).items():
                yield prefix + name
                yield from self._keys(inner, f"{prefix}{name}.")

    def _words(self, schema: dict[str, Any]) -> str:
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


def dotted(loc: Loc) -> str:
    """Return a place in the configuration as it is written: limits.speed_mps."""
    return ".".join(str(part) for part in loc)
