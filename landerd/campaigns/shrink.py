"""Reduces the faults of a failed flight to the least with which it still fails in the same way."""

from collections.abc import Callable, Sequence
from typing import TypeVar

F = TypeVar("F")


def shrunk(
    faults: Sequence[F],
    fails: Callable[[Sequence[F]], bool],
    lesser: Callable[[F], Sequence[F]],
    most: int,
) -> list[F]:
    """Return fewer or lesser faults that still fail.

    Args:
        faults: faults with which the flight fails.
        fails: flies with faults and tells whether the flight fails as before.
        lesser: returns lesser versions of a fault, the least first.
        most: largest number of flights.
    """
    least = list(faults)
    flown = 0

    def still_fails(tried: Sequence[F]) -> bool:
        nonlocal flown
        flown += 1
        return fails(tried)

    for each in faults:
        without = [f for f in least if f is not each]
        if without and len(least) > 1 and flown < most and still_fails(without):
            least = without
    for i in range(len(least)):
        lessened = True
        while lessened and flown < most:
            lessened = False
            for option in lesser(least[i]):
                tried = [*least[:i], option, *least[i + 1 :]]
                if flown < most and still_fails(tried):
                    least, lessened = tried, True
                    break
    return least
