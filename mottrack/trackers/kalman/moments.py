"""Mean and covariance of a mixture of two Gaussians."""

from __future__ import annotations

from typing import NamedTuple

from mottrack.core.arrays import F64


class Moments(NamedTuple):
    """N Gaussians in D dimensions."""

    mean: F64
    """(N, D)"""
    covariance: F64
    """(N, D, D)"""


def mixture(a: Moments, b: Moments, weight: F64) -> Moments:
    """Return the moments of (1 - w) a + w b for weights w (N,)."""
    apart, w = b.mean - a.mean, weight[:, None]
    spread = apart[:, :, None] * apart[:, None, :]
    covariance = a.covariance + w[:, None] * (
        b.covariance - a.covariance + (1 - w[:, None]) * spread
    )
    return Moments(a.mean + w * apart, covariance)
