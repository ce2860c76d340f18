"""Small matrices as numpy has them, tiny ones too."""

import numpy as np
import pytest

from landerd.camera_model import F64
from landerd.vision.edge_profile import medians
from landerd.vision.linear import eigen, inverse, solved


def _regular(n: int, size: float) -> F64:
    rng = np.random.default_rng(n)
    half = rng.normal(size=(n, n))
    regular: F64 = size * (half @ half.T + 0.1 * np.eye(n))
    return regular


# What OpenCV alone takes for singular begins at 1e-14.
@pytest.mark.parametrize("size", [1.0, 1e-9, 1e-20])
@pytest.mark.parametrize("n", [2, 3, 6, 13])
def test_inverses_and_solutions_are_numpys(n: int, size: float) -> None:
    matrix, right = _regular(n, size), np.arange(2.0 * n).reshape(n, 2) + 1.0
    # A part of a larger matrix, as fits have them.
    part = np.pad(matrix, 2)[2:-2, 2:-2]
    np.testing.assert_allclose(inverse(part) * size, np.linalg.inv(matrix) * size, atol=1e-9)
    both = np.linalg.solve(matrix, right) * size
    np.testing.assert_allclose(solved(part, right) * size, both, atol=1e-9)
    np.testing.assert_allclose(solved(part, right[:, 1]) * size, both[:, 1], atol=1e-9)


@pytest.mark.parametrize("n", [2, 3, 6])
def test_a_singular_matrix_has_no_inverse_and_no_solution(n: int) -> None:
    with pytest.raises(np.linalg.LinAlgError):
        inverse(np.zeros((n, n)))
    with pytest.raises(np.linalg.LinAlgError):
        solved(np.zeros((n, n)), np.ones(n))


def test_a_matrix_is_the_product_of_its_eigenvectors_and_eigenvalues() -> None:
    matrix = _regular(5, 1e-6)
    values, axes = eigen(matrix)
    assert (np.diff(values) <= 0.0).all()
    np.testing.assert_allclose(axes.T @ axes, np.eye(5), atol=1e-12)
    np.testing.assert_allclose((axes * values) @ axes.T, matrix, rtol=1e-9)


@pytest.mark.parametrize("samples", [1, 2, 7, 24])
def test_medians_are_numpys(samples: int) -> None:
    rows = np.random.default_rng(samples).normal(size=(5, samples))
    np.testing.assert_array_equal(medians(rows), np.median(rows, axis=1))
