"""Inverses, eigenvectors and linear equations of small matrices, and products of small vectors.

By OpenCV or written out, for speed: numpy's own functions take two to nine times as long. OpenCV
also reports matrices as singular that are only small, as covariances are: those are handed to
numpy, which decides.
"""

import math

import cv2
import numpy as np

from landerd.camera_model import F64


def length(v: F64) -> float:
    """Return the length of a vector (n,)."""
    return math.sqrt(v @ v)


def outer(a: F64, b: F64) -> F64:
    """Return the matrix (n, m) of the products of two vectors, (n,) and (m,)."""
    products: F64 = a[:, None] * b
    return products


def trace(matrix: F64) -> float:
    """Return the sum of the diagonal of a matrix (3, 3)."""
    return matrix.item(0, 0) + matrix.item(1, 1) + matrix.item(2, 2)


def inverse(matrix: F64) -> F64:
    """Return the inverse of a matrix (n, n).

    Raises:
        LinAlgError: it is singular.
    """
    is_regular, inverted = cv2.invert(matrix)
    return np.asarray(inverted if is_regular else np.linalg.inv(matrix), dtype=np.float64)


def eigen(matrix: F64) -> tuple[F64, F64]:
    """Return eigenvalues (n,), descending, and unit eigenvectors (n, n) of a symmetric matrix.

    The eigenvectors are columns. Unlike numpy's, their signs may differ between versions of OpenCV.
    """
    _, values, vectors = cv2.eigen(matrix)
    return np.asarray(values[:, 0], dtype=np.float64), np.asarray(vectors.T, dtype=np.float64)


def solved(matrix: F64, right: F64) -> F64:
    """Return x, (n,) or (n, k), such that matrix @ x = right.

    Args:
        matrix: (n, n).
        right: right-hand side, (n,) or (n, k).

    Raises:
        LinAlgError: the matrix is singular.
    """
    is_regular, solution = cv2.solve(matrix, right.reshape(len(right), -1))
    if not is_regular:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    return np.asarray(solution, dtype=np.float64).reshape(right.shape)
