"""The regression of errors over the distance."""

import numpy as np
import pytest

from landerd.analysis.regression import regression


def test_a_cubic_is_found() -> None:
    x = np.linspace(2.0, 20.0, 50)
    fit = regression(list(x), list(1e-3 * x**3 - 0.02 * x + 0.1), 3)
    assert fit is not None
    assert fit["polynomial"] == pytest.approx([1e-3, 0.0, -0.02, 0.1], abs=1e-9)


@pytest.mark.parametrize("spread", [0.0, 1e-6, 1e-3])
def test_distances_of_a_vehicle_that_hovers_have_no_fit(spread: float) -> None:
    x = 12.0 + spread * np.linspace(-1.0, 1.0, 9)
    assert regression(list(x), [0.01, 0.02, 0.01] * 3, 3) is None
