"""The tunable parameters: numbers of the configuration that a pilot changes over MAVLink.

Every number in the sections `guidance` and `rc` is a parameter. Its name is derived from its key
(`_short`), has at most 16 characters and never changes its meaning. Its range is that of the
configuration's model. docs/parameters.md is generated from the parameters (landerd.reference).
"""

import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import annotated_types
import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from landerd.config.models import Config
from landerd.config.yaml_tree import parse_block, put
from landerd.ports import ParameterRefused

SECTIONS = ("guidance", "rc")
# Keys that may be changed while the vehicle is armed: gains and the shape of the descent region.
IN_FLIGHT = re.compile(
    r"guidance\.(?!limits|lost|descent)\w+\.(?!integral_limit)[\w.]+"
    r"|guidance\.descent\.(k1_m|k2_per_m|widest_k1_m|close_factor|slowest_mps)"
)
# Units by suffix of a key; longer suffixes come first, as the first that fits is taken.
_UNITS = {
    "_per_m": "1/m",
    "_deg_s": "deg/s",
    "_mps3": "m/s^3",
    "_mps2": "m/s^2",
    "_mps": "m/s",
    "_deg": "deg",
    "_us": "us",
    "_hz": "Hz",
    "_s": "s",
    "_m": "m",
}
# Abbreviations in names, by word of a key; other words are written in full.
_SHORT = {
    "acceleration": "ACC",
    "alignment": "ALIGN",
    "approach": "APP",
    "channel": "CH",
    "close": "CLS",
    "descent": "DESC",
    "height": "HGT",
    "integral": "I",
    "limit": "LIM",
    "limits": "LIM",
    "threshold": "THR",
    "timeout": "TMO",
    "tracking": "TRK",
    "touchdown": "TD",
    "vertical": "V",
}
# Names by key, for keys that the rule would give the name of another key.
_OTHER_NAMES = {"guidance.lost.climb_mps": "LOST_CLIMB_V"}

M = TypeVar("M", bound=BaseModel)


@dataclass(frozen=True)
class Parameter:
    """One tunable number of the configuration."""

    name: str
    key: str  # dotted key of the configuration
    unit: str  # "": the parameter has no unit
    default: float
    whole: bool  # True: only whole numbers are allowed
    bounds: tuple[tuple[str, float], ...]  # as ("above", 0.0); empty: any number is allowed
    in_flight: bool  # True: may be changed while the vehicle is armed

    @property
    def range_in_words(self) -> str:
        """The allowed range, as "above 0, at most 10"."""
        return ", ".join(f"{word} {bound:g}" for word, bound in self.bounds) or "a number"


def parameters() -> dict[str, Parameter]:
    """Return all parameters by name, in the order of the configuration."""
    found: dict[str, Parameter] = {}
    config = Config()
    for section in SECTIONS:
        for parameter in _walk(getattr(config, section), section):
            assert parameter.name not in found, f"{parameter.name} twice: see _OTHER_NAMES"
            found[parameter.name] = parameter
    return found


def value_of(config: BaseModel, key: str) -> float:
    """Return the number at a dotted key."""
    value: Any = config
    for name in key.split("."):
        value = getattr(value, name)
    return float(value)


def with_value(config: M, key: str, value: float) -> M:
    """Return the configuration with one number changed.

    Args:
        config: the configuration or a section of it.
        key: dotted key of the number.
        value: new value; cut to a whole number for keys of whole numbers.

    Raises:
        ValidationError: the model does not allow the value.
    """
    name, _, rest = key.partition(".")
    old = getattr(config, name)
    new = with_value(old, rest, value) if rest else int(value) if isinstance(old, int) else value
    return type(config).model_validate({**dict(config), name: new})


class ParameterSet:
    """The current values of all parameters, and the overlay file into which they are saved."""

    def __init__(self, config: Config, overlay: Path | None = None) -> None:
        """Start with the values of a configuration.

        Args:
            config: the configuration.
            overlay: file that `save` writes; None: parameters cannot be saved.
        """
        self._config = config
        self._overlay = overlay
        self._table = parameters()
        self._unsaved: dict[str, float] = {}  # changed values by dotted key

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters, in the order of the configuration."""
        return tuple(self._table)

    def value(self, name: str) -> float:
        """Return the current value of a parameter. Raises KeyError."""
        return value_of(self._config, self._table[name].key)

    def change(self, name: str, value: float, *, disarmed: bool) -> str:
        """Change the value of a parameter, and return its dotted key in the configuration.

        Args:
            name: of the parameter.
            value: new value.
            disarmed: whether the vehicle is disarmed.

        Raises:
            KeyError: there is no such parameter.
            ParameterRefused: the parameter must not be changed while armed, or the value is out of
                range; nothing has changed.
        """
        parameter = self._table[name]
        if not (disarmed or parameter.in_flight):
            raise ParameterRefused(f"{name}: only while disarmed")
        try:
            if not math.isfinite(value) or (parameter.whole and value != int(value)):
                raise ParameterRefused(f"{name}: {value:g} is no {_kind(parameter)}")
            self._config = with_value(self._config, parameter.key, value)
        except ValidationError as e:
            error = e.errors(include_url=False)[0]
            if error["type"] == "value_error":  # from a check of several keys together
                raise ParameterRefused(f"{name}: {error['ctx']['error']}") from None
            raise ParameterRefused(f"{name}: {parameter.range_in_words}") from None
        self._unsaved[parameter.key] = int(value) if parameter.whole else value
        return parameter.key

    def save(self) -> None:
        """Write the changed values into the overlay file, and keep its other keys.

        Raises:
            ParameterRefused: there is no overlay file, or it cannot be read or written.
        """
        if self._overlay is None:
            raise ParameterRefused("no overlay file to save to")
        try:
            old = self._overlay.read_text("utf-8") if self._overlay.exists() else ""
            tree = parse_block(old, self._overlay)
            for key, value in self._unsaved.items():
                put(tree, key.split("."), value)
            new = self._overlay.with_name(f".{self._overlay.name}.new")
            with new.open("w", encoding="utf-8") as file:
                file.write("# Saved by a ground station; laid over the configuration.\n")
                yaml.safe_dump(tree, file, sort_keys=False)
                file.flush()
                # Readable for all, as `landerd check` runs as another user than the service; the
                # file holds no secret.
                os.fchmod(file.fileno(), 0o644)
                os.fsync(file.fileno())
            new.replace(self._overlay)
        except (OSError, ValueError) as e:
            reason = e.strerror if isinstance(e, OSError) else "bad YAML"
            raise ParameterRefused(f"not saved: {reason}") from None
        self._unsaved.clear()


def _walk(section: BaseModel, key: str) -> Iterator[Parameter]:
    """Yield the parameters of a section with this dotted key, and of the sections in it."""
    for name, field in type(section).model_fields.items():
        value, inner = getattr(section, name), f"{key}.{name}"
        if isinstance(value, BaseModel):
            yield from _walk(value, inner)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            stem, unit = _without_unit(inner)
            yield Parameter(
                name=_OTHER_NAMES.get(inner) or _short(stem),
                key=inner,
                unit=unit,
                default=float(value),
                whole=isinstance(value, int),
                bounds=tuple(_bounds(field)),
                in_flight=IN_FLIGHT.fullmatch(inner) is not None,
            )


def _without_unit(key: str) -> tuple[str, str]:
    """Return a key without the suffix of its unit, and the unit; "": it has none."""
    for suffix, unit in _UNITS.items():
        if key.endswith(suffix):
            return key.removesuffix(suffix), unit
    return key, ""


def _short(stem: str) -> str:
    """Return the name of the parameter with this dotted key, without the suffix of its unit."""
    words = re.split(r"[._]", stem.removeprefix("guidance."))
    return "_".join(_SHORT.get(word, word.upper()) for word in words)


def _bounds(field: FieldInfo) -> Iterator[tuple[str, float]]:
    """Yield the bounds of a number, as ("at least", 0.5)."""
    for item in field.metadata:
        match item:
            case annotated_types.Gt(gt=bound):
                yield "above", float(str(bound))
            case annotated_types.Ge(ge=bound):
                yield "at least", float(str(bound))
            case annotated_types.Lt(lt=bound):
                yield "below", float(str(bound))
            case annotated_types.Le(le=bound):
                yield "at most", float(str(bound))


def _kind(parameter: Parameter) -> str:
    return "whole number" if parameter.whole else "number"
