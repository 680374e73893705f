"""How far off a motion may be, in metres, so that a tracker can rely on it.

The head's covariance tells cells apart that look alike; how wrong a claimed motion is depends more
on how far it goes: a cell said to rest hardly ever moves, a match over a long way can be a wrong
one. So to the head's covariance, scaled, comes an error that grows with the claimed motion m,

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
RESTING_M = 0.03
"""A shorter claimed motion is one of a cell at rest."""
MOST_CELLS = 20_000
BINS = 5
"""The moving cells are judged in as many groups of equal size, from slow to fast."""


@dataclass(frozen=True)
class Calibration:
    """From the head's covariance to one that can be relied on."""

    scale: float = 1.0
    """Factor on the head's covariance."""
    sigma_m: float = 0.0
    """Standard deviation of one coordinate of a motion that goes far."""
    half_m: float = 0.1
    """Motion with half of that."""

    def covariance_m2(self, head_m2: Floats, motion_m: Floats) -> F32:
        """Covariance (...,2,2) from the head's (...,2,2) and the claimed motion (...,2)."""
        way_m = np.hypot(motion_m[..., 0], motion_m[..., 1])
        sigma_m = self.sigma_m * way_m / (way_m + self.half_m)
        added = np.square(sigma_m)[..., None, None] * np.eye(2)
        return (self.scale * head_m2 + added).astype(np.float32)


@dataclass(frozen=True)
class Residuals:
    """What a network said of N held-out cells and how wrong it was."""

    error_m: F32
    """(N,2) claimed less true motion."""
    motion_m: F32
    """(N,2) claimed motion."""
    head_m2: F32
    """(N,2,2) covariance of the head."""

    def __len__(self) -> int:
        return len(self.error_m)

    def select(self, chosen: Mask | I64) -> Residuals:
        """These cells."""
        return Residuals(self.error_m[chosen], self.motion_m[chosen], self.head_m2[chosen])

    def mahalanobis2(self, calibration: Calibration) -> F64:
        """(N,) squared errors in units of the calibrated covariance."""
        c = calibration.covariance_m2(self.head_m2, self.motion_m).astype(np.float64)
        x, y = self.error_m.astype(np.float64).T
        xx, xy, yy = c[:, 0, 0], c[:, 0, 1], c[:, 1, 1]
        squares: F64 = (yy * x * x - 2 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
        return squares


def fit_calibration(cells: Residuals) -> Calibration:
    """The calibration of held-out cells; of none the plain one."""
    if not len(cells):
        return Calibration()
    cells = cells.select(np.arange(0, len(cells), max(len(cells) // MOST_CELLS, 1)))
    way_m = np.hypot(*cells.motion_m.T)
    resting = way_m < RESTING_M
    plain = Calibration()
    judged = cells.select(resting) if resting.any() else cells
    # the head's scale is that of cells at rest, where nothing is added
    scale = max(float(np.quantile(judged.mahalanobis2(plain), INSIDE_2_SIGMA)) / 4.0, 1e-6)
    moving = cells.select(np.flatnonzero(~resting)[np.argsort(way_m[~resting], kind="stable")])
    tried = [Calibration(scale)]
    if len(moving) >= BINS:
        tried += [
            Calibration(scale, float(sigma_m), float(half_m))
            for sigma_m in np.geomspace(0.02, 0.6, 20)
            for half_m in np.geomspace(0.005, 0.4, 12)
        ]
    return min(tried, key=lambda one: _miss(moving, one))


def inside(squares: F64) -> tuple[float, float]:
    """Shares of squared Mahalanobis distances (N,) inside one and two sigma."""
    if not len(squares):
        return 0.0, 0.0
    return float(np.mean(squares < 1.0)), float(np.mean(squares < 4.0))


def _miss(moving: Residuals, calibration: Calibration) -> float:
    """How far the shares inside are off, from the slowest to the fastest cells."""
    total = 0.0
    for squares in np.array_split(moving.mahalanobis2(calibration), BINS):
        one, two = inside(squares)
        # a tracker gates at the outer contour
        total += (one - INSIDE_1_SIGMA) ** 2 + 4.0 * (two - INSIDE_2_SIGMA) ** 2
    return total
