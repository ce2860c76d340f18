"""Inverses and solutions of small matrices: numpy's own take four to nine times as long.

What OpenCV takes for singular may only be small, as covariances are: there numpy's tell.
"""

import cv2
import numpy as np

from landerd.camera_model import F64


def inverse(matrix: F64) -> F64:
    """Return the inverse of a matrix (n, n).

    Raises:
        LinAlgError: it is singular.
    """
    is_regular, inverted = cv2.invert(matrix)
    return np.asarray(inverted if is_regular else np.linalg.inv(matrix), dtype=np.float64)


def eigen(matrix: F64) -> tuple[F64, F64]:
    """Return the eigenvalues (n,) of a symmetric matrix, falling, and unit eigenvectors as columns.

    Unlike numpy's they may point either way from one version to the next.
    """
    _, values, vectors = cv2.eigen(matrix)
    return np.asarray(values[:, 0], dtype=np.float64), np.asarray(vectors.T, dtype=np.float64)


def solved(matrix: F64, right: F64) -> F64:
    """Return the solution (n,) or (n, k) of matrix (n, n) times it being right, (n,) or (n, k).

    Raises:
        LinAlgError: the matrix is singular.
    """
    is_regular, solution = cv2.solve(matrix, right.reshape(len(right), -1))
    if not is_regular:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    return np.asarray(solution, dtype=np.float64).reshape(right.shape)
