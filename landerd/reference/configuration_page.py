"""docs/configuration-keys.md: every key, from the models that read the configuration.

What a key means stands in the models as the comment on its line or on those above it.
"""

import inspect
import json
import re
import textwrap
from collections.abc import Iterator
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from landerd.config.models import Config
from landerd.config.schema import dotted, schema_of
from landerd.drivers import names, options_models

_HEAD = """# All keys of the configuration

How a configuration is written, and which file wins: [configuration](configuration.md). SI units;
names that end in `_deg` are degrees. A key without a default must be given when its block is used.

This page is made from the code: `make reference`.
"""
_FIELD = re.compile(r"    (\w+): ")
_TABLE = "| key | expected | default | |\n|---|---|---|---|"


def markdown() -> str:
    """Return docs/configuration-keys.md."""
    drivers = options_models()
    parts = [_HEAD]
    for name, field in Config.model_fields.items():
        model = field.annotation
        assert isinstance(model, type)
        assert issubclass(model, BaseModel)
        parts.append(_block("##", name, model))
        for section, options in drivers.items():
            if section.startswith(f"{name}."):
                parts.append(_block("###", section, options))
    parts.append(_block("##", "sim", drivers["sim"]))
    return "\n".join(parts)


def _block(level: str, section: str, model: type[BaseModel]) -> str:
    about = inspect.cleandoc(model.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
    rows = []
    for loc, default, comment in _leaves(model, ()):
        expected = schema_of(model).expected(loc)
        if loc == ("driver",):
            expected = "one of " + ", ".join(sorted(names()[section]))
        rows.append(f"| `{dotted(loc)}` | {expected} | {default} | {comment} |")
    if not rows:
        return ""
    return "\n".join([f"{level} {section}", "", about, "", _TABLE, *rows, ""])


def _leaves(
    model: type[BaseModel], at: tuple[str, ...], given: BaseModel | None = None
) -> Iterator[tuple[tuple[str, ...], str, str]]:
    """Yield place, default and meaning of each key that has no block below it.

    Args:
        model: of the block.
        at: where the block is.
        given: the block where nothing is said of it; None: its keys' own defaults.
    """
    comments = field_comments(model)
    for name, field in model.model_fields.items():
        default = getattr(given, name) if given is not None else field.get_default()
        block = _block_model(field.annotation)
        if block is not None:
            yield from _leaves(
                block, (*at, name), default if isinstance(default, BaseModel) else None
            )
        else:
            yield (*at, name), _in_words(default), comments.get(name, "")


def _block_model(annotation: Any) -> type[BaseModel] | None:
    """Return the model of a block of keys; None: the key has a value of its own."""
    choices = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else [annotation]
    for choice in choices:
        if isinstance(choice, type) and issubclass(choice, BaseModel):
            return choice
    return None


def _in_words(default: object) -> str:
    if default is PydanticUndefined:
        return "to be given"
    return "nothing" if default is None else f"`{json.dumps(default, default=_plain)}`"


def _plain(value: object) -> object:
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else str(value)


def field_comments(model: type[BaseModel]) -> dict[str, str]:
    """Return what the source says of each field of a model, also of those that it inherits."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if issubclass(base, BaseModel) and base.__module__.partition(".")[0] in ("landerd", "hw"):
            found |= _comments(textwrap.dedent(inspect.getsource(base)))
    return found


def _comments(source: str) -> dict[str, str]:
    """Return the comment on each field's line, or else those above it."""
    found: dict[str, str] = {}
    above: list[str] = []
    for line in source.splitlines():
        field = _FIELD.match(line)
        comment = line.partition("  # ")[2]
        if line.startswith("    # "):
            above.append(line.removeprefix("    # "))
        elif field is not None:
            found[field[1]] = comment or " ".join(above)
            above = []
        else:
            above = []
    return found
