"""Reads the configuration from YAML files and from `--set KEY=VALUE`.

All faults are told at once, each with the file and line its value came from. Values are never
changed to fit: text is not a number, true is not 1, and `.nan` and `.inf` are not numbers either.
"""

import functools
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, Field, ValidationError, create_model

from landerd.config.distributions import draw
from landerd.config.gimbal_reach import within_reach
from landerd.config.models import Config
from landerd.config.schema import Schema, dotted, schema_of
from landerd.config.yaml_tree import (
    Fault,
    Loc,
    Node,
    Place,
    from_plain,
    read_file,
    read_override,
    shown,
)
from landerd.ports import GimbalOptions
from landerd.section import Section, value_in_words

M = TypeVar("M", bound=BaseModel)


_NEAREST_TOLD = 20  # unknown keys whose nearest is looked for: it takes a while


class ConfigError(Exception):
    """The configuration cannot be used; `lines` has one line a fault."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = list(lines)


@dataclass(frozen=True)
class Loaded:
    """A whole configuration."""

    config: Config
    options: Mapping[str, Section]  # of drivers and simulator, by section: "camera.v4l2", "sim"
    remarks: tuple[str, ...] = ()  # what was changed to suit the gimbal, a line each
    world: Mapping[str, Any] = field(default_factory=dict)  # what the seed drew, by dotted key


def config_dir() -> Path:
    """Return the folder of the configuration that comes with landerd."""
    package = Path(__file__).parents[1]
    installed = package / "config_files"
    return installed if installed.is_dir() else package.parent / "config"


def default_config() -> Path:
    """Return the configuration that comes with landerd, which flies the simulator."""
    return config_dir() / "default.yaml"


def own_or(path: Path, name: str | Path | None = None) -> Path:
    """Return the path, or landerd's own file of a name, its own, where there is none at it."""
    own = config_dir() / (name or path)
    return own if own.is_file() and not path.exists() else path


def config_files(kind: str) -> dict[str, Path]:
    """Return the files of a folder of `config_dir()`, as "scenarios", by name."""
    return {path.stem: path for path in sorted((config_dir() / kind).glob("*.yaml"))}


def read_model(path: Path, model: type[M]) -> M:
    """Read a YAML file of its own kind.

    Raises:
        ConfigError: it cannot be read, or a key is unknown, missing, of another type or range.
    """
    faults: list[Fault] = []
    tree = read_file(path, faults, config_dir())
    # What is missing in a file that cannot be read is no fault of its own.
    read = None if faults and not tree.value else _validated(model, tree, faults)
    if read is None or faults:
        raise ConfigError([str(fault) for fault in sorted(faults)])
    return read


def load(
    path: Path,
    *,
    options_models: Mapping[str, type[Section]],
    drivers: Mapping[str, Collection[str]] | None = None,
    overlays: Sequence[Path] = (),
    overrides: Sequence[str] = (),
    seed: int = 0,
) -> Loaded:
    """Read and check a configuration file.

    Later wins, key by key: the file's includes, the file, overlays, overrides. Relative paths are
    meant from the file they are written in; in overrides, from the working directory; defaults,
    and files that are not there, from `config_dir()`. What the gimbal does not reach is cut.

    Args:
        path: the file.
        options_models: what drivers and the simulator add, by section ("camera.v4l2").
        drivers: names that the key `driver` of a section may have, by section.
        overlays: files laid over the first, as scenarios are.
        overrides: KEY=VALUE, the key dotted, the value in YAML.
        seed: of the values that are distributions (landerd.config.distributions).

    Raises:
        ConfigError: a file cannot be read, or a key is unknown, given twice, missing, of another
            type or out of range; or a range of angles is wanted that the gimbal does not reach.
    """
    faults: list[Fault] = []
    tree = read_file(path, faults, config_dir())
    for overlay in overlays:
        tree = tree.under(read_file(overlay, faults, config_dir()))
    for override in overrides:
        tree = tree.under(read_override(override, faults))
    tree, world = draw(tree, seed, faults)

    model = _extended(tuple(options_models.items()))
    config = _validated(model, tree, faults)
    faults += _unknown_drivers(tree, drivers or {})
    if config is None or faults:
        raise ConfigError([str(fault) for fault in sorted(faults)])

    config = _anchored(config)
    options = _options(config, options_models, path)
    gimbal = options.get(f"gimbal.{config.gimbal.driver}")
    if not isinstance(gimbal, GimbalOptions):  # the simulator's reaches all that may be asked of it
        return Loaded(config, options, world=world)
    try:
        config, remarks = within_reach(config, gimbal.traits)
    except ValueError as e:
        raise ConfigError([f"{shown(path)}: {e}"]) from None
    return Loaded(config, options, tuple(remarks), world)


def _options(
    config: Config, options_models: Mapping[str, type[Section]], path: Path
) -> dict[str, Section]:
    """Return the blocks of drivers and simulator that are there, by section. Raises ConfigError."""
    options: dict[str, Section] = {}
    for section in options_models:
        parent, _, driver = section.rpartition(".")
        block = _at(config, section)
        if block is not None:
            options[section] = block
        elif _at(config, parent).driver == driver:
            raise ConfigError([f"{shown(path)}: {section}: missing, driver {driver} needs it"])
    return options


def from_record(
    data: Any, source: str, *, others: Collection[str] = (), overrides: Sequence[str] = ()
) -> tuple[Config, list[str]]:
    """Return the configuration that a flight log has, and the keys that are no longer known.

    Args:
        data: of the log, plain values.
        source: the log's name, for what is said about it.
        others: blocks of drivers and simulator ("camera.v4l2"), which decide nothing here.
        overrides: KEY=VALUE, as `load` takes them.

    Raises:
        ConfigError: a value cannot be used.
    """
    unknown: list[str] = []
    faults: list[Fault] = []
    tree = from_plain(_known(Config, data, "", set(others), unknown), Place(source))
    for override in overrides:
        tree = tree.under(read_override(override, faults))
    config = _validated(Config, tree, faults)
    if config is None or faults:
        raise ConfigError([str(fault) for fault in sorted(faults)])
    return config, unknown


def _known(
    model: type[BaseModel], data: Any, at: str, others: Collection[str], unknown: list[str]
) -> Any:
    """Return the part of plain data that the model has keys for; the others' names are added."""
    if not isinstance(data, dict):
        return data
    kept = {}
    for key, value in data.items():
        field, dotted = model.model_fields.get(key), f"{at}{key}"
        if field is None:
            if dotted not in others:
                unknown.append(dotted)
            continue
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            kept[key] = _known(inner, value, f"{dotted}.", others, unknown)
        else:
            kept[key] = value
    return kept


@functools.lru_cache(maxsize=4)
def _extended(options_models: tuple[tuple[str, type[Section]], ...]) -> type[Config]:
    """Return the whole configuration's model; a campaign asks for the same one in every flight."""
    return _with_options(Config, dict(options_models))


def _with_options(
    model: type[M], options_models: Mapping[str, type[Section]], at: str = ""
) -> type[M]:
    """Return the model with options added to its sections; None where they need arguments."""
    fields: dict[str, Any] = {}
    for section, options in options_models.items():
        parent, _, name = section.rpartition(".")
        if parent == at:
            needed = any(field.is_required() for field in options.model_fields.values())
            fields[name] = (options | None, None) if needed else (options, options())
    for name in {section.partition(".")[0] for section in options_models if "." in section}:
        if not at:
            base = model.model_fields[name].annotation
            assert isinstance(base, type)
            extended = _with_options(base, options_models, name)
            fields[name] = (extended, Field(default=extended()))
    return create_model(model.__name__, __base__=model, **fields)


def _validated(model: type[M], tree: Node, faults: list[Fault]) -> M | None:
    """Return the tree as a model; None if it is not one, and the faults added."""
    schema = schema_of(model)
    plain = json.dumps(_with_paths(tree, schema, (), faults).plain())
    try:
        # Strict JSON: a list may be a tuple and text a path, but nothing else is converted.
        return model.model_validate_json(plain, strict=True)
    except ValidationError as e:
        errors = e.errors(include_url=False)
    found: dict[Fault, None] = {}  # each variant of a union has its own error: the same fault
    for error in errors:
        node, loc = tree.locate(error["loc"])
        if error["type"] == "missing":
            loc = (*loc, error["loc"][-1])
            text = f"missing, expected {schema.expected(loc)}"
        elif error["type"] == "extra_forbidden":
            text = "unknown key"
            if len(found) < _NEAREST_TOLD:
                text += f"; nearest known key: {schema.nearest(dotted(loc))}"
        elif error["type"] == "value_error":
            text = str(error["ctx"]["error"])
        else:
            text = f"found {value_in_words(node.value)}, expected {schema.expected(loc)}"
        found[Fault(node.place, dotted(loc), text)] = None
    faults += found
    return None


def _with_paths(node: Node, schema: Schema, loc: Loc, faults: list[Fault]) -> Node:
    """Return the tree with relative paths made absolute; text that is no UTF-8 is a fault."""
    value = node.value
    if isinstance(value, dict):
        value = {key: _with_paths(v, schema, (*loc, key), faults) for key, v in value.items()}
    elif isinstance(value, list):
        value = [_with_paths(v, schema, (*loc, i), faults) for i, v in enumerate(value)]
    elif isinstance(value, str):
        if schema.is_path(loc, value):
            value = str(own_or(node.folder / value, value))
        if any("\ud800" <= letter <= "\udfff" for letter in value):  # of the name of a file
            text = f"found {value_in_words(value)}, expected a name in UTF-8"
            faults.append(Fault(node.place, dotted(loc), text))
            value = ""
    return Node(node.place, node.folder, value)


def _anchored(model: M) -> M:
    """Return the model with the paths that are still relative, defaults, made absolute."""
    changes: dict[str, Any] = {}
    for name, value in model:
        if isinstance(value, Path) and not value.is_absolute():
            changes[name] = config_dir() / value
        elif isinstance(value, BaseModel):
            changes[name] = _anchored(value)
    return model.model_copy(update=changes)


def _unknown_drivers(tree: Node, drivers: Mapping[str, Collection[str]]) -> Iterator[Fault]:
    for section, known in drivers.items():
        node, loc = tree.locate((section, "driver"))
        if loc == (section, "driver") and isinstance(node.value, str) and node.value not in known:
            expected = "one of " + ", ".join(sorted(known))
            yield Fault(
                node.place, dotted(loc), f"found {value_in_words(node.value)}, expected {expected}"
            )


def _at(model: Any, section: str) -> Any:
    for name in section.split("."):
        model = getattr(model, name)
    return model
