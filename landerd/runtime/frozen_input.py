"""Detects frozen input: old data with a new time stamp (rule 5)."""

from dataclasses import fields
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from landerd.messages import Attitude, GimbalState, Input, LocalPosition

# Reports in a row that all differ: what never repeated itself for so long is frozen when it does.
# Coarse angles repeat themselves before, and may then for ever.
RESTLESS_REPORTS = 100
# Attitude and position are an estimator's floats. They repeat themselves while it does not run yet,
# or stands still without noise: no reason to take them for coarse once they were restless.
RESTLESS_ESTIMATES = 20
Report = Attitude | LocalPosition | GimbalState
EVEN_SHARE = 0.99  # of a picture's pixels at one level: it is blown out, or black
_CONTENTS = {  # all of a report but its time
    kind: attrgetter(*(f.name for f in fields(kind) if f.name != "t"))
    for kind in (Attitude, LocalPosition, GimbalState)
}
SOME_ROWS = 32  # pictures are compared in one row of so many first


class FrozenInput:
    """Detects data that repeat to the bit, as no sensor's in the air do."""

    def __init__(self) -> None:
        self._reports: dict[type, _Reports] = {}
        self._picture: NDArray[np.uint8] | None = None

    def repeats(self, message: Input) -> bool:
        """Tell whether a message is the last of its kind with another time."""
        if not isinstance(message, Report):
            return False
        is_coarse = isinstance(message, GimbalState)
        return self._reports.setdefault(type(message), _Reports(is_coarse)).repeats(message)

    def picture_repeats(self, image: NDArray[np.uint8]) -> bool:
        """Tell whether a picture is the last one; the camera may use its memory again.

        Those in which all is white, or black, are alike and yet new, a dead pixel or two aside:
        they must be seen for the exposure to be mended.
        """
        last, self._picture = self._picture, image.copy()
        if last is None or not np.array_equal(last[::SOME_ROWS], image[::SOME_ROWS]):
            return False  # as a rule; to compare all of it takes as long as a copy
        if not np.array_equal(last, image):
            return False
        # A level that nearly all pixels have is the median of some rows too, which is quick to
        # find: what is left over is less than half of them.
        level = np.median(image[::SOME_ROWS])
        even = int(np.count_nonzero(image == level))
        return even < EVEN_SHARE * image.size


class _Reports:
    """The reports of one kind."""

    def __init__(self, may_be_coarse: bool) -> None:
        self._last: object = None
        self._may_be_coarse = may_be_coarse
        self._differed = 0  # so many in a row
        self._is_restless = self._is_coarse = False

    def repeats(self, message: Report) -> bool:
        last, self._last = self._last, _CONTENTS[type(message)](message)
        if last != self._last:
            self._differed += 1
            most = RESTLESS_REPORTS if self._may_be_coarse else RESTLESS_ESTIMATES
            self._is_restless = self._is_restless or self._differed >= most
            return False
        self._differed = 0
        # It has repeated itself before it was known to be restless.
        self._is_coarse = self._is_coarse or (self._may_be_coarse and not self._is_restless)
        return self._is_restless and not self._is_coarse
