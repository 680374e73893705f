"""New-born particles: where occupancy appeared, at rest, slow or fast."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from mottrack.config import StrictModel
from mottrack.flow.dogma.noise import draw, normal_level, uniform, uniform_level
from mottrack.flow.dogma.particles import Particles
from mottrack.flow.dogma.window import Window
from mottrack.flow.dogma.workers import Span, Workers


class BirthConfig(StrictModel):
    """Velocity of new-born particles: at rest, or one of two zero-mean normal distributions."""

    rest_share: float = Field(0.8, ge=0, le=1, description="share at rest of what came into view")
    slow_share: float = Field(0.4, ge=0, le=1, description="share of slow particles in the rest")
    slow_mps: float = Field(1.0, ge=0, description="standard deviation per axis, slow particles")
    fast_mps: float = Field(12.0, ge=0, description="standard deviation per axis, fast particles")


class VelocityPrior(NamedTuple):
    """`BirthConfig` as the kernel takes it."""

    rest: NDArray[np.float32]
    """(cells,) share at rest."""
    slow: np.float32
    """Share of slow particles among those that move."""
    slow_mps: np.float32
    fast_mps: np.float32

    @classmethod
    def of(cls, config: BirthConfig, uncovered: NDArray[np.float32]) -> VelocityPrior:
        """Only the `uncovered` share (rows, cols) of the births may be at rest."""
        values = (config.slow_share, config.slow_mps, config.fast_mps)
        rest = np.float32(config.rest_share) * uncovered.ravel()
        return cls(rest, *(np.float32(value) for value in values))


class Births(NamedTuple):
    """New-born particles sorted by cell."""

    start: NDArray[np.int64]
    """(cells + 1,) particles `start[c]:start[c + 1]` are born in cell c."""
    mass_each: float
    """Share of the born mass that each one carries."""


def allot(born: NDArray[np.float32], count: int, key: np.uint64) -> Births:
    """Shares `count` particles among the cells in proportion to the born mass (rows, cols).

    Systematic: a cell gets its exact share rounded up or down, by one random number for all.
    """
    start = np.zeros(born.size + 1, np.int64)
    total = _share_out(born.ravel(), count, uniform(key), start)
    return Births(start, total / count)


@njit(cache=True, nogil=True)
def _share_out(
    born: NDArray[np.float32], count: int, offset: float, start: NDArray[np.int64]
) -> float:
    """Fills `start` and returns the total mass; one after the other, so sums never differ."""
    total = 0.0
    for c in range(len(born)):
        total += born[c]
    if total <= 0.0:
        return 0.0
    reached = 0.0
    for c in range(len(born)):
        reached += born[c]
        start[c + 1] = min(int(np.floor(reached / total * count + offset)), count)
    return total


def give_birth(
    births: Births, window: Window, prior: VelocityPrior, key: np.uint64, workers: Workers
) -> Particles:
    """Particles uniform in their cell, with velocities drawn from the prior."""
    born = Particles.empty(int(births.start[-1]))
    workers.run(_spread, len(births.start) - 1, births.start, window, (prior, key), born)
    return born


@njit(cache=True, nogil=True)
def _spread(
    cells: Span,
    start: NDArray[np.int64],
    window: Window,
    source: tuple[VelocityPrior, np.uint64],
    born: Particles,
) -> None:
    prior, key = source
    cell_m = np.float32(window.cell_m)
    for cell in range(cells[0], cells[1]):
        row, col = cell // window.cols, cell % window.cols
        rest = prior.rest[cell]
        for i in range(start[cell], start[cell + 1]):
            bits = draw(key, np.uint64(i))
            pick = uniform_level(bits, 2)
            limit = rest + (np.float32(1) - rest) * prior.slow
            spread_mps = prior.slow_mps if pick < limit else prior.fast_mps
            spread_mps = np.float32(0) if pick < rest else spread_mps
            born.x_m[i] = (col + uniform_level(bits, 0)) * cell_m
            born.y_m[i] = (row + uniform_level(bits, 1)) * cell_m
            born.vx_mps[i] = spread_mps * normal_level(bits, 3)
            born.vy_mps[i] = spread_mps * normal_level(bits, 4)
