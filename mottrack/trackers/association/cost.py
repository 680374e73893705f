"""Costs of candidate pairs: small is good, one number a pair."""

import numpy as np

from mottrack.core.arrays import F64, I64


def centre_distance_m(left_xy_m: F64, right_xy_m: F64, pairs: tuple[I64, I64]) -> F64:
    """Distance in metres between the centres (N, 2) and (M, 2) of each pair, (P,)."""
    return np.asarray(np.linalg.norm(left_xy_m[pairs[0]] - right_xy_m[pairs[1]], axis=1))


def mahalanobis(residual: F64, covariance: F64) -> F64:
    """sqrt(r' S^-1 r) of residuals (P, D) with positive definite covariances (P, D, D), (P,)."""
    if len(residual) == 0:
        return np.empty(0)
    solved = np.linalg.solve(covariance, residual[:, :, None])[:, :, 0]
    squared: F64 = np.einsum("pd,pd->p", residual, solved)
    return np.sqrt(np.maximum(squared, 0.0))
