"""Messages as JSON and back, exact to the bit, from nothing but their dataclasses.

Python writes the shortest decimals that read back as the same float, so JSON keeps every bit.
Numbers that JSON has no word for go as the texts "nan", "inf" and "-inf".
"""

import dataclasses
import functools
import json
import math
import types
import typing
from collections.abc import Callable
from enum import Enum
from typing import Any

_NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
_JSON_TYPES = {float: "number", int: "integer", bool: "boolean", str: "string"}


class CodecError(ValueError):
    """The JSON is not what the dataclass says; the text names the field."""


def encode(message: Any) -> bytes:
    """Return a message as JSON; the same message gives the same bytes on every machine."""
    try:
        text = json.dumps(message, default=_plain, allow_nan=False, separators=(",", ":"))
    except ValueError:
        text = json.dumps(_spelled(message), separators=(",", ":"))
    return text.encode()


def decode(kind: type, data: bytes) -> Any:
    """Return the message of this dataclass.

    Raises:
        CodecError: not JSON, or a field is missing, unknown or of another type.
    """
    try:
        value = json.loads(data)
    except ValueError:
        raise CodecError(f"{kind.__name__}: not JSON") from None
    return _reader(kind)(value, kind.__name__)


def schema(kind: type) -> dict[str, Any]:
    """Return the JSON schema of a dataclass, for the tools that plot logs."""
    return {"title": f"landerd.{kind.__name__}", **_schema(kind)}


def _plain(value: Any) -> Any:
    """Return a value that json cannot write in a form that it can."""
    if isinstance(value, Enum):
        return value.value
    if dataclasses.is_dataclass(value):
        return {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    raise TypeError(f"{type(value).__name__} cannot be logged")


def _spelled(value: Any) -> Any:
    """Return a message as plain lists and dicts, with NaN and infinities as text."""
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    if isinstance(value, (list, tuple)):
        return [_spelled(v) for v in value]
    if isinstance(value, dict):
        return {k: _spelled(v) for k, v in value.items()}
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return _spelled(_plain(value))


# ---- back --------------------------------------------------------------------------------------

_Reader = Callable[[Any, str], Any]


@functools.cache
def _reader(kind: Any) -> _Reader:
    """Return the function that turns JSON values into this type."""
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return _union(kind)
    if typing.get_origin(kind) is tuple:
        return _tuple(typing.get_args(kind))
    if dataclasses.is_dataclass(kind):
        return _dataclass(typing.cast(type, kind))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return _enum(kind)
    return _scalar(kind)


def _scalar(kind: Any) -> _Reader:
    def read(value: Any, where: str) -> Any:
        if kind is float and isinstance(value, str) and value in _NOT_FINITE:
            return _NOT_FINITE[value]
        # A whole number in a field of floats stays one: the core calculated with it.
        fits = (int, float) if kind is float else kind
        if not isinstance(value, fits) or (isinstance(value, bool) and kind is not bool):
            raise CodecError(f"{where}: found {value!r}, expected {kind.__name__}")
        return value

    return read


def _enum(kind: type[Enum]) -> _Reader:
    def read(value: Any, where: str) -> Any:
        try:
            return kind(value)
        except ValueError:
            raise CodecError(f"{where}: {value!r} is not a {kind.__name__}") from None

    return read


def _union(kind: Any) -> _Reader:
    options = [a for a in typing.get_args(kind) if a is not types.NoneType]
    has_none = len(options) < len(typing.get_args(kind))

    def read(value: Any, where: str) -> Any:
        if value is None and has_none:
            return None
        for option in options[:-1]:
            try:
                return _reader(option)(value, where)
            except CodecError:
                continue
        return _reader(options[-1])(value, where)

    return read


def _tuple(items: tuple[Any, ...]) -> _Reader:
    if len(items) == 2 and items[1] is Ellipsis:
        each = _reader(items[0])

        def read_any(value: Any, where: str) -> Any:
            if not isinstance(value, list):
                raise CodecError(f"{where}: expected a list")
            return tuple(each(v, where) for v in value)

        return read_any
    readers = [_reader(item) for item in items]

    def read(value: Any, where: str) -> Any:
        if not isinstance(value, list) or len(value) != len(readers):
            raise CodecError(f"{where}: expected a list of {len(readers)}")
        return tuple(r(v, where) for r, v in zip(readers, value, strict=True))

    return read


def _dataclass(kind: type) -> _Reader:
    hints = typing.get_type_hints(kind)
    fields = dataclasses.fields(kind)
    readers = {f.name: _reader(hints[f.name]) for f in fields}
    optional = {
        f.name
        for f in fields
        if f.default is not dataclasses.MISSING or f.default_factory is not dataclasses.MISSING
    }

    def read(value: Any, where: str) -> Any:
        if not isinstance(value, dict):
            raise CodecError(f"{where}: expected an object")
        unknown = [name for name in value if name not in readers]
        missing = [name for name in readers if name not in value and name not in optional]
        if unknown or missing:
            what = f"{unknown[0]} is not known" if unknown else f"{missing[0]} is missing"
            raise CodecError(f"{where}: {what}")
        return kind(**{k: readers[k](v, f"{where}.{k}") for k, v in value.items()})

    return read


def _schema(kind: Any) -> dict[str, Any]:
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        options = [_schema(a) for a in args if a is not types.NoneType]
        return options[0] if len(options) == 1 else {"oneOf": options}
    if origin is tuple:
        return {"type": "array", "items": _schema(args[0])}
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return {"type": "object", "properties": {n: _schema(h) for n, h in hints.items()}}
    if isinstance(kind, type) and issubclass(kind, Enum):
        return {"enum": [member.value for member in kind]}
    return {"type": _JSON_TYPES[kind]}
