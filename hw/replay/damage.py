"""Counts the unusable parts of a recorded file."""

_RECORD = 512  # bytes: no record is longer


class Damage:
    """Counts the bytes of a file that are no part of any record."""

    def __init__(self, size: int) -> None:
        """Of a file of so many bytes."""
        self._size = size
        self._start = self._middle = self._end = 0

    def skip(self, start: int, end: int) -> None:
        """Note that the bytes from start up to end are left out."""
        if start == 0:
            self._start += end - start
        elif end == self._size:
            self._end += end - start
        else:
            self._middle += end - start

    def in_words(self) -> str:
        """Return what is left out, empty if nothing is."""
        if self._end and not (self._start or self._middle) and self._end < _RECORD:
            return "its last record is cut off"
        parts = (
            (self._start, "at its start"),
            (self._middle, "in the middle"),
            (self._end, "at its end"),
        )
        skipped = [f"{count} {where}" for count, where in parts if count]
        if not skipped:
            return ""
        return f"damaged or cut: of its {self._size} bytes {', '.join(skipped)} are left out"
