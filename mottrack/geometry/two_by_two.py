"""Closed forms for symmetric 2x2 matrices and Gaussians in the plane.

The first functions work on stacks of any leading shape (..., 2, 2) with numpy. Those after them are
compiled, one matrix at a time, for kernels that loop over tracks themselves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mottrack.compiled import compiled
from mottrack.core.arrays import F64, Mask

LOG_2_PI = float(np.log(2.0 * np.pi))


def inverse_2x2(matrix: F64) -> F64:
    """Return the inverses (..., 2, 2) of symmetric positive definite matrices."""
    a, b, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    inverse = np.empty_like(matrix)
    inverse[..., 0, 0], inverse[..., 1, 1] = d, a
    inverse[..., 0, 1] = inverse[..., 1, 0] = -b
    return inverse / (a * d - b * b)[..., None, None]


def determinant_2x2(matrix: F64) -> F64:
    """Return the determinants (...) of symmetric matrices (..., 2, 2)."""
    return np.asarray(matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] ** 2)


def quadratic_2x2(matrix: F64, vector: F64) -> F64:
    """Return v' M v (...) for symmetric matrices (..., 2, 2) and vectors (..., 2)."""
    x, y = vector[..., 0], vector[..., 1]
    return matrix[..., 0, 0] * x * x + 2 * matrix[..., 0, 1] * x * y + matrix[..., 1, 1] * y * y


def mahalanobis_2x2(residual: F64, covariance: F64) -> F64:
    """Return sqrt(r' S^-1 r) (...) for residuals (..., 2) and covariances (..., 2, 2)."""
    return np.sqrt(quadratic_2x2(inverse_2x2(covariance), residual))


def density_2x2(residual: F64, covariance: F64) -> F64:
    """Return the normal density N(r; 0, S) (...) for (..., 2) and (..., 2, 2)."""
    squared = quadratic_2x2(inverse_2x2(covariance), residual)
    return np.asarray(np.exp(-0.5 * squared) / (2 * np.pi * np.sqrt(determinant_2x2(covariance))))


def log_density_2x2(residual: F64, covariance: F64) -> F64:
    """Return log N(r; 0, S) (...) for residuals (..., 2) and covariances (..., 2, 2)."""
    squared = quadratic_2x2(inverse_2x2(covariance), residual)
    return -0.5 * (squared + np.log(determinant_2x2(covariance))) - LOG_2_PI


def root_information_2x2(covariance: F64) -> F64:
    """Return lower triangular W (..., 2, 2) with W' W = C^-1 for covariances C (..., 2, 2)."""
    xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    first = np.sqrt(xx)
    second = np.sqrt(yy - xy**2 / xx)
    root = np.zeros_like(covariance)
    root[..., 0, 0] = 1.0 / first
    root[..., 1, 0] = -xy / (xx * second)
    root[..., 1, 1] = 1.0 / second
    return root


def is_covariance_2x2(matrix: F64) -> Mask:
    """Return whether matrices (..., 2, 2) are finite, symmetric, positive definite and usable.

    Variances outside 1e-12 to 1e12, and correlations within 1e-12 of one, are refused: a filter in
    double precision cannot use them.
    """
    xx, yy, xy = matrix[..., 0, 0], matrix[..., 1, 1], matrix[..., 0, 1]
    with np.errstate(all="ignore"):
        in_range = (xx > 1e-12) & (yy > 1e-12) & (xx < 1e12) & (yy < 1e12)
        symmetric = np.abs(xy - matrix[..., 1, 0]) <= 1e-9 * np.sqrt(np.abs(xx * yy))
        return in_range & symmetric & (xx * yy - xy**2 > 1e-12 * xx * yy)


class Symmetric(NamedTuple):
    """One symmetric matrix (2, 2) in a kernel: an array would cost more than what is done to it."""

    xx: float
    xy: float
    yy: float


@compiled
def block_of(matrices: F64, n: int, first: int) -> Symmetric:
    """Return rows and columns `first` and `first` + 1 of one of the matrices (N, D, D)."""
    second = first + 1
    return Symmetric(
        matrices[n, first, first], matrices[n, first, second], matrices[n, second, second]
    )


@compiled
def sum_of(a: Symmetric, b: Symmetric) -> Symmetric:
    """Return a + b."""
    return Symmetric(a.xx + b.xx, a.xy + b.xy, a.yy + b.yy)


@compiled
def scaled(s: Symmetric, factor: float) -> Symmetric:
    """Return s times a number."""
    return Symmetric(factor * s.xx, factor * s.xy, factor * s.yy)


@compiled
def determinant_of(s: Symmetric) -> float:
    """Return the determinant."""
    return float(s.xx * s.yy - s.xy * s.xy)


@compiled
def inverse_quadratic_of(s: Symmetric, x: float, y: float) -> float:
    """Return v' S^-1 v for v = (x, y)."""
    return float((s.yy * x * x - 2.0 * s.xy * x * y + s.xx * y * y) / determinant_of(s))


@compiled
def row_times_inverse(x: float, y: float, s: Symmetric) -> tuple[float, float]:
    """Return (x, y) S^-1, a row of K = P H' S^-1."""
    determinant = determinant_of(s)
    return (x * s.yy - y * s.xy) / determinant, (y * s.xx - x * s.xy) / determinant
