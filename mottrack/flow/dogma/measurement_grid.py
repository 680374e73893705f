"""The measurement grid: Dempster-Shafer masses of one sweep on the world-aligned window."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.flow.dogma.polar import Blind, PolarView, polar_view
from mottrack.flow.dogma.returns import OBSTACLE, Returns
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Span, Workers

_PARTS = 6
"""A return counts as six sixths, spread 1:4:1 by Gauss-Hermite quadrature of its range error."""


class SensorConfig(StrictModel):
    """The inverse sensor model; distances in metres from the sensor's optical centre."""

    azimuth_bins: int = Field(720, ge=8, le=7200, description="directions of the polar view")
    occupied_mass: float = Field(0.9, gt=0, lt=1, description="evidence of a single return")
    range_noise_m: float = Field(0.05, ge=0, description="standard deviation of a return's range")
    free_mass_near: float = Field(0.85, ge=0, lt=1, description="evidence of free space at 0 m")
    free_mass_far: float = Field(
        0.0, ge=0, lt=1, description="... at `max_range_m`, linear between"
    )
    max_range_m: float = Field(70.0, gt=0, description="nothing is known to be free farther away")
    no_return_free_m: float = Field(
        0.0, ge=0, description="free reach of a direction in view without any return"
    )
    widest_gap_rad: float = Field(
        0.2, gt=0, description="a gap without returns wider than this is outside the field of view"
    )


class MeasurementGrid(NamedTuple):
    """Masses of one sweep; what is neither occupied nor free is unknown."""

    occupied: NDArray[np.float32]
    """(rows, cols) z_occ."""
    free: NDArray[np.float32]
    """(rows, cols) z_free."""


class _Fall(NamedTuple):
    """Free mass over range, as the kernel takes it."""

    near: float
    far: float
    max_range_m: float


def measure(
    returns: Returns, window: Window, config: SensorConfig, workers: Workers
) -> MeasurementGrid:
    """Occupied where returns end, free in front of the first one of each direction.

    Returns are fused by Dempster's rule: n of them leave (1 - p)^n of a cell's mass unknown. Free
    mass takes its share of what the returns left, so the masses never exceed one.
    """
    blind = Blind(config.widest_gap_rad, config.no_return_free_m)
    view = polar_view(returns.xy_m, returns.kind, config.azimuth_bins, blind)
    centre_m = (returns.centre_m - window.corner_m).astype(np.float32)
    hits = np.zeros(window.shape, np.int32)
    _count_hits(returns, window, centre_m, np.float32(config.range_noise_m * np.sqrt(3)), hits)
    missed = np.float32(1 - config.occupied_mass) ** (hits * np.float32(1 / _PARTS))
    free = np.zeros(window.shape, np.float32)
    fall = _Fall(config.free_mass_near, config.free_mass_far, config.max_range_m)
    workers.run(_free_mass, window.rows, view, window, (centre_m, fall), free)
    return MeasurementGrid(1 - missed, missed * free)


@njit(cache=True, nogil=True)
def _count_hits(
    returns: Returns,
    window: Window,
    centre_m: NDArray[np.float32],
    step_m: np.float32,
    hits: NDArray[np.int32],
) -> None:
    """Sixths of returns per cell: 4 where a return lies, 1 a quadrature step nearer and farther."""
    per_m = np.float32(1.0 / window.cell_m)
    for i in range(len(returns.kind)):
        if returns.kind[i] != OBSTACLE:
            continue
        x_m, y_m = returns.xy_m[i, 0], returns.xy_m[i, 1]
        step = step_m / max(np.sqrt(x_m * x_m + y_m * y_m), step_m)
        for side in range(-1, 2):
            stretch = np.float32(1) + side * step
            col = int(np.floor((centre_m[0] + x_m * stretch) * per_m))
            row = int(np.floor((centre_m[1] + y_m * stretch) * per_m))
            if 0 <= row < window.rows and 0 <= col < window.cols:
                hits[row, col] += 4 if side == 0 else 1


@njit(cache=True, nogil=True)
def _free_mass(
    rows: Span,
    view: PolarView,
    window: Window,
    sensor: tuple[NDArray[np.float32], _Fall],
    free: NDArray[np.float32],
) -> None:
    """A cell is free when every direction that crosses it is seen free to its far side."""
    centre_m, fall = sensor
    bins = len(view.reach_m)
    per_rad = bins / (2 * np.pi)
    half_m = 0.5 * window.cell_m
    for row in range(rows[0], rows[1]):
        y_m = (row + 0.5) * window.cell_m - centre_m[1]
        for col in range(window.cols):
            x_m = (col + 0.5) * window.cell_m - centre_m[0]
            range_m = np.sqrt(x_m * x_m + y_m * y_m)
            if range_m >= fall.max_range_m:
                continue
            middle = (np.arctan2(y_m, x_m) + np.pi) * per_rad
            half = min(half_m / max(range_m, half_m) * per_rad, 0.5 * bins)
            reach_m = range_m + half_m
            seen = True
            for b in range(int(np.floor(middle - half)), int(np.floor(middle + half)) + 1):
                seen = seen and view.reach_m[b % bins] >= reach_m
            if seen:
                free[row, col] = fall.near + (fall.far - fall.near) * range_m / fall.max_range_m
