from collections.abc import Sequence

from landerd.campaigns.shrink import shrunk


def halves(x: int) -> list[int]:
    return [x // 2] if x > 1 else []


def least(faults: Sequence[int], needed: int, *, most: int = 50) -> tuple[list[int], int]:
    """Shrink numbers of which one must be at least as large as needed; count the flights."""
    flown = 0

    def fails(tried: Sequence[int]) -> bool:
        nonlocal flown
        flown += 1
        return max(tried) >= needed

    return shrunk(faults, fails, halves, most), flown


def test_what_is_not_needed_is_left_out_and_the_rest_made_less() -> None:
    assert least([3, 100, 7], 20)[0] == [25]


def test_what_cannot_be_less_stays() -> None:
    assert least([20], 20)[0] == [20]


def test_two_that_only_fail_together_stay_together() -> None:
    assert shrunk([4, 4], lambda tried: len(tried) == 2, halves, 50) == [1, 1]


def test_it_flies_no_more_than_it_may() -> None:
    found, flown = least([1000, 1000], 1, most=3)
    assert flown == 3
    assert max(found) >= 1
