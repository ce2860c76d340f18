from collections.abc import Sequence

from landerd.campaigns.shrink import shrunk


def halves(x: int) -> list[int]:
    return [x // 2] if x > 1 else []


def least(faults: Sequence[int], needed: int, *, most: int = 50) -> tuple[list[int], int]:
    """Shrink numbers, of which one must be at least this large to fail; count the flights."""
    flown = 0

    def fails(tried: Sequence[int]) -> bool:
        nonlocal flown
        flown += 1
        return max(tried) >= needed

    return shrunk(faults, fails, halves, most), flown


def test_faults_that_are_not_needed_are_left_out_and_the_others_reduced() -> None:
    assert least([3, 100, 7], 20)[0] == [25]


def test_a_fault_that_fails_only_at_full_size_stays_as_it_is() -> None:
    assert least([20], 20)[0] == [20]


def test_two_faults_that_fail_only_together_are_both_kept() -> None:
    assert shrunk([4, 4], lambda tried: len(tried) == 2, halves, 50) == [1, 1]


def test_no_more_flights_are_flown_than_allowed() -> None:
    found, flown = least([1000, 1000], 1, most=3)
    assert flown == 3
    assert max(found) >= 1
