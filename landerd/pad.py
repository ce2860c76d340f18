"""Pad layouts: which markers, how large, where on the pad.

Pad frame: origin at the landing point, x to the pad's north, y east, z down into the pad. All
markers lie in the plane z = 0. A square's north is its top as its makers print it.
"""

from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class PadError(Exception):
    """A pad file cannot be used; the text names file, key and what was expected."""


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Ring(_Model):
    """A WhyCon ring: black between the two circles, white inside and around."""

    kind: Literal["whycon"]
    outer_diameter_m: Positive
    inner_ratio: Annotated[float, Field(gt=0.1, lt=0.9)] = 50 / 122  # inner over outer diameter
    position_m: tuple[Finite, Finite] = (0.0, 0.0)  # centre: north, east


class Square(_Model):
    """An AprilTag or ArUco marker."""

    kind: Literal["apriltag", "aruco"]
    dictionary: str  # OpenCV's name without DICT_: APRILTAG_36h11, 4X4_50, ...
    id: Annotated[int, Field(ge=0)]
    size_m: Positive  # outer edge of the black border
    position_m: tuple[Finite, Finite] = (0.0, 0.0)  # centre: north, east
    heading_deg: Finite = 0.0  # of the marker's top, clockwise from the pad's north


class Plate(_Model):
    """The white plate the markers are printed on: its edges in the pad frame."""

    north_m: Positive
    south_m: Positive
    east_m: Positive
    west_m: Positive


Marker = Annotated[Ring | Square, Field(discriminator="kind")]


class PadLayout(_Model):
    """All markers of a pad and its plate."""

    name: str
    markers: Annotated[tuple[Marker, ...], Field(min_length=1)]
    plate: Plate

    @property
    def rings(self) -> tuple[Ring, ...]:
        """The pad's rings."""
        return tuple(m for m in self.markers if isinstance(m, Ring))

    @property
    def squares(self) -> tuple[Square, ...]:
        """The pad's square markers."""
        return tuple(m for m in self.markers if isinstance(m, Square))

    @property
    def has_heading(self) -> bool:
        """Whether any marker tells the pad's heading."""
        return bool(self.squares) or len(self.rings) > 1


def load_pad(path: Path) -> PadLayout:
    """Read a pad layout.

    Raises:
        PadError: unreadable, or a key is missing, unknown or out of range.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as e:
        reason = e.strerror if isinstance(e, OSError) else "not text"
        raise PadError(f"{path}: cannot be read: {reason}") from None
    except yaml.YAMLError as e:
        mark = getattr(e, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        raise PadError(f"{path}{line}: not YAML") from None
    if not isinstance(data, dict):
        raise PadError(f"{path}: expected a mapping with name, markers and plate")
    try:
        return PadLayout.model_validate(data)
    except ValidationError as e:
        lines = [f"{'.'.join(str(p) for p in i['loc'])}: {i['msg']}" for i in e.errors()]
        raise PadError(f"{path}: " + "; ".join(lines)) from None
