"""Detects frozen input: old data with a new time stamp (rule 5)."""

from dataclasses import fields
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from landerd.messages import Attitude, GimbalState, Input, LocalPosition

# Number of reports in a row that all differ, after which a repetition means that the source is
# frozen. Coarsely quantised angles repeat earlier, and are never taken for frozen then.
RESTLESS_REPORTS = 100
# A change of an angle by less than this, rad, shows that it is not coarse: gimbals that send whole
# numbers have steps of 0.01 degrees (STorM32, 1.7e-4 rad) and more.
FINE_RAD = 1e-4
# The same as RESTLESS_REPORTS for such angles, attitude and position. These are an estimator's
# floats, never coarse: they repeat only while it does not run yet, or stands still without noise.
RESTLESS_ESTIMATES = 20
Report = Attitude | LocalPosition | GimbalState
EVEN_SHARE = 0.99  # share of pixels at one level from which on a picture is blown out, or black
_CONTENTS = {  # all of a report but its time
    kind: attrgetter(*(f.name for f in fields(kind) if f.name != "t"))
    for kind in (Attitude, LocalPosition, GimbalState)
}
SOME_ROWS = 32  # pictures are compared in every 32nd row first


class FrozenInput:
    """Detects data that repeat to the bit, as no sensor's in the air do."""

    def __init__(self) -> None:
        self._reports: dict[type, _Reports] = {}
        self._picture: NDArray[np.uint8] | None = None

    def repeats(self, message: Input) -> bool:
        """Tell whether a message is the last of its kind again, with another time."""
        if not isinstance(message, Report):
            return False
        is_coarse = isinstance(message, GimbalState)
        return self._reports.setdefault(type(message), _Reports(is_coarse)).repeats(message)

    def picture_repeats(self, image: NDArray[np.uint8]) -> bool:
        """Tell whether a picture is the last one again; the camera may reuse its memory.

        Pictures that are all white or black, but for a dead pixel or two, may be alike and still be
        new: they must be seen for the exposure to be corrected.
        """
        last, self._picture = self._picture, image.copy()
        if last is None or not np.array_equal(last[::SOME_ROWS], image[::SOME_ROWS]):
            return False  # the usual case; comparing the whole picture takes as long as a copy
        if not np.array_equal(last, image):
            return False
        # A level that nearly all pixels have is also the median of some of the rows, which is
        # quick to compute: the other pixels are less than half of these rows.
        level = np.median(image[::SOME_ROWS])
        even = int(np.count_nonzero(image == level))
        return even < EVEN_SHARE * image.size


class _Reports:
    """The reports of one kind."""

    def __init__(self, may_be_coarse: bool) -> None:
        self._last: tuple[Any, ...] = ()
        self._may_be_coarse = may_be_coarse
        self._is_fine = not may_be_coarse
        self._differed = 0  # number of reports in a row that differed
        self._is_restless = self._is_coarse = False

    def repeats(self, message: Report) -> bool:
        last, self._last = self._last, _CONTENTS[type(message)](message)
        if last != self._last:
            self._differed += 1
            self._is_fine = self._is_fine or _is_fine_change(last, self._last)
            most = RESTLESS_ESTIMATES if self._is_fine else RESTLESS_REPORTS
            self._is_restless = self._is_restless or self._differed >= most
            return False
        self._differed = 0
        # A repetition before it was known to be restless: its values are coarse.
        self._is_coarse = self._is_coarse or (self._may_be_coarse and not self._is_restless)
        return self._is_restless and not self._is_coarse


def _is_fine_change(before: tuple[Any, ...], after: tuple[Any, ...]) -> bool:
    """Tell whether an angle of a report changed by less than a coarse one can; () is no report."""
    pairs = zip(before, after, strict=False)
    return any(isinstance(a, float) and 0.0 < abs(b - a) < FINE_RAD for a, b in pairs)
