"""Calibration of the network's covariance, in metres, so that a tracker can rely on it.

The head's covariance L L^T distinguishes between cells that look alike; how wrong an estimate is
depends more on its length: a cell estimated at rest hardly ever moves, a match far away can be a
wrong one. So to the head's covariance, scaled, an error is added that grows with the estimated
displacement m,

    C = scale * L L^T + (sigma * |m| / (|m| + half))^2 I.

The three numbers are fitted on held-out cells, such that 39.3 % of the errors lie inside one sigma
and 86.5 % inside two, as those of a normal error in two dimensions would.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mottrack.core.arrays import F32, F64, I64, Floats, Mask

INSIDE_1_SIGMA = 1.0 - math.exp(-0.5)
INSIDE_2_SIGMA = 1.0 - math.exp(-2.0)
"""Shares of a normal error in two dimensions: the chi-square distribution at 1 and at 4."""
RESTING_M = 0.03
"""A shorter estimate is one of a cell at rest: 0.3 m/s at 10 Hz."""
MAX_CELLS = 20_000
"""More held-out cells are thinned to about this many: a share is then known to half a percent."""
SPEED_GROUPS = 5
"""The moving cells are scored in as many groups of equal size, from slow to fast: fewer would let
slow cells outweigh fast ones, more would leave few cells in each."""
SIGMAS_M = np.geomspace(0.02, 0.6, 20)
HALVES_M = np.geomspace(0.005, 0.4, 12)
"""Searched values of `Calibration.sigma_m` and `half_m`; each is within a fifth (sigma) or two
fifths (half) of the next, from below a sensor's noise to about a cell."""


@dataclass(frozen=True)
class Calibration:
    """Parameters that turn the head's covariance into a consistent one."""

    scale: float = 1.0
    """Factor on the head's covariance."""
    sigma_m: float = 0.0
    """Standard deviation of one coordinate that is added to a long displacement."""
    half_m: float = 0.1
    """Displacement at which half of `sigma_m` is added."""

    def covariance_m2(self, head_m2: Floats, motion_m: Floats) -> F32:
        """Return the covariance (...,2,2) of the head's (...,2,2) at displacements (...,2)."""
        length_m = np.hypot(motion_m[..., 0], motion_m[..., 1])
        sigma_m = self.sigma_m * length_m / (length_m + self.half_m)
        added = np.square(sigma_m)[..., None, None] * np.eye(2)
        return (self.scale * head_m2 + added).astype(np.float32)


@dataclass(frozen=True)
class Residuals:
    """Estimates of N held-out cells and their errors."""

    error_m: F32
    """(N,2) estimated less true displacement."""
    motion_m: F32
    """(N,2) estimated displacement."""
    head_m2: F32
    """(N,2,2) covariance of the head."""

    def __len__(self) -> int:
        return len(self.error_m)

    def select(self, chosen: Mask | I64) -> Residuals:
        """Return the cells that a mask or an index picks."""
        return Residuals(self.error_m[chosen], self.motion_m[chosen], self.head_m2[chosen])

    def mahalanobis2(self, calibration: Calibration) -> F64:
        """Return (N,) squared Mahalanobis distances under the calibrated covariance."""
        c = calibration.covariance_m2(self.head_m2, self.motion_m).astype(np.float64)
        x, y = self.error_m.astype(np.float64).T
        xx, xy, yy = c[:, 0, 0], c[:, 0, 1], c[:, 1, 1]
        squares: F64 = (yy * x * x - 2 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
        return squares


def covariance_of_factor(factor: F32) -> F32:
    """Return L L^T (...,2,2) of the head's output (log L_xx, L_yx, log L_yy) (...,3)."""
    xx, yx, yy = np.exp(factor[..., 0]), factor[..., 1], np.exp(factor[..., 2])
    rows = ((xx * xx, xx * yx), (xx * yx, yx * yx + yy * yy))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2).astype(np.float32)


def fit_calibration(cells: Residuals) -> Calibration:
    """Fit a calibration to held-out cells; without any it changes nothing."""
    if not len(cells):
        return Calibration()
    cells = cells.select(np.arange(0, len(cells), max(len(cells) // MAX_CELLS, 1)))
    length_m = np.hypot(*cells.motion_m.T)
    resting = length_m < RESTING_M
    # the scale is fitted where next to nothing is added: to the cells at rest
    reference = cells.select(resting) if resting.any() else cells
    quantile = float(np.quantile(reference.mahalanobis2(Calibration()), INSIDE_2_SIGMA))
    scale = max(quantile / 4.0, 1e-6)  # 2 sigma is 4 squared; above 0 keeps C invertible
    candidates = [Calibration(scale)]
    moving = cells.select(np.flatnonzero(~resting)[np.argsort(length_m[~resting], kind="stable")])
    if len(moving) >= SPEED_GROUPS:
        candidates += [
            Calibration(scale, float(sigma_m), float(half_m))
            for sigma_m in SIGMAS_M
            for half_m in HALVES_M
        ]
    return min(candidates, key=lambda one: _coverage_error(moving, one))


def coverage(squares: F64) -> tuple[float, float]:
    """Return the shares of squared Mahalanobis distances (N,) inside one and two sigma."""
    if not len(squares):
        return 0.0, 0.0
    return float(np.mean(squares < 1.0)), float(np.mean(squares < 4.0))


def _coverage_error(moving: Residuals, calibration: Calibration) -> float:
    """Sum the squared errors of the coverage over the groups of cells, sorted by speed."""
    total = 0.0
    for squares in np.array_split(moving.mahalanobis2(calibration), SPEED_GROUPS):
        one, two = coverage(squares)
        # the outer contour counts more: a tracker gates there
        total += (one - INSIDE_1_SIGMA) ** 2 + 4.0 * (two - INSIDE_2_SIGMA) ** 2
    return total
