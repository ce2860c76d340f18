"""Pad layouts: which markers, how large, where on the pad.

Pad frame: origin at the landing point, x to the pad's north, y east, z down into the pad. All
markers lie in the plane z = 0. A square's north is its top as its makers print it.
"""

import math
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator
from pydantic_core import ErrorDetails

from landerd.section import Finite, Positive, Section, read_mapping, value_in_words

# Dictionaries of squares by OpenCV's names without DICT_, and how many ids each has.
DICTIONARIES = {
    **{f"{n}X{n}_{ids}": ids for n in (4, 5, 6, 7) for ids in (50, 100, 250, 1000)},
    "ARUCO_ORIGINAL": 1024,
    "ARUCO_MIP_36h12": 250,
    "APRILTAG_16h5": 30,
    "APRILTAG_25h9": 35,
    "APRILTAG_36h10": 2320,
    "APRILTAG_36h11": 587,
}


_LONGEST_FAULT = 160  # letters: what is wrong may be a value of any length
# What pydantic expected, by the type of its error and what it says of it, in our words.
_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text",
    "tuple_type": "a list",
    "model_type": "a block of keys",
    "model_attributes_type": "a block of keys",
    "finite_number": "a finite number",
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "too_long": "{max_length} values",
    "union_tag_invalid": "{expected_tags}",
    "literal_error": "{expected}",
}


class PadError(Exception):
    """A pad file cannot be used; the text names file, key and what was expected."""


class Ring(Section):
    """A WhyCon ring: black between the two circles, white inside and around."""

    kind: Literal["whycon"]
    outer_diameter_m: Positive
    # inner over outer diameter
    inner_ratio: Annotated[float, Field(strict=True, gt=0.1, lt=0.9)] = 50 / 122
    position_m: tuple[Finite, Finite] = (0.0, 0.0)  # centre: north, east

    @property
    def radius_m(self) -> float:
        """Radius of the outer edge."""
        return 0.5 * self.outer_diameter_m


class Square(Section):
    """An AprilTag or ArUco marker."""

    kind: Literal["apriltag", "aruco"]
    # OpenCV's name, with or without DICT_: APRILTAG_36h11, 4X4_50; or the AprilTag project's,
    # tag36h11. Held as the first.
    dictionary: str
    id: Annotated[int, Field(strict=True, ge=0)]
    size_m: Positive  # outer edge of the black border
    position_m: tuple[Finite, Finite] = (0.0, 0.0)  # centre: north, east
    heading_deg: Finite = 0.0  # of the marker's top, clockwise from the pad's north

    @field_validator("dictionary")
    @classmethod
    def _known(cls, name: str) -> str:
        spelt = name.lower().removeprefix("dict_")
        if spelt.startswith("tag"):
            spelt = f"april{spelt[:3]}_{spelt[3:]}"
        for known in DICTIONARIES:
            if known.lower() == spelt:
                return known
        raise ValueError(f"no dictionary {name!r}; known are {', '.join(DICTIONARIES)}")

    @model_validator(mode="after")
    def _has_id(self) -> Self:
        if self.id >= DICTIONARIES[self.dictionary]:
            last = DICTIONARIES[self.dictionary] - 1
            raise ValueError(f"dictionary {self.dictionary} has no id {self.id}: 0 to {last}")
        return self


class WhyCode(Section):
    """A WhyCode: a black ring that carries a number and a direction in teeth on its inner edge.

    Its print is that of the generator whycode-gen (github.com/jiriUlr/whycode-gen; Lightbody,
    Krajnik et al., "An Efficient Visual Fiducial Localisation System", 2017). In outer radii: white
    core to 240/700, code band to 420/700, black ring to 1. The band is cut into `bits` equal cells;
    the first half of a cell is black for a 0, the second half for a 1. The number's first (highest)
    bit begins to the east of the upright print, and the others follow anticlockwise.

    A necklace has no beginning, so numbers that are turns of one another are one code, and a number
    that repeats itself within a turn has no direction. Therefore `id` must be the smallest number
    among its own rotations, and every rotation another number: with 6 bits 1, 3, 5, 7, 11, 13, 15,
    23 and 31. whycode-gen calls it the encoding, and counts these from 1 on its file names.
    """

    kind: Literal["whycode"]
    outer_diameter_m: Positive
    bits: Annotated[int, Field(strict=True, ge=3, le=12)]
    id: Annotated[int, Field(strict=True, ge=0)]
    position_m: tuple[Finite, Finite] = (0.0, 0.0)  # centre: north, east
    heading_deg: Finite = 0.0  # of the print's top, clockwise from the pad's north

    @property
    def radius_m(self) -> float:
        """Radius of the ring's outer edge."""
        return 0.5 * self.outer_diameter_m

    @model_validator(mode="after")
    def _reads_as_one_code(self) -> Self:
        if self.id >= 2**self.bits:
            raise ValueError(f"id {self.id} has more than {self.bits} bits")
        turns = [rotated(self.id, self.bits, n) for n in range(1, self.bits)]
        if self.id in turns:
            degrees = 360.0 / self.bits * (1 + turns.index(self.id))
            raise ValueError(
                f"id {self.id} with {self.bits} bits is ambiguous: turned by {degrees:g} degrees "
                f"it looks the same; {_usable(self.bits)}"
            )
        if min(turns) < self.id:
            raise ValueError(
                f"id {self.id} with {self.bits} bits is ambiguous: it is id {min(turns)} turned; "
                f"{_usable(self.bits)}"
            )
        return self


WHYCODE_CORE, WHYCODE_BAND = 240 / 700, 420 / 700  # edges of the code band in outer radii


def rotated(word: int, bits: int, by: int) -> int:
    """Return a number of so many bits after its highest `by` bits were moved to its end."""
    return (word << by | word >> (bits - by)) & ((1 << bits) - 1)


def whycode_ids(bits: int) -> list[int]:
    """Return the numbers of so many bits that are smaller than all their rotations."""
    return [w for w in range(2**bits) if all(w < rotated(w, bits, n) for n in range(1, bits))]


def _usable(bits: int) -> str:
    ids = [str(i) for i in whycode_ids(bits)]
    shown = ids if len(ids) < 12 else [*ids[:10], "...", ids[-1]]
    return f"usable: {', '.join(shown)}"


class Plate(Section):
    """The white plate the markers are printed on: its edges in the pad frame."""

    north_m: Positive
    south_m: Positive
    east_m: Positive
    west_m: Positive

    def holds(self, north: float, east: float) -> bool:
        """Tell whether a point of the pad frame, m, is on it."""
        return -self.south_m <= north <= self.north_m and -self.west_m <= east <= self.east_m

    def white_round(self, square: Square) -> float:
        """Return the least width of a square's margin on the plate, m; none: 0."""
        north, east = square.position_m
        heading = math.radians(square.heading_deg)
        nearest = min(
            self.north_m - north, self.south_m + north, self.east_m - east, self.west_m + east
        )
        half = nearest / (abs(math.cos(heading)) + abs(math.sin(heading)))
        return max(0.0, half - 0.5 * square.size_m)


Marker = Annotated[Ring | WhyCode | Square, Field(discriminator="kind")]


def size_m(marker: Marker) -> float:
    """Return what is measured of a marker: outer diameter, or outer edge of the black border."""
    return marker.size_m if isinstance(marker, Square) else marker.outer_diameter_m


class PadLayout(Section):
    """All markers of a pad and its plate."""

    name: str
    markers: Annotated[tuple[Marker, ...], Field(min_length=1)]
    plate: Plate
    # How true the pad is to this file, 1 sigma. Printers and shops that cut vinyl keep half a per
    # cent, and an edge of ink or paint a millimetre; markers are laid with a tape measure; plywood
    # and composite plates of this size warp by a degree or two.
    # share of a marker's size
    print_scale_sigma: Annotated[float, Field(strict=True, ge=0, le=0.1)] = 0.007
    # of a marker's centre
    placement_sigma_m: Annotated[float, Field(strict=True, ge=0, le=0.1)] = 0.003
    # between the planes of landing point and marker
    flatness_deg: Annotated[float, Field(strict=True, ge=0, le=10)] = 1.5

    @property
    def rings(self) -> tuple[Ring, ...]:
        """The pad's rings."""
        return tuple(m for m in self.markers if isinstance(m, Ring))

    @property
    def squares(self) -> tuple[Square, ...]:
        """The pad's square markers."""
        return tuple(m for m in self.markers if isinstance(m, Square))

    @property
    def whycodes(self) -> tuple[WhyCode, ...]:
        """The pad's WhyCodes."""
        return tuple(m for m in self.markers if isinstance(m, WhyCode))

    @property
    def has_heading(self) -> bool:
        """Whether any marker tells the pad's heading, or two rings that lie apart."""
        places = {ring.position_m for ring in self.rings}
        return bool(self.squares or self.whycodes) or len(places) > 1

    @model_validator(mode="after")
    def _is_found_by_a_ring_alone(self) -> Self:
        if not self.has_heading and self.rings[0].position_m != (0.0, 0.0):
            raise ValueError(
                "a ring alone does not tell which way the landing point lies: expected its "
                "position_m to be [0, 0], or another marker"
            )
        return self

    @model_validator(mode="after")
    def _no_square_twice(self) -> Self:
        seen = [(s.dictionary, s.id) for s in self.squares]
        for dictionary, number in seen:
            if seen.count((dictionary, number)) > 1:
                raise ValueError(f"id {number} of {dictionary} is on the pad twice")
        return self

    @model_validator(mode="after")
    def _no_whycode_twice(self) -> Self:
        seen = [(c.bits, c.id) for c in self.whycodes]
        for bits, number in seen:
            if seen.count((bits, number)) > 1:
                raise ValueError(f"whycode id {number} with {bits} bits is on the pad twice")
        return self


def load_pad(path: Path) -> PadLayout:
    """Read a pad layout.

    Raises:
        PadError: unreadable, or a key is missing, unknown or out of range.
    """
    expected = "a pad: a mapping with name, markers and plate"
    data = read_mapping(path, PadError, expected)
    if not data.keys() & {"name", "markers", "plate"}:
        raise PadError(f"{path}: expected {expected}")
    try:
        return PadLayout.model_validate(data)
    except ValidationError as e:
        errors = e.errors()
        # Where no marker is right pydantic says, besides, that there are none.
        counted = [error for error in errors if error["type"] != "too_short"] or errors
        raise PadError(f"{path}: " + "; ".join(map(_in_words, counted))) from None


def _in_words(error: ErrorDetails) -> str:
    """Return one of pydantic's errors in our words, with the key that it is about."""
    kind, about, loc = error["type"], error.get("ctx", {}), [str(part) for part in error["loc"]]
    if kind == "value_error":  # one of ours
        text = str(about["error"])
    elif kind == "extra_forbidden":
        text = "unknown key"
    elif kind in ("missing", "union_tag_not_found"):
        text = "is missing"
    elif kind == "too_short":
        text = f"expected at least {about['min_length']}"
    elif kind in _EXPECTED:
        value = about.get("tag", error["input"])
        text = f"found {value_in_words(value)}, expected {_EXPECTED[kind].format(**about)}"
    else:
        text = error["msg"]
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        loc.append("kind")
    elif loc[:1] == ["markers"]:  # behind its number stands its kind
        del loc[2:3]
    if len(text) > _LONGEST_FAULT:
        text = f"{text[:_LONGEST_FAULT]}..."
    return ": ".join(part for part in (".".join(loc), text) if part)
