"""The base of all typed YAML blocks: of the configuration, drivers, pads and simulated world.

Unlike `landerd.config` this may be imported by `hw`.
"""

import re
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, field_validator

from landerd.files import read_text, why_unread

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Angle = Annotated[float, Field(strict=True, ge=-360, le=360)]  # in degrees


# Magnitudes of the numbers with a fraction that are taken, beside 0. Squares and quotients of
# others end a flight: those of a gain of 1e-200 and of an angle of 1e200 did.
LEAST, MOST = 1e-9, 1e9

T = TypeVar("T")


class Section(BaseModel):
    """A block of keys: unknown ones are errors, values never change."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @field_validator("*")
    @classmethod
    def _can_be_reckoned_with(cls, value: T) -> T:
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and number and not LEAST <= abs(number) <= MOST:
                raise ValueError(f"found {number:g}, expected 0 or {LEAST:g} to {MOST:g}")
        return value


def value_in_words(value: object) -> str:
    """Say in words what a value of a file is."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a block of keys"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return repr(value)


# A number, decimal, as a plain scalar of YAML 1.2: in pads, calibrations and configurations alike.
NUMBER = r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?"
_OF_YAML_1_1 = {f"tag:yaml.org,2002:{name}" for name in ("bool", "int", "float", "timestamp")}


class _Loader(yaml.SafeLoader):
    """Reads YAML 1.2's plain scalars, and OpenCV's matrices as mappings.

    Without the surprises of 1.1: 010 is ten, yes and 1:30 are text, 1e-05 is a number. A key that
    is given twice is refused: of two diameters the last one would be flown on.
    """

    # A copy without what 1.1 takes for a number, a truth or a date.
    yaml_implicit_resolvers = {  # noqa: RUF012 - yaml.SafeLoader has it so
        first: [(tag, pattern) for tag, pattern in resolvers if tag not in _OF_YAML_1_1]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except ValueError:  # a tag that its text does not fit, or too many digits
            raise yaml.constructor.ConstructorError(
                problem=f"found {node.value!r:.40}, which is no {node.tag.rpartition(':')[2]}",
                problem_mark=node.start_mark,
            ) from None

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        names: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value != "<<":
                if key.value in names:
                    raise yaml.constructor.ConstructorError(
                        problem=f"{key.value} is given twice", problem_mark=key.start_mark
                    )
                names.add(key.value)
        return super().construct_mapping(node, deep)


_DIGITS = list("-+.0123456789")
for _name, _pattern, _first in (
    ("bool", r"(true|True|TRUE|false|False|FALSE)\Z", list("tTfF")),
    ("int", r"[-+]?\d+\Z", _DIGITS),
    ("float", rf"({NUMBER}|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|Nan|NAN))\Z", _DIGITS),
):
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_name}", re.compile(_pattern, re.ASCII), _first
    )
_Loader.add_constructor("tag:yaml.org,2002:int", lambda _, node: int(node.value))
_Loader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix",
    yaml.SafeLoader.construct_yaml_map,  # type: ignore[type-var]
)


def read_mapping(path: Path, error: type[Exception], expected: str) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Args:
        path: the file.
        error: raised with one line, which names the file, if it is no mapping.
        expected: what the mapping is, in words.
    """
    try:
        text = read_text(path)
        # OpenCV's FileStorage begins with a directive that YAML does not know.
        text = re.sub(r"\A\ufeff?%YAML:1\.0", "", text)
        # `rostopic echo` ends each message with the beginning of another document.
        data = yaml.load(re.sub(r"\n---\s*\Z", "\n", text), Loader=_Loader)
    except (OSError, UnicodeDecodeError) as e:
        raise error(f"{path}: cannot be read: {why_unread(e)}") from None
    except yaml.YAMLError as e:
        mark, problem = getattr(e, "problem_mark", None), getattr(e, "problem", None)
        line = f":{mark.line + 1}" if mark else ""
        what = problem if isinstance(e, yaml.constructor.ConstructorError) else "not YAML"
        raise error(f"{path}{line}: {what}") from None
    except RecursionError:
        raise error(f"{path}: nested too deeply") from None
    if not isinstance(data, dict):
        raise error(f"{path}: expected {expected}")
    return data
