"""ArduPilot's DataFlash `.bin`: its records.

A record is two marker bytes, its type, and the fields that a FMT record has named for the type
(ArduPilot, libraries/AP_Logger/LogStructure.h). There is no checksum: a record counts only if the
next one begins where it ends.
"""

import math
import re
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from hw.replay.damage import Damage

MARKER = b"\xa3\x95"
_FMT_RECORD = re.compile(rb"\xa3\x95\x80..[A-Z][A-Z0-9]{1,3}\0{0,2}[A-Za-z\0]{16}", re.DOTALL)
_FMT = 0x80
_FMT_LENGTH = 89
_FMT_FIELDS = struct.Struct("<BB4s16s64s")

# struct's characters of each format character, and its scale; None: a text, or numbers not read
_FIELDS: Mapping[str, tuple[str, float | None]] = {
    **{c: (c, 1.0) for c in "bBhHiIqQfd"},
    "g": ("e", 1.0),
    "M": ("B", 1.0),
    "c": ("h", 0.01),
    "C": ("H", 0.01),
    "e": ("i", 0.01),
    "E": ("I", 0.01),
    "L": ("i", 1e-7),
    "n": ("4s", None),
    "N": ("16s", None),
    "Z": ("64s", None),
    "a": ("64s", None),
}
_WHOLE = frozenset("bBhHiIqQM")


@dataclass(frozen=True)
class Record:
    """One record.

    Attributes:
        kind: as "ATT".
        t: s since boot; of a record without a time that of the one before it.
        numbers: by column, scaled to the unit that the format has; what is no number is not in it.
        texts: by column.
        whole: the columns of `numbers` that were logged as whole numbers, unscaled.
    """

    kind: str
    t: float
    numbers: Mapping[str, float]
    texts: Mapping[str, str]
    whole: frozenset[str]


class _Format:
    """What a type's fields are."""

    def __init__(self, kind: str, length: int, form: str, columns: list[str]) -> None:
        """Of a record of so many bytes, markers and type counted.

        Raises:
            ValueError: the fields do not make up the length, or are not known.
        """
        if not set(form) <= set(_FIELDS) or len(columns) != len(form):
            raise ValueError(f"{kind}: {form} {columns}")
        self._struct = struct.Struct("<" + "".join(_FIELDS[c][0] for c in form))
        if self._struct.size + 3 != length:
            raise ValueError(f"{kind}: {form} in {length} bytes")
        self.kind = kind
        self._columns = [(name, _FIELDS[c][1]) for name, c in zip(columns, form, strict=True)]
        self._whole = frozenset(n for n, c in zip(columns, form, strict=True) if c in _WHOLE)

    def record(self, data: bytes, at: int, last_t: float) -> Record:
        """Return the record whose fields begin at a place."""
        numbers: dict[str, float] = {}
        texts: dict[str, str] = {}
        values = self._struct.unpack_from(data, at)
        for (name, scale), value in zip(self._columns, values, strict=True):
            if scale is None:
                texts[name] = value.split(b"\0")[0].decode("ascii", "replace")
            elif math.isfinite(value):
                numbers[name] = value * scale
        return Record(self.kind, _time(numbers, last_t), numbers, texts, self._whole)


def _time(numbers: Mapping[str, float], last_t: float) -> float:
    """Return s since boot; firmware up to 3.2 logs ms, and GPS's own TimeMS is of the week."""
    if "TimeUS" in numbers:
        return 1e-6 * numbers["TimeUS"]
    boot_ms = numbers.get("T") if "Week" in numbers else numbers.get("TimeMS")
    return last_t if boot_ms is None else 1e-3 * boot_ms


def has_formats(data: bytes) -> bool:
    """Return whether there is a FMT record: without any, no field of a DataFlash log is known."""
    return _FMT_RECORD.search(data) is not None


class DataFlash:
    """A log's records of some kinds, in order.

    Attributes:
        damage: what is left out, once all records were read.
    """

    def __init__(self, data: bytes, kinds: Collection[str]) -> None:
        self.damage = Damage(len(data))
        self._data = data
        self._kinds = kinds
        self._lengths: dict[int, int] = {_FMT: _FMT_LENGTH}
        self._wanted: dict[int, _Format] = {}

    def __iter__(self) -> Iterator[Record]:
        """Yield the records; what is damaged between them is left out."""
        data, at, t = self._data, 0, 0.0
        while at < len(data):
            end = self._record_end(at)
            if end is None:
                resumed = self._next_record(at + 1)
                self.damage.skip(at, resumed)
                at = resumed
                continue
            number = data[at + 2]
            if number == _FMT:
                self._note_format(at + 3)
            elif number in self._wanted:
                record = self._wanted[number].record(data, at + 3, t)
                t = record.t
                yield record
            at = end

    def _record_end(self, at: int) -> int | None:
        """Return where the record at a place ends; None: there is no good one."""
        data = self._data
        if data[at : at + 2] != MARKER or at + 2 >= len(data):
            return None
        length = self._lengths.get(data[at + 2])
        if length is None:
            return None
        end = at + length
        return end if end == len(data) or data[end : end + 2] == MARKER else None

    def _next_record(self, at: int) -> int:
        """Return where the next good record begins, or the end."""
        while (at := self._data.find(MARKER, at)) >= 0:
            if self._record_end(at) is not None:
                return at
            at += 1
        return len(self._data)

    def _note_format(self, at: int) -> None:
        number, length, kind, form, columns = _FMT_FIELDS.unpack_from(self._data, at)
        if length < 3 or number == _FMT:
            return
        self._lengths[number] = length
        self._wanted.pop(number, None)
        name, characters, names = (
            text.split(b"\0")[0].decode("ascii", "replace") for text in (kind, form, columns)
        )
        if name in self._kinds:
            try:
                self._wanted[number] = _Format(name, length, characters, names.split(","))
            except ValueError:
                return  # its records are passed over by their length
