"""Notices input that is the old one with a new time stamp (rule 5)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from landerd.messages import Attitude, GimbalState, Input

# Reports of a gimbal in a row that all differ: one that has never repeated itself for so long is
# frozen when it does. One of coarse angles, or that stands still, repeats itself before.
RESTLESS_REPORTS = 100


class FrozenInput:
    """Tells what repeats itself to the bit: no sensor in the air does."""

    def __init__(self) -> None:
        self._attitude: Attitude | None = None
        self._gimbal: GimbalState | None = None
        self._picture: NDArray[np.uint8] | None = None
        self._reports = 0  # of the gimbal since it last went on after repeating itself

    def repeats(self, message: Input) -> bool:
        """Tell whether a message is the last of its kind with another time."""
        if isinstance(message, Attitude):
            last, self._attitude = self._attitude, message
            return last is not None and replace(last, t=message.t) == message
        if isinstance(message, GimbalState):
            return self._gimbal_repeats(message)
        return False

    def picture_repeats(self, image: NDArray[np.uint8]) -> bool:
        """Tell whether a picture is the last one; the camera may use its memory again."""
        last, self._picture = self._picture, image.copy()
        return last is not None and np.array_equal(last, image)

    def _gimbal_repeats(self, message: GimbalState) -> bool:
        last, self._gimbal = self._gimbal, message
        is_same = last is not None and replace(last, t=message.t) == message
        is_restless = self._reports >= RESTLESS_REPORTS
        if is_same and not is_restless:
            self._reports = -(1 << 62)  # it is one that repeats itself
        elif not is_same:
            self._reports += 1
        return is_same and is_restless
