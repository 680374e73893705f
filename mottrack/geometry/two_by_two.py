"""Closed forms for stacks of symmetric 2x2 matrices."""

import numpy as np

from mottrack.core.arrays import F64


def inverse_2x2(matrix: F64) -> F64:
    """Inverse of symmetric positive definite (N, 2, 2) matrices."""
    a, b, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    inverse = np.empty_like(matrix)
    inverse[:, 0, 0], inverse[:, 1, 1] = d, a
    inverse[:, 0, 1] = inverse[:, 1, 0] = -b
    return inverse / (a * d - b * b)[:, None, None]


def determinant_2x2(matrix: F64) -> F64:
    """Determinant of symmetric (N, 2, 2) matrices, (N,)."""
    return np.asarray(matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] ** 2)


def quadratic_2x2(matrix: F64, vector: F64) -> F64:
    """Quadratic form v' M v of symmetric (N, 2, 2) matrices and (N, 2) vectors, (N,)."""
    x, y = vector[:, 0], vector[:, 1]
    return matrix[:, 0, 0] * x * x + 2 * matrix[:, 0, 1] * x * y + matrix[:, 1, 1] * y * y
