"""What all blocks of typed YAML share: those of the configuration, of drivers, pads and the world.

Unlike `landerd.config` this may be imported by `hw`.
"""

import re
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BaseModel, ConfigDict, Field

from landerd.files import read_text

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-360, le=360)]  # in degrees


class Section(BaseModel):
    """A block of keys: unknown ones are errors, values never change."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class _Loader(yaml.SafeLoader):
    """Reads 1e-05 as a number, which YAML 1.1 does not, and OpenCV's matrices as mappings.

    A key that is given twice is refused: of two diameters the last one would be flown on.
    """

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


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+\Z", re.ASCII),
    list("-+.0123456789"),
)
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
        data = yaml.load(re.sub(r"\A%YAML:1\.0", "", text), Loader=_Loader)
    except (OSError, UnicodeDecodeError) as e:
        reason = e.strerror if isinstance(e, OSError) else "not text"
        raise error(f"{path}: cannot be read: {reason}") from None
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
