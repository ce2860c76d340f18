"""Reads the configuration from YAML files and from `--set KEY=VALUE`.

All faults are reported together, each with the file and line of its value. Values are never
converted to another type: text is not a number, true is not 1, and `.nan` and `.inf` are not
numbers either.
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


# Unknown keys among this many first faults are reported with the nearest known key, which is slow
# to find.
_NEAREST_TOLD = 20


class ConfigError(Exception):
    """The configuration cannot be used; `lines` has one line for each fault."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = list(lines)


@dataclass(frozen=True)
class Loaded:
    """A whole configuration, read and checked."""

    config: Config
    # blocks of keys of the drivers and of the simulator, by section: "camera.v4l2", "sim"
    options: Mapping[str, Section]
    remarks: tuple[str, ...] = ()  # a line for each range reduced to the gimbal's reach
    # values drawn from distributions, by dotted key
    world: Mapping[str, Any] = field(default_factory=dict)


def config_dir() -> Path:
    """Return the folder of the configuration files that come with landerd."""
    package = Path(__file__).parents[1]
    installed = package / "config_files"
    return installed if installed.is_dir() else package.parent / "config"


def default_config() -> Path:
    """Return the path of landerd's default configuration, which flies the simulator."""
    return config_dir() / "default.yaml"


def own_or(path: Path, name: str | Path | None = None) -> Path:
    """Return the path if something exists there, or else landerd's own file of that name.

    Args:
        path: of the file; returned, too, if landerd has no such file.
        name: path of landerd's file from `config_dir()`; None: the same as `path`.
    """
    own = config_dir() / (name or path)
    return own if own.is_file() and not path.exists() else path


def config_files(kind: str) -> dict[str, Path]:
    """Return the YAML files of a folder in `config_dir()`, by name without suffix.

    Args:
        kind: name of the folder, as "scenarios".
    """
    return {path.stem: path for path in sorted((config_dir() / kind).glob("*.yaml"))}


def read_model(path: Path, model: type[M]) -> M:
    """Read and check a YAML file that is no part of the configuration, as a campaign.

    Args:
        path: of the file.
        model: its keys.

    Raises:
        ConfigError: the file cannot be read, or a key is unknown, given twice, missing, of another
            type or out of range.
    """
    faults: list[Fault] = []
    tree = read_file(path, faults, config_dir())
    # If the file cannot be read, its keys are not reported as missing, too.
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

    Each key has the value of the last source that sets it, in this order: the includes of the
    file, the file, overlays, overrides.

    A relative path in a file starts from the folder of that file, in an override from the working
    directory. If nothing exists there, and in defaults, it starts from `config_dir()`.

    Limits of the gimbal's angles are reduced to what the gimbal reaches.

    Args:
        path: the file.
        options_models: models of the keys that drivers and the simulator add, by section
            ("camera.v4l2").
        drivers: names allowed for the key `driver`, by section; a section not listed allows all.
        overlays: files whose keys replace those of the first, as scenarios do.
        overrides: KEY=VALUE, the key dotted, the value in YAML.
        seed: of the values drawn from distributions (landerd.config.distributions).

    Raises:
        ConfigError: a file cannot be read, or a key is unknown, given twice, missing, of another
            type or out of range; or the gimbal does not reach any angle of a range.
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
    faults += _missing_files(tree)
    if config is None or faults:
        raise ConfigError([str(fault) for fault in sorted(faults)])

    config = _anchored(config)
    options = _options(config, options_models, path)
    gimbal = options.get(f"gimbal.{config.gimbal.driver}")
    if not isinstance(gimbal, GimbalOptions):  # the simulated gimbal reaches all angles
        return Loaded(config, options, world=world)
    try:
        config, remarks = within_reach(config, gimbal.traits)
    except ValueError as e:
        raise ConfigError([f"{shown(path)}: {e}"]) from None
    return Loaded(config, options, tuple(remarks), world)


def _options(
    config: Config, options_models: Mapping[str, type[Section]], path: Path
) -> dict[str, Section]:
    """Return the blocks of drivers and of the simulator that the configuration has, by section.

    Args:
        config: with these blocks as further fields of its sections.
        options_models: the models of all such blocks, by section ("camera.v4l2").
        path: of the configuration, for the error message.

    Raises:
        ConfigError: the block of a chosen driver is missing.
    """
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
    """Return the configuration recorded in a flight log, and its keys that are unknown today.

    Args:
        data: the recorded configuration, plain values.
        source: the log's name, for error messages.
        others: blocks of drivers and of the simulator ("camera.v4l2"); they are ignored.
        overrides: KEY=VALUE, as `load` takes them.

    Returns:
        The configuration without the unknown keys, and these keys, dotted.

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
    """Return plain data without the keys that the model does not have.

    Args:
        model: of the data.
        data: a mapping; anything else is returned as it is.
        at: dotted key of the data with a dot at its end; "": the whole configuration.
        others: dotted keys that are left out without being reported.
        unknown: the other keys that are left out are appended, dotted.
    """
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
    """Return the model of the whole configuration, cached: a campaign needs it in every flight."""
    return _with_options(Config, dict(options_models))


def _with_options(
    model: type[M], options_models: Mapping[str, type[Section]], at: str = ""
) -> type[M]:
    """Return a model with the blocks of drivers and of the simulator added as fields.

    A block without required keys defaults to its defaults, any other block to None.

    Args:
        model: of the configuration, or of one section.
        options_models: the models of the blocks, by section ("camera.v4l2", "sim").
        at: name of the section that the model is of; "": the configuration.
    """
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
    """Return the tree as an instance of the model; None if it does not fit.

    Args:
        model: to validate against.
        tree: the values, with places.
        faults: the reasons why it does not fit are appended.
    """
    schema = schema_of(model)
    plain = json.dumps(_with_paths(tree, schema, (), faults).plain())
    try:
        # Strict JSON converts lists to tuples and text to paths, and nothing else.
        return model.model_validate_json(plain, strict=True)
    except ValidationError as e:
        errors = e.errors(include_url=False)
    # As keys, without duplicates: pydantic reports an error for each variant of a union.
    found: dict[Fault, None] = {}
    for error in errors:
        node, loc = tree.locate(error["loc"])
        if node.value is None and _is_reported(node.place, dotted(loc), faults):
            continue
        if error["type"] == "missing":
            loc = (*loc, error["loc"][-1])
            text = f"missing, expected {schema.expected(loc)}"
        elif error["type"] == "extra_forbidden":
            text = "unknown key"
            if len(found) < _NEAREST_TOLD:
                text += f"; nearest known key: {schema.nearest(loc)}"
        elif error["type"] == "value_error":
            text = str(error["ctx"]["error"])
        else:
            text = f"found {value_in_words(node.value)}, expected {schema.expected(loc)}"
        found[Fault(node.place, dotted(loc), text)] = None
    faults += found
    return None


def _is_reported(place: Place, key: str, faults: Sequence[Fault]) -> bool:
    """Tell whether a value is nothing because of a fault that is known already."""
    return any(f.place == place and f"{f.key}.".startswith(f"{key}.") for f in faults)


def _with_paths(node: Node, schema: Schema, loc: Loc, faults: list[Fault]) -> Node:
    """Return the tree with relative paths made absolute.

    Args:
        node: the tree.
        schema: tells which keys are paths.
        loc: place of the tree in the configuration.
        faults: texts that cannot be encoded in UTF-8 are appended, as faults.
    """
    value = node.value
    if isinstance(value, dict):
        value = {key: _with_paths(v, schema, (*loc, key), faults) for key, v in value.items()}
    elif isinstance(value, list):
        value = [_with_paths(v, schema, (*loc, i), faults) for i, v in enumerate(value)]
    elif isinstance(value, str):
        if schema.is_path(loc, value):
            value = str(own_or(node.folder / value, value))
        # Surrogates are how Python holds the bytes of a file's name that is not UTF-8.
        if any("\ud800" <= letter <= "\udfff" for letter in value):
            text = f"found {value_in_words(value)}, expected a name in UTF-8"
            faults.append(Fault(node.place, dotted(loc), text))
            value = ""
    return Node(node.place, node.folder, value)


def _anchored(model: M) -> M:
    """Return the model with relative paths made absolute from `config_dir()`.

    Only defaults are still relative: the paths of files and overrides are absolute already.
    """
    changes: dict[str, Any] = {}
    for name, value in model:
        if isinstance(value, Path) and not value.is_absolute():
            changes[name] = config_dir() / value
        elif isinstance(value, BaseModel):
            changes[name] = _anchored(value)
    return model.model_copy(update=changes)


def _unknown_drivers(tree: Node, drivers: Mapping[str, Collection[str]]) -> Iterator[Fault]:
    """Yield a fault for each driver that is not among those known for its section."""
    for section, known in drivers.items():
        node, loc = tree.locate((section, "driver"))
        if loc == (section, "driver") and isinstance(node.value, str) and node.value not in known:
            expected = "one of " + ", ".join(sorted(known))
            yield Fault(
                node.place, dotted(loc), f"found {value_in_words(node.value)}, expected {expected}"
            )


def _missing_files(tree: Node) -> Iterator[Fault]:
    """Yield a fault for each pad and calibration that does not exist."""
    for section, key in (("pad", "layout"), ("camera", "calibration")):
        node, loc = tree.locate((section, key))
        if loc != (section, key) or not isinstance(node.value, str):
            continue
        path = own_or(node.folder / node.value, node.value)
        if not path.exists():
            own = ", ".join(f"{section}s/{name}.yaml" for name in config_files(f"{section}s"))
            text = f"no such file: {value_in_words(shown(path))}; landerd's own: {own}"
            yield Fault(node.place, dotted(loc), text)


def _at(model: Any, section: str) -> Any:
    """Return the value of a dotted section, as "camera.v4l2"."""
    for name in section.split("."):
        model = getattr(model, name)
    return model
