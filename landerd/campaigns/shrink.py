"""The least of what went wrong with which a flight still fails in the same way."""

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
        faults: that fail together.
        fails: flies with these and tells whether it fails as before.
        lesser: returns what a fault may be made of that is less, the least first.
        most: flights at most.
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
