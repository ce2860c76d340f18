import pytest

from landerd.analysis.intervals import (
    mcnemar,
    mean_interval,
    paired_difference,
    t_quantile,
    wilson,
)


def test_the_interval_of_a_share_is_wilsons() -> None:
    low, high = wilson(98, 100)
    assert (low, high) == pytest.approx((0.930, 0.9945), abs=0.001)
    assert wilson(100, 100)[1] == pytest.approx(1.0)
    assert wilson(0, 0)[0] == 0.0


@pytest.mark.parametrize(
    ("degrees", "quantile"),
    [(1, 12.706), (4, 2.776), (5, 2.571), (9, 2.262), (29, 2.045), (1000, 1.962)],
)
def test_students_t_is_that_of_the_tables(degrees: int, quantile: float) -> None:
    assert t_quantile(degrees) == pytest.approx(quantile, abs=0.004)


def test_the_interval_of_a_mean_is_as_wide_as_the_values_differ() -> None:
    interval = mean_interval([1.0, 2.0, 3.0])
    assert interval == pytest.approx((2.0 - 4.303 / 3**0.5, 2.0 + 4.303 / 3**0.5))
    assert mean_interval([1.0]) is None


def test_mcnemars_test_counts_only_the_pairs_that_differ() -> None:
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(1, 1) == 1.0
    assert mcnemar(0, 5) == pytest.approx(2 / 32)
    assert mcnemar(0, 6) == pytest.approx(2 / 64)


def test_the_difference_of_two_shares_of_the_same_pairs_has_an_interval() -> None:
    assert paired_difference(2, 12, 100) == pytest.approx((0.0261, 0.1700), abs=1e-4)
    assert paired_difference(12, 2, 100) == pytest.approx((-0.1700, -0.0261), abs=1e-4)
    low, high = paired_difference(0, 0, 200)  # none differs: nor are they sure to be the same
    assert (low, high) == pytest.approx((-0.0097, 0.0097), abs=1e-4)
